"""The pose in which a mechanism rests, what drives it there, and what it does when let go with something changed."""

from collections.abc import Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from backend.jam.follow import CHUNK, follow, steady
from backend.jam.knobs import driven, scaled
from backend.jam.statics import Statics, statics
from backend.jam.stuck import AT_REST, creep_ratio, largest_play, travel
from backend.model.model import Address, Model
from backend.model.state import Pose, Start
from backend.model.system import System, system
from backend.simulate import kinematics
from backend.simulate.assemble import closed
from backend.simulate.record import Record
from backend.simulate.rollout import Trajectory
from backend.simulate.spectrum import real

FLOWS = 1e3  # creep ratio that is motion even where play next to none leaves pins to settle
FREED = 0.02  # mechanism lengths or rad: what has come further than this, beyond its play, was free

_closed = eqx.filter_jit(closed)


@eqx.filter_jit
def _coordinates(plant: System, pose: Pose, near: Float[Array, "joints"]) -> Float[Array, "joints"]:
    return kinematics.coordinates_near(plant, kinematics.bodies(plant, pose), near)


@dataclass(frozen=True)
class Scene:
    """A pose of rest.  q: coordinates there.  radial: load of the joints across their axes [N].

    record: its addresses only matter, the model holds the values.
    """

    model: Model
    plant: System
    pose: Pose
    q: Float[np.ndarray, "joints"]
    radial: Float[np.ndarray, "joints 2"]
    record: Record | None
    step_s: float

    @classmethod
    def at(cls, model: Model, path: Trajectory, node: int, record: Record | None, step_s: float) -> "Scene":
        """Where a motion stands at a node; drives on record stay as they are there."""
        if record is not None:
            now = record.values[min(node, record.values.shape[0] - 1)]
            model = model.with_parameters(dict(zip(record.addresses, now, strict=True)))
        pose = jax.tree.map(lambda leaf: leaf[node], path.pose)
        radial = np.asarray(path.reaction[node, :, :2])
        return cls(model, system(model), pose, np.asarray(path.q[node]), radial, record, step_s)

    @property
    def gravity_drives(self) -> bool:
        """Whether weight is the only drive."""
        return not driven(self.model)

    def statics(self, pose: Pose | None = None, ideal: bool = False) -> Statics:
        """Rows and loads here, or at another pose; ideal: pins in the middle of their holes."""
        plant = self.plant.centred() if ideal else self.plant
        pose = self.pose if pose is None else pose
        if ideal and pose is self.pose and any(self.plant.contacts.loose):
            pose = _closed(self.plant, pose)
        return statics(plant, pose, _coordinates(plant, pose, jnp.asarray(self.q)), self.gravity_drives)

    def displaced(self, x: Float[np.ndarray, "freedoms"]) -> Statics:
        """Statics of the ideal copy's closed pose that is x (mechanism lengths and rad) away."""
        xi = np.zeros((self.plant.topology.slots, 6))
        xi[real(self.plant)] = x.reshape(-1, 6)
        xi[:, :3] *= float(self.plant.scale.length_m)
        return self.statics(_closed(self.plant, self.pose, jnp.asarray(xi)), ideal=True)

    def moves(
        self, drive: float = 1.0, friction: float = 1.0, play: float = 1.0, only: Sequence[Address] | None = None
    ) -> bool:
        """Whether it moves when let go here, from rest, with drives, friction or play times a factor.

        It is simulated for 250 steps.  only: plays that change; all by default.
        """
        model = scaled(self.model, drive, friction, play, only, self.gravity_drives)
        pose = self.pose if play == 1.0 else _closed(system(model), self.pose)
        start = Start(pose, jnp.zeros((model.topology.slots, 6)))
        plant, path = follow(model, start, self.step_s, CHUNK - 1, steady(self.record, model))
        still_moving = float(creep_ratio(plant, path)[-3:].min()) > (AT_REST if play == 1.0 else FLOWS)
        far = travel(plant, path) > FREED + 4.0 * float(largest_play(plant))
        return still_moving or far
