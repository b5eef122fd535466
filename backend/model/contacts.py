"""Contacts inside joints: pins in loose holes and ends of travel, as one table of walls.

Contact coordinates of a joint are η = P y: two offsets in the plane of the hole [m] (or the coordinate itself at a
stop), and the pin's surface travel, radius x turn [m].  A round wall keeps |η₁₂| within `room`, a flat one keeps
n·η₁₂ within it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from backend.effects.shapes import AbstractJointClearance, AbstractJointStop, Wall
from backend.joints.joint import TURN
from backend.model.incidence import gathered
from backend.model.placed import Placed

ROUND_TIP = 3e-3  # of the room: keeps the direction of a centred pin finite; the wall itself stays where it is
SMALLEST_ROOM = 1e-6  # m: play below this is solved as this much, which no pin shows
X, Y, TILT_X, TILT_Y = 0, 1, 3, 4


class JointContacts(eqx.Module):
    """Every wall inside a joint; one row each."""

    joints: tuple[int, ...] = eqx.field(static=True)
    round: tuple[bool, ...] = eqx.field(static=True)
    """Whether the wall is a circle around the hole's centre."""
    travels: tuple[bool, ...] = eqx.field(static=True)
    """Whether the wall is an end of travel, which `room` counts from q = 0."""
    rubs: bool = eqx.field(static=True)
    """Whether any wall has friction."""
    loose: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Rows of each joint that play frees, though the kind of joint holds them."""
    selection: Float[Array, "walls 3 6"]
    """P."""
    normal: Float[Array, "walls 2"]
    """Outward direction of a flat wall; unused for a round one."""
    room: Float[Array, "walls"]
    friction: Float[Array, "walls"]
    give: Float[Array, "walls"]
    """1 / stiffness [m/N]; 0 is rigid."""
    restitution: Float[Array, "walls"]

    @property
    def count(self) -> int:
        """Number of walls."""
        return len(self.joints)

    @property
    def at(self) -> np.ndarray:
        """(walls,) joint of each wall."""
        return np.array(self.joints, dtype=int)

    @property
    def is_round(self) -> Bool[np.ndarray, "walls"]:
        """`round` as an array."""
        return np.array(self.round, dtype=bool)

    @property
    def sides(self) -> np.ndarray:
        """(joints, k) table of the walls of each joint, filled up with `count`."""
        members = [[wall for wall, at in enumerate(self.joints) if at == joint] for joint in range(len(self.loose))]
        deepest = max([1, *map(len, members)])
        return np.array([row + [self.count] * (deepest - len(row)) for row in members], dtype=int).reshape(-1, deepest)

    def on_joints(self, values: Array) -> Array:
        """Sum one array per wall over the walls of each joint."""
        return gathered(values, self.sides)


def joint_contacts(
    clearances: list[Placed],
    stops: list[Placed],
    coordinate: list[int | None],
    driven: tuple[int, ...],
    pin_radius: Float[Array, "joints"],
) -> JointContacts:
    """The walls of all clearances and stops; a driven joint has no stop.

    Raises ValueError where two clearances act at one joint.
    """
    loose: dict[int, tuple[int, ...]] = {}
    walls: list[_Wall] = []
    for placed in clearances:
        for place, joint in enumerate(placed.at()):
            if joint in loose:
                raise ValueError("two clearances act at one joint; keep one of them")
            loose[joint] = (X, Y, TILT_X, TILT_Y) if _one(placed, place).rings == 2 else (X, Y)
            walls += _hole(_one(placed, place), joint, pin_radius[joint])
    ends: dict[int, list[AbstractJointStop]] = {}
    for placed in stops:
        for place, joint in enumerate(placed.at()):
            if joint not in driven:
                ends.setdefault(int(joint), []).append(_one(placed, place))
    for joint, members in sorted(ends.items()):
        walls += _ends(members, joint, coordinate[joint])
    return JointContacts(
        joints=tuple(w.joint for w in walls),
        round=tuple(w.round for w in walls),
        travels=tuple(w.travels for w in walls),
        rubs=bool(clearances),
        loose=tuple(loose.get(joint, ()) for joint in range(len(coordinate))),
        selection=_stack([w.selection for w in walls], (3, 6)),
        normal=_stack([w.normal for w in walls], (2,)),
        room=_stack([w.room for w in walls], ()),
        friction=_stack([w.law.friction for w in walls], ()),
        give=_stack([w.law.give for w in walls], ()),
        restitution=_stack([w.law.restitution for w in walls], ()),
    )


class _Wall(eqx.Module):
    joint: int
    round: bool
    travels: bool
    selection: Array
    normal: Array
    room: Array
    law: Wall


def _hole(clearance: AbstractJointClearance, joint: int, pin_radius: Array) -> list[_Wall]:
    """One circle, or four flat walls, per ring of a bearing."""
    joint = int(joint)
    half = 0.5 * clearance.bearing_length()
    room = jnp.maximum(clearance.radius(), SMALLEST_ROOM)
    law = clearance.wall()
    walls = []
    for height in (-half, half) if clearance.rings == 2 else (jnp.zeros(()),):
        selection = jnp.zeros((3, 6)).at[0, X].set(1.0).at[1, Y].set(1.0)
        selection = selection.at[0, TILT_X].set(height).at[1, TILT_Y].set(height).at[2, TURN].set(pin_radius)
        if clearance.shape == "circle":
            walls.append(_Wall(joint, True, False, selection, jnp.zeros(2), room, law))
            continue
        for normal in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
            walls.append(_Wall(joint, False, False, selection, jnp.array(normal), room, law))
    return walls


def _ends(stops: list[AbstractJointStop], joint: int, row: int | None) -> list[_Wall]:
    """The tightest lower and upper end of the stops at one joint."""
    pairs = [stop.ends() for stop in stops]
    lower, upper = jnp.stack([low for low, _ in pairs]), jnp.stack([high for _, high in pairs])
    selection = jnp.zeros((3, 6)).at[0, TURN if row is None else row].set(1.0)
    made = []
    for sign, end, which in ((-1.0, jnp.max(lower), jnp.argmax(lower)), (1.0, jnp.min(upper), jnp.argmin(upper))):
        walls = [stop.wall() for stop in stops]
        law = jax.tree.map(lambda *leaves, w=which: jnp.stack(leaves)[w], *walls)
        made.append(_Wall(joint, False, True, selection, jnp.array([sign, 0.0]), sign * end, law))
    return made


def _one(placed: Placed, place: int):
    """The effect at one place of its batch."""
    row = placed.rows[place]
    return jax.tree.map(lambda leaf: leaf[row], placed.effect)


def _stack(values: list[Array], shape: tuple[int, ...]) -> Array:
    return jnp.stack([jnp.asarray(v, dtype=float) for v in values]) if values else jnp.zeros((0, *shape))
