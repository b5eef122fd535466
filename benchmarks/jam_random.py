"""Random four-bars and scissors: does `linktwin jam` say what another engine's own motions say?

python -m benchmarks.jam_random --count 200 --seed 4001      # 40 with another seed while working on it
python -m benchmarks.jam_random --engine exudyn              # as a check: a hundred times slower where joints rub

The truth is found in MuJoCo (or Exudyn) alone: it lets the drawing go, sees whether and since when it rests, then lets
it go again from there without friction, with up to a hundred times the drive, and a little off the pose.  A drawing
whose verdict turns with 3% more or less friction, or with half the step, is undecided there and left out; so is one
that it cannot follow.  Every left out drawing is counted.  Nothing of ours is looked at before.
"""

import argparse
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from backend.blind.exudyn_engine import simulate_exudyn
from backend.blind.mujoco_engine import simulate_mujoco
from backend.blind.poses import PeerMotion
from backend.jam.run import jam
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism
from benchmarks.scissor import scissor
from tests.mechanisms import WEIGHTLESS, Z, bar, document, drawing, effect

DURATION_S, SEEN_S = 0.5, 1e-3
AT_REST = 1e-3  # rad/s at the end; Exudyn's friction creeps by 1e-5 rad/s at 71% of its limit
STANDSTILL = 1e-3  # of the greatest rate
WHILE_S, FREED = 0.25, 0.02  # how long a copy is watched, and how far it comes [rad] if it is free
ACCELERATES = 1e-3  # rad that a copy without friction comes if it accelerates at all: 0.03 rad/s² in that time
STRONGER = (2.0, 10.0, 30.0, 100.0)
DECIDED = 0.03
SAME_ONSET_S = 5e-3  # by which the engine's own two steps may differ
BALANCED = 1e-4  # rad/s in the first 10 ms: only rounding, and what a loop gives way by, leave an exact dead centre
PUSH, PUSHED_S = 1e-4, 1.0  # rad; what grows from a small push takes its time, what swings stays far below `FREED`
FAR_RAD = 1e3
FRICTIONS = ("coulomb_friction", "pin_friction")
DRIVES = {"applied_torque": "torque_n_m", "applied_force": "force_n", "extension_spring": "stiffness_n_per_m"}
TWISTED = ("crank", "coupler", "rocker")

Random = np.random.Generator


@dataclass(frozen=True)
class Truth:
    """What the other engine says.  onset_s: None where it moves to the end."""

    jammed: bool
    cause: str
    onset_s: float | None


class Undecided(Exception):
    """The other engine gives no clear answer; the message says why."""


# ---- drawings


def fourbar(random: Random) -> Mechanism:
    """A closed four-bar of random sides and pose, driven at a random link, rubbing at every pin."""
    pose = str(random.choice(["any", "near", "dead"], p=[0.6, 0.25, 0.15]))
    elbow, knee, base = closed_pose(random, pose)
    corners = [np.append(p, 0.0) for p in (np.zeros(2), elbow, knee, np.array([base, 0.0]))]
    bars = [bar(n, corners[i], corners[i + 1]) for i, n in enumerate(TWISTED)]
    ends = ["ground", *TWISTED, "ground"]
    pins = [(f"j{i + 1}", "revolute", ends[i], ends[i + 1], corners[i], Z) for i in range(4)]
    torque = float(random.choice([-1.0, 1.0]) * 10 ** random.uniform(-2.0, -0.5))
    kinds = {"any": ["free", "dry", "rub", "stop"], "near": ["rub"], "dead": ["still", "still", "rub"]}
    kind = str(random.choice(kinds[pose]))
    link = str(random.choice(["crank", "rocker"])) if pose == "any" else "rocker"
    dry = 10 ** random.uniform(-1.0, 0.7) * abs(torque) / 4 if kind == "dry" else 0.0
    rub = random.uniform(0.3, 1.5) if kind == "rub" else random.uniform(0.0, 0.1) * (kind == "free")
    end = random.uniform(0.1, 0.4) if kind == "stop" else FAR_RAD
    effects = [
        effect("drive", "applied_torque", [link], torque_n_m=torque, axis=[0, 0, 1]),
        effect("dry", "coulomb_friction", "all", friction_torque_n_m=float(dry)),
        effect("rub", "pin_friction", "all", friction_coefficient=float(rub)),
        effect("end", "joint_stop", ["j1" if link == "crank" else "j4"], lower=-float(end), upper=float(end)),
    ]
    drawn = document(drawing("four-bar", bars, pins, effects, gravity=WEIGHTLESS))
    for joint in drawn["joints"]:
        joint["fit"]["pin_diameter_m"] = float(2 * random.uniform(0.004, 0.02))
    return parse_mechanism(drawn)


def closed_pose(random: Random, pose: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Elbow, knee, and where the rocker stands; `dead`: crank and coupler in one line, `near`: almost."""
    while True:
        crank, coupler, rocker, base = random.uniform(0.06, 0.2, 4)
        side = random.choice([-1.0, 1.0])
        off = {"any": random.uniform(-np.pi, np.pi), "near": side * random.uniform(0.01, 0.15), "dead": 0.0}[pose]
        # The triangle of crank and coupler, bent by `off` from stretched; it closes on rocker and base.
        tip = np.array([crank + coupler * np.cos(off), coupler * np.sin(off)])
        reach = float(np.linalg.norm(tip))
        cosine = (base**2 + reach**2 - rocker**2) / (2 * base * reach)
        if abs(cosine) > 0.9:
            continue
        turn = np.arccos(cosine) - np.arctan2(tip[1], tip[0])
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        return rotation @ [crank, 0.0], rotation @ tip, float(base)


def lattice(random: Random) -> Mechanism:
    """A guided scissor of two cells that a spring opens, rubbing at every pin."""
    drawn = document(scissor(2, random.uniform(0.15, 1.3), 10 ** random.uniform(1.0, 2.5)))
    drawn["gravity_m_per_s2"] = [0.0, 0.0, 0.0]
    spring = drawn["effects"][0]["parameters"]
    stretched = random.uniform(0.3, 1.8) * spring["free_length_m"]
    spring["free_length_m"] = float(stretched)
    kind = random.choice(["free", "dry", "dry", "rub"])
    dry = 10 ** random.uniform(-4.0, -1.5) if kind == "dry" else 0.0
    rub = random.uniform(0.3, 1.5) if kind == "rub" else 0.0
    pins = [joint["id"] for joint in drawn["joints"] if joint["type"] == "revolute"]
    for joint in drawn["joints"]:
        if joint["type"] == "revolute":
            joint["fit"] = {"pin_diameter_m": float(2 * random.uniform(0.004, 0.02))}
    more = [
        effect("dry", "coulomb_friction", pins, friction_torque_n_m=float(dry)),
        effect("rub", "pin_friction", pins, friction_coefficient=float(rub)),
    ]
    drawn["effects"] += [one.model_dump(mode="json") for one in more]
    return parse_mechanism(drawn)


# ---- the truth, from another engine alone


@dataclass(frozen=True)
class Judge:
    """An engine that is asked for motions.  step_s: the longer of the two steps that must agree."""

    simulate: Callable[..., PeerMotion]
    step_s: float

    def truth(self, mechanism: Mechanism) -> Truth:
        """What both steps say.  Raises Undecided."""
        known = self.seen(mechanism)
        finer = replace(self, step_s=self.step_s / 2).seen(mechanism)
        when = [0.0 if t.onset_s is None else t.onset_s for t in (known, finer)]
        if (known.jammed, known.cause) != (finer.jammed, finer.cause) or abs(when[0] - when[1]) > SAME_ONSET_S:
            raise Undecided("half the step says otherwise")
        return finer

    def seen(self, mechanism: Mechanism) -> Truth:
        """What the engine says at one step.  Raises Undecided."""
        drawn = document(mechanism)
        seen = self.followed(drawn, DURATION_S)
        if not rests(seen):
            rubs = any(given["kind"] in FRICTIONS and acts(given) for given in drawn["effects"])
            if rubs and rests(self.followed(changed(drawn, friction=1 + DECIDED), DURATION_S)):
                raise Undecided("3% more friction stops it")
            if not rubs and fastest(seen)[:10].max() < BALANCED:
                return Truth(True, "singularity", 0.0)
            return Truth(False, "none", None)
        rate = fastest(seen)
        fast = np.flatnonzero(rate > max(AT_REST, STANDSTILL * rate.max()))
        onset = float(seen.time_s[fast[-1]]) if fast.size else 0.0
        here = standing(drawn, seen)
        ends = at_its_end(drawn, seen)
        if not self.goes(changed(here, friction=0.0), far=ACCELERATES):
            if ends:
                return Truth(False, "stop", onset)
            away = any(self.goes(changed(here, friction=0.0), push) for push in (PUSH, -PUSH))
            return Truth(away, "singularity" if away else "none", onset)
        if self.goes(changed(here, friction=1 - DECIDED)):
            raise Undecided("3% less friction frees it")
        strong = any(self.goes(changed(here, drive=factor)) for factor in STRONGER)
        return Truth(True, "insufficient_drive" if strong else "friction_lock", onset)

    def followed(self, drawn: dict, duration_s: float, rates: dict[str, float] | None = None) -> PeerMotion:
        """The engine's motion."""
        there = {**drawn, "effects": [given for given in drawn["effects"] if acts(given)]}
        try:
            return self.simulate(there, duration_s, self.step_s, output_step_s=SEEN_S, initial_joint_velocities=rates)
        except (RuntimeError, ValueError) as why:
            raise Undecided("the engine cannot follow it") from why

    def goes(self, drawn: dict, push: float = 0.0, far: float = FREED) -> bool:
        """Whether it comes so far from a pose [rad], from rest.

        push: a rate that carries it that far off in the first 10 ms [rad].
        """
        first = drawn["joints"][0]["id"]
        seen = self.followed(drawn, PUSHED_S if push else WHILE_S, {first: push / 0.01} if push else None)
        return any(np.abs(q - q[0]).max() > far for q in seen.joint_positions.values())


JUDGES = {
    "mujoco": Judge(simulate_mujoco, 1e-4),
    "exudyn": Judge(partial(simulate_exudyn, friction_creep=1e-4), 5e-4),
}


def acts(given: dict) -> bool:
    """Whether an effect does anything: those that do not would only slow an engine down."""
    values = given["parameters"]
    return given["kind"] not in (*FRICTIONS, "joint_stop") or 0.0 < max(abs(v) for v in values.values()) < FAR_RAD


def fastest(seen: PeerMotion) -> np.ndarray:
    """The largest turn rate of any joint, per sample."""
    return np.max([np.abs(v) for v in seen.joint_velocities.values()], axis=0)


def rests(seen: PeerMotion) -> bool:
    """Whether it stands still for the last 20 ms."""
    return bool(fastest(seen)[-20:].max() < AT_REST)


def changed(drawn: dict, friction: float = 1.0, drive: float = 1.0) -> dict:
    """The drawing with its friction or drive times a factor."""
    effects = []
    for given in drawn["effects"]:
        values = dict(given["parameters"])
        if given["kind"] in FRICTIONS:
            values = {name: friction * value for name, value in values.items()}
        if given["kind"] in DRIVES:
            values[DRIVES[given["kind"]]] *= drive
        effects.append({**given, "parameters": values})
    return {**drawn, "effects": effects}


def standing(drawn: dict, seen: PeerMotion) -> dict:
    """The drawing with its bodies where they came to rest."""
    bodies = []
    for body in drawn["bodies"]:
        placed = dict(body)
        if body["id"] in seen.position_m and not body.get("fixed"):
            placed["pose"] = {
                "position_m": seen.position_m[body["id"]][-1].tolist(),
                "quaternion_wxyz": seen.quaternion_wxyz[body["id"]][-1].tolist(),
            }
        bodies.append(placed)
    return {**drawn, "bodies": bodies}


def at_its_end(drawn: dict, seen: PeerMotion) -> bool:
    """Whether a joint stands at a declared end of its travel."""
    for given in drawn["effects"]:
        if given["kind"] == "joint_stop":
            q = seen.joint_positions[given["on"][0]][-1]
            values = given["parameters"]
            # The engines' ends are springs: a joint that rests beyond one rests on it.
            if q > values["upper"] - 1e-3 or q < values["lower"] + 1e-3:
                return True
    return False


# ---- the comparison


def main() -> None:
    """One line a drawing with --each, then the figures."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--count", type=int, default=200)
    options.add_argument("--seed", type=int, default=4001)
    options.add_argument("--engine", choices=JUDGES, default="mujoco")
    options.add_argument("--each", action="store_true", help="print every drawing")
    chosen = options.parse_args()
    begin, left_out = time.perf_counter(), Counter()
    asked: list[tuple[Truth, Any]] = []
    for index in range(chosen.count):
        random = np.random.default_rng([chosen.seed, index])
        make: Callable[[Random], Mechanism] = fourbar if index % 10 < 7 else lattice
        mechanism = make(random)
        try:
            known = JUDGES[chosen.engine].truth(mechanism)
        except Undecided as why:
            left_out[str(why)] += 1
            continue
        said = jam(mechanism, DURATION_S, 1e-3).report
        asked.append((known, said))
        if chosen.each:
            wrong = "" if (known.jammed, known.cause) == (said.jammed, said.cause) else "   <--"
            print(
                f"{index:4d} {mechanism.name:18s} {known.jammed!s:5} {known.cause:18s} {_s(known.onset_s)}   "
                f"{said.jammed!s:5} {said.cause:18s} {_s(said.onset_s)}  {said.result[:40]}{wrong}",
                flush=True,
            )
    tell(asked, left_out, time.perf_counter() - begin)


def _s(value: float | None) -> str:
    return "   -  " if value is None else f"{value:6.3f}"


def tell(asked: list[tuple[Truth, Any]], left_out: Counter, wall_s: float) -> None:
    """Balanced accuracy, onset and causes."""
    jammed = [said.jammed for known, said in asked if known.jammed]
    free = [not said.jammed for known, said in asked if not known.jammed]
    print(f"{len(asked)} drawings, {len(jammed)} jammed and {len(free)} not, in {wall_s:.0f} s")
    print(f"left out: {dict(left_out)}")
    balanced = 50 * (np.mean(jammed) + np.mean(free))
    print(f"balanced accuracy {balanced:.1f}%  ({sum(jammed)}/{len(jammed)} jams, {sum(free)}/{len(free)} free)")
    both = [(k.onset_s, s.onset_s) for k, s in asked if k.jammed and s.jammed]
    missed = 1e3 * np.abs([a - b for a, b in both])
    print(f"onset off by {np.median(missed):.1f} ms in the middle, {np.percentile(missed, 95):.1f} ms at 95%, "
          f"{np.max(missed):.1f} ms at worst; {100 * np.mean(missed <= 10):.1f}% within 10 ms")  # fmt: skip
    causes = [k.cause == s.cause for k, s in asked if k.jammed]
    print(f"cause right in {100 * np.mean(causes):.1f}% of the jams")
    for (was, told), count in sorted(Counter((k.cause, s.cause) for k, s in asked).items()):
        print(f"   {was:20s} told as {told:20s} {count}")


if __name__ == "__main__":
    main()
