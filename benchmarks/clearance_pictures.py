"""The pictures of docs/clearance.md.

python -m benchmarks.clearance_pictures
"""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from backend.mechanism.effect import Effect
from backend.mechanism.mechanism import Mechanism
from backend.model.build import build
from backend.model.model import Model
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate import contact, invariants, kinematics, law
from backend.simulate.rollout import Trajectory, rollout
from benchmarks.scissor import LENGTH_M, scissor
from tests.mechanisms import effect, pendulum

FOLDER = Path(__file__).parents[1] / "docs" / "pictures"
PLAY_M = 1e-3
RADIUS_M, FOLDED_RAD, PUSH_N, DAMPING, LOOSE_M = 5e-3, 1.3, 2.0, 0.05, 3e-4
INK, BLUE, ORANGE, RED, GREY = "#1f2933", "#1f6fb4", "#e07b16", "#c0292f", "#9aa5b1"
plt.rcParams.update(
    {
        "font.size": 9,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "legend.frameon": False,
        "axes.edgecolor": INK,
    }
)


@eqx.filter_jit
def followed(model: Model, step_s: jax.Array, steps: int):
    """Motion from rest; energies [J]; the pins' centres in their holes [m] and their gaps [m]."""
    plant = system(model)
    path = rollout(plant, Start(drawn_pose(model, plant), jnp.zeros((model.topology.slots, 6))), step_s, steps, None, 6)

    def inside(pose):
        rows = kinematics.rows(plant, kinematics.bodies(plant, pose)).value
        eta = law.at_walls(plant, jnp.where(plant.coordinate_rows, 0.0, rows))
        return eta[:, :2], contact.gap(plant.contacts, plant.contacts.room, eta)

    centre, gap = jax.vmap(inside)(path.pose)
    energy = invariants.kinetic_energy(plant, path) + invariants.potential_energy(plant, path)
    return path, energy, centre, gap


def follow(model: Model, step_s: float, duration_s: float):
    """The same as NumPy arrays.  RuntimeError where a step is lost."""
    path, *rest = followed(model, jnp.asarray(step_s), round(duration_s / step_s))
    if bool(path.lost.any()):
        raise RuntimeError(f"a step at {float(path.time_s[int(np.argmax(path.lost))]):.4f} s was lost")
    return jax.tree.map(np.asarray, (path, *rest))


RATTLES = {"restitution 0": (0.0, 0.0, BLUE), "restitution 0.8": (0.8, 0.0, ORANGE), "friction 0.3": (0.0, 0.3, RED)}


def rattles(duration_s: float = 0.5, step_s: float = 2e-4) -> dict[str, tuple]:
    """A pendulum released level on a loose pin, three walls."""
    model = build(pendulum(0.5 * np.pi, effects=[effect("play", "clearance", ["pin"], radial_m=PLAY_M)]))
    made = {}
    for name, (restitution, friction, _) in RATTLES.items():
        walls = {("play", "restitution"): restitution, ("play", "friction_coefficient"): friction}
        made[name] = follow(model.with_parameters(walls), step_s, duration_s)
    return made


def rattling(runs: dict[str, tuple]) -> plt.Figure:
    """Path of the pin's centre, its gap and its wall's push."""
    figure = plt.figure(figsize=(9.2, 5.4), layout="constrained")
    grid = figure.add_gridspec(2, 3, width_ratios=[1.0, 1.25, 1.25])
    shares = {}
    for row, name in enumerate(("restitution 0", "restitution 0.8")):
        path, _, centre, gap = runs[name]
        colour, t = RATTLES[name][2], 1e3 * path.time_s
        hole: Axes = figure.add_subplot(grid[row, 0])
        hole.add_patch(Circle((0, 0), 1e3 * PLAY_M, fill=False, color=INK, lw=1.2))
        down, right = 1e3 * centre[:, 0].T  # frame A's x points down
        hole.plot(right, -down, color=colour, lw=0.8)
        hole.plot(0, 0, "+", color=INK)
        hole.set(aspect="equal", title=name, xlabel="in the hole, mm", ylabel="up, mm")
        hole.set_xlim(-1.15, 1.15)
        hole.set_ylim(-1.15, 1.15)
        for column, (values, label) in enumerate(
            ((1e3 * gap[:, 0], "gap, mm"), (path.wall[:, 0], "push of the wall, N")), 1
        ):
            axes = figure.add_subplot(grid[row, column], sharey=shares.get(column))
            shares[column] = axes
            axes.plot(t, values, color=colour, lw=0.8)
            axes.set(xlabel="time, ms", ylabel=label)
            if column == 2:
                axes.set_yscale("symlog", linthresh=1.0)
                axes.set_ylim(0, 500)
    return figure


def energies(runs: dict[str, tuple]) -> plt.Figure:
    """What each wall takes."""
    figure, (whole, start) = plt.subplots(1, 2, figsize=(9.2, 3.0), layout="constrained")
    for name, (path, energy, _, _) in runs.items():
        for axes in (whole, start):
            axes.plot(1e3 * path.time_s, 1e3 * (energy - energy[0]), color=RATTLES[name][2], lw=1.0, label=name)
    whole.set(xlabel="time, ms", ylabel="energy since release, mJ")
    start.set(xlabel="time, ms", xlim=(0, 120), ylim=(-0.35, 0.02), title="the first blows")
    whole.legend()
    return figure


def stowing(effects: list[Effect]) -> Mechanism:
    """A scissor of five cells, half folded, pushed together at its far end."""
    folded = scissor(5, angle_rad=FOLDED_RAD, spring_n_per_m=0.0)
    push = effect("push", "applied_force", ["a4"], direction=[-1, 0, 0], force_n=PUSH_N)
    drag = effect("drag", "viscous_friction", "all", damping_n_m_s_per_rad=DAMPING)
    kept = [e for e in folded.effects if e.id != "spring"]
    return folded.model_copy(update={"effects": (*kept, push, drag, *effects)})


def neighbours() -> list[Effect]:
    """Contact of bars that lie side by side in one layer."""
    half = 0.5 * LENGTH_M
    capsules = {
        "start_a_m": [-half, 0, 0],
        "end_a_m": [half, 0, 0],
        "start_b_m": [-half, 0, 0],
        "end_b_m": [half, 0, 0],
    }
    return [
        effect(
            f"meet {s}{i}",
            "link_contact",
            [f"{s}{i}", f"{s}{i + 1}"],
            radius_a_m=RADIUS_M,
            radius_b_m=RADIUS_M,
            **capsules,
        )
        for s in "ab"
        for i in range(4)
    ]


def bars(axes: Axes, model: Model, path: Trajectory, node: int) -> None:
    """Every bar as wide as its capsule."""
    for body in model.topology.body_ids:
        if body is None or body == "slider":
            continue
        slot = model.topology.slot(body)
        w, _, _, z = path.pose.quaternion[node, slot]
        turn = 2 * np.arctan2(z, w)
        along = 0.5 * LENGTH_M * np.array([np.cos(turn), np.sin(turn)])
        at = path.pose.position[node, slot, :2]
        across = RADIUS_M * np.array([-np.sin(turn), np.cos(turn)])
        outline = 1e3 * np.array([at - along + across, at + along + across, at + along - across, at - along - across])
        axes.fill(*outline.T, color=BLUE if body[0] == "a" else ORANGE, alpha=0.35, lw=0)
        axes.plot(*outline[[0, 1, 2, 3, 0]].T, color=BLUE if body[0] == "a" else ORANGE, lw=0.5)


def stowed() -> plt.Figure:
    """With and without contact, and with loose pins."""
    play = effect("play", "clearance", [j.id for j in stowing([]).joints if j.type == "revolute"], radial_m=LOOSE_M)
    drawn = {
        "no contact": (stowing([]), 1e-3, GREY),
        "contact": (stowing(neighbours()), 5e-4, BLUE),
        "contact, pins loose by 0.3 mm": (stowing([*neighbours(), play]), 2.5e-4, ORANGE),
    }
    figure, axes = plt.subplots(1, 4, figsize=(11.5, 3.6), layout="constrained", width_ratios=[1.1, 1.1, 1.4, 1.4])
    for name, (mechanism, step_s, colour) in drawn.items():
        model = build(mechanism)
        path, *_ = follow(model, step_s, 0.6)
        first, last = model.topology.slot("a0"), model.topology.slot("a4")
        width = 1e3 * (path.pose.position[:, last, 0] - path.pose.position[:, first, 0])
        axes[2].plot(1e3 * path.time_s, width, color=colour, label=name)
        print(f"{name:>32}: cells' width at the end {width[-1]:.2f} mm, {path.iterations.mean():.1f} iterations a step")
        if name == "no contact":
            bars(axes[0], model, path, int(np.argmin(np.abs(width))))
        else:
            axes[3].plot(1e3 * path.time_s, path.touch.sum(1), color=colour, lw=0.8)
        if name == "contact":
            bars(axes[1], model, path, len(path.time_s) - 1)
            print(f"{'':>32}  pushes at the end {np.round(path.touch[-1].reshape(8, 5).sum(1), 2)} N")
    axes[0].set(title="no contact, on the way through")
    axes[1].set(title="contact")
    for view in axes[:2]:
        view.set(aspect="equal", xlabel="mm", xlim=(-35, 85), ylim=(-115, 115))
    axes[2].axhline(0.0, color=INK, lw=0.5)
    axes[2].set(xlabel="time, ms", ylabel="first to last bar, mm")
    axes[2].legend(fontsize=7)
    axes[3].set(xlabel="time, ms", ylabel="sum of the pushes between bars, N")
    axes[3].set_yscale("symlog", linthresh=1.0)
    return figure


def main() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    runs = rattles()
    for name, figure in (("rattling", rattling(runs)), ("energy", energies(runs)), ("stowed", stowed())):
        path = FOLDER / f"clearance_{name}.png"
        figure.savefig(path, dpi=110)
        print(f"{path}  {path.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
