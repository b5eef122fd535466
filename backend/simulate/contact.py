"""What a wall answers to a part that reaches it: normal push, its give and rebound, and friction along it.

Push γ and slack s stay positive and keep s γ = κ (primal-dual interior point); the slack is

    s = (g⁺ + e g⁻) / (1 + e) + γ c(ġ) / w,

g⁺ and g⁻ the gaps one step ahead and one step back, e the restitution, w the time that the impulse stands for.  With a
rigid wall this is the scheme of Paoli and Schatzman (2002): a blow at speed v leaves with e v, whatever the masses.
A wall with give c loses the same share in its own way: it loads with stiffness 2 / (1 + e²) and unloads with e² of
that over c (Walton and Braun 1986), so its mean stiffness is 1 / c.

Friction f along the wall is regularised Coulomb's, f = -μ γ u / √(u² + (h ε_v)²), u the sliding of the pin's surface.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.model.contacts import ROUND_TIP, JointContacts

STRIDE = 0.3  # of the room: a part that goes further in a step does not tell at q_k where it will touch
NO_STRIDE = 1e-6  # keeps the slope finite where no stride is left
TOUCHING = 4  # power of (|η| / room)² that tells a part at its wall from one in flight
CREEP = 1e-3  # of the speed of a fall through one mechanism length: slower than this, give has no direction


class Push(NamedTuple):
    """What the walls carry in a step: γ [N s], its slack [m or rad], friction impulse [N s]."""

    normal: Float[Array, "walls"]
    slack: Float[Array, "walls"]
    rub: Float[Array, "walls"]


class Reach(NamedTuple):
    """What a step keeps fixed at the walls."""

    room: Float[Array, "walls"]
    here: Float[Array, "walls 3"]
    """Contact coordinates at q_k."""
    back: Float[Array, "walls"]
    """Gap one step back."""
    deep: Float[Array, "walls"]
    """How deep a part may be in the wall one step ahead: e g⁻, or more where more would give back too much."""
    step_s: Float[Array, ""]
    span_s: Float[Array, ""]
    """From the node before to the node ahead."""
    weight_s: Float[Array, ""]
    stick: Float[Array, "walls"]
    """Sliding per step below which friction holds [m]."""
    creep: Float[Array, ""]
    ease: Float[Array, "walls"]
    """How far the two bodies alone would part for a unit of push in the step [m/(N s)]."""
    stride: Array
    """Share of the room within which a part at its wall is pushed along the normal at q_k; 0: never."""
    restitution: Float[Array, "walls"]
    load: Float[Array, "walls"]
    """Push in the step before, if that limits friction [N s]."""
    lagging: Array
    """Whether it does."""


class Face(NamedTuple):
    """The walls' geometry one step ahead."""

    gap: Float[Array, "walls"]
    outward: Float[Array, "walls 2"]
    """Minus the gap's slope."""
    normal: Float[Array, "walls 2"]
    """Direction of the normal push, outward: where the part touches at q_k, or where it will arrive from flight."""
    bend: Float[Array, "walls 2 2"]
    """Slope of `normal` in η."""
    along: Float[Array, "walls 2"]
    """Direction of friction."""


class Slope(NamedTuple):
    """How normal push and friction follow η: δγ = γ₀ - a·δη, δf = f₀ - b·δη, δs = s₀ + ...; K of the force on η."""

    face: Face
    stiffness: Float[Array, "walls 3 3"]
    a: Float[Array, "walls 3"]
    b: Float[Array, "walls 3"]
    ahead: Float[Array, "walls 3"]
    """Slope of the slack's law in η."""
    give: Float[Array, "walls"]
    """Slope of the slack's law in γ."""
    sliding: Float[Array, "walls"]
    """μ u / √(u² + ..)."""
    room: Float[Array, "walls"]
    """s + γ c."""


def face(
    contacts: JointContacts,
    room: Float[Array, "walls"],
    eta: Float[Array, "walls 3"],
    here: Float[Array, "walls 3"],
    stride: float | Array = STRIDE,
) -> Face:
    """Gap at η and directions of the forces between `here` and η; a circle's gap is zero exactly where |η₁₂| = room.

    A push along the normal at q_k keeps a sliding contact second order in time, as SHAKE does; along the normal ahead
    it would brake it.  A part that is still in flight at q_k tells nothing of where it will touch.
    """
    if not contacts.count:
        none = jnp.zeros((0, 2))
        return Face(jnp.zeros(0), none, none, jnp.zeros((0, 2, 2)), none)
    d, tip = eta[:, :2], ROUND_TIP * room
    outward, length = _radial(contacts, d, tip)
    back = here[:, :2] - d
    reach = (jnp.maximum(stride, NO_STRIDE) * room) ** 2
    near = jnp.clip(jnp.sum(here[:, :2] ** 2, -1) / room**2, 0.0, 1.0) ** TOUCHING
    near = jnp.where(contacts.is_round & (stride > 0.0), near * jnp.exp(-jnp.sum(back * back, -1) / reach), 0.0)
    normal, size = _radial(contacts, d + near[:, None] * back, tip)
    along_d = (1.0 - near)[:, None, None] * jnp.eye(2)
    along_d = along_d + (2.0 * near / reach)[:, None, None] * back[:, :, None] * back[:, None, :]
    across = (jnp.eye(2) - normal[:, :, None] * normal[:, None, :]) / size[:, None, None]
    bend = jnp.sum(across[:, :, :, None] * along_d[:, None, :, :], 2)
    flat_gap = room - jnp.sum(normal * d, -1)
    gap = jnp.where(contacts.is_round, room * jnp.sqrt(1.0 + ROUND_TIP**2) - length, flat_gap)
    bend = jnp.where(contacts.is_round[:, None, None], bend, 0.0)
    return Face(gap, outward, normal, bend, jnp.stack([-normal[:, 1], normal[:, 0]], -1))


def _radial(contacts: JointContacts, d: Float[Array, "walls 2"], tip: Array) -> tuple[Array, Array]:
    """Direction of d, or a flat wall's own, and the length it was divided by."""
    length = jnp.sqrt(jnp.sum(d * d, -1) + jnp.where(contacts.is_round, tip * tip, 1.0))
    return jnp.where(contacts.is_round[:, None], d / length[:, None], contacts.normal), length


def _faced(contacts: JointContacts, reach: Reach, eta: Array) -> Face:
    """Geometry at η; friction that lags keeps its direction too."""
    at = face(contacts, reach.room, eta, reach.here, reach.stride)
    n, _ = _radial(contacts, reach.here[:, :2], ROUND_TIP * reach.room)
    return at._replace(along=jnp.where(reach.lagging, jnp.stack([-n[:, 1], n[:, 0]], -1), at.along))


def gap(contacts: JointContacts, room: Float[Array, "walls"], eta: Float[Array, "walls 3"]) -> Float[Array, "walls"]:
    """Gap at η."""
    return face(contacts, room, eta, eta).gap


def along_path(reach: Reach, push: Push, change: Push, share: float | Array, barrier: Array) -> Push:
    """Push and slack moved along the curve s γ = κ.

    The curve is walked by z = a γ - s (Chen and Mangasarian 1996; a the ease): far from its bend z is the push or
    minus the slack, so that a wall is left or reached in one stride, and neither ever turns negative.
    """
    z = reach.ease * (push.normal + share * change.normal) - (push.slack + share * change.slack)
    return on_path(reach, z, push.rub + share * change.rub, barrier)


def on_path(reach: Reach, z: Float[Array, "walls"], rub: Float[Array, "walls"], barrier: Array) -> Push:
    """Push and slack whose product is the barrier."""
    root = jnp.sqrt(z * z + 4.0 * reach.ease * barrier)
    larger = 0.5 * (jnp.abs(z) + root)
    smaller = reach.ease * barrier / larger
    pushed, slack = jnp.where(z > 0.0, larger, smaller), jnp.where(z > 0.0, smaller, larger)
    return Push(pushed / reach.ease, slack, rub)


def force(contacts: JointContacts, at: Face, push: Push) -> Float[Array, "walls 3"]:
    """Impulse on the contact coordinates."""
    planar = -push.normal[:, None] * at.normal
    if not contacts.rubs:
        return jnp.concatenate([planar, jnp.zeros_like(planar[:, :1])], -1)
    planar = planar + push.rub[:, None] * at.along
    return jnp.concatenate([planar, push.rub[:, None]], -1)


def residual(contacts: JointContacts, reach: Reach, eta: Array, push: Push, barrier: Array) -> tuple[Push, Array]:
    """How far gap, complementarity and friction are from their laws, and the impulse on η."""
    at = _faced(contacts, reach, eta)
    gap, _, give, _ = _slack(contacts, reach, at, push)
    open_by = gap + give * push.normal - push.slack
    rub = push.rub
    if contacts.rubs:
        u, _, rounded = _sliding(reach, at, eta)
        rub = push.rub + _limit(contacts, reach, push) * u / rounded
    return Push(open_by, push.slack * push.normal - barrier, rub), force(contacts, at, push)


def slid(contacts: JointContacts, reach: Reach, push: Push, off: Float[Array, "walls"]) -> Float[Array, "walls"]:
    """By how much the sliding would have to differ for friction to be off by a residual [m].

    A part that sticks pins the sliding down to a share of ε_v h long before friction's residual shows it.
    """
    limit = _limit(contacts, reach, push)
    some = jnp.where(limit > 0.0, limit, 1.0)
    mobilised = jnp.minimum(jnp.abs(push.rub - off) / some, 1.0 - 1e-12)
    return jnp.where(limit > 0.0, jnp.abs(off) / some * reach.stick / jnp.sqrt(1.0 - mobilised**2), 0.0)


def slope(contacts: JointContacts, reach: Reach, eta: Array, push: Push) -> Slope:
    """Slope of the laws at a point; friction's is the primal-dual one of Chan, Golub and Mulet (1999)."""
    at = _faced(contacts, reach, eta)
    _, closing, give, give_slope = _slack(contacts, reach, at, push)
    gamma, s = push.normal, push.slack
    weight = -1.0 / (1.0 + reach.restitution)
    ahead = (weight + gamma * give_slope * closing)[:, None] * at.outward
    ahead = jnp.concatenate([ahead, jnp.zeros_like(ahead[:, :1])], -1)
    room = s + gamma * give
    a = (gamma / room)[:, None] * ahead
    normal = jnp.concatenate([at.normal, jnp.zeros_like(a[:, :1])], -1)
    bend = gamma[:, None, None] * at.bend
    stiffness = -normal[:, :, None] * a[:, None, :]
    zero = jnp.zeros_like(gamma)
    b, sliding = jnp.zeros_like(a), zero
    if contacts.rubs:
        u, d, rounded = _sliding(reach, at, eta)
        limit = _limit(contacts, reach, push)
        rub = jnp.clip(push.rub, -limit, limit)
        turned = jnp.where(reach.lagging, 0.0, 1.0) * jnp.stack(
            [at.bend[:, 1], -at.bend[:, 0]], 1
        )  # d along / d η = (-bend₂, bend₁), so -turned
        slip = at.along - jnp.sum(turned * d[:, :, None], 1)
        slip = jnp.concatenate([slip, jnp.ones_like(slip[:, :1])], -1)
        sliding = jnp.where(reach.lagging, 0.0, contacts.friction) * u / rounded
        b = ((limit + rub * u / rounded) / rounded)[:, None] * slip - sliding[:, None] * a
        along = jnp.concatenate([at.along, jnp.ones_like(slip[:, :1])], -1)
        stiffness = stiffness + along[:, :, None] * b[:, None, :]
        bend = bend + push.rub[:, None, None] * turned
    stiffness = stiffness.at[:, :2, :2].add(bend)
    return Slope(at, stiffness, a, b, ahead, give, sliding, room)


def offset(contacts: JointContacts, at: Slope, push: Push, wanted: Push) -> tuple[Push, Array]:
    """Change of push and friction at fixed η that cancels residuals `wanted`, and of the impulse on η."""
    gamma = -(wanted.slack + push.normal * wanted.normal) / at.room
    rub = -wanted.rub - at.sliding * gamma if contacts.rubs else jnp.zeros_like(gamma)
    change = Push(gamma, wanted.normal + at.give * gamma, rub)
    return change, force(contacts, at.face, change)


def respond(contacts: JointContacts, at: Slope, deta: Float[Array, "walls 3"]) -> Push:
    """Change of push, slack and friction that a motion of η brings."""
    gamma = -jnp.sum(at.a * deta, -1)
    slack = jnp.sum(at.ahead * deta, -1) + at.give * gamma
    return Push(gamma, slack, -jnp.sum(at.b * deta, -1))


def _limit(contacts: JointContacts, reach: Reach, push: Push) -> Float[Array, "walls"]:
    """Largest friction impulse."""
    return contacts.friction * jnp.where(reach.lagging, reach.load, push.normal)


def _slack(contacts: JointContacts, reach: Reach, at: Face, push: Push) -> tuple[Array, Array, Array, Array]:
    """Weighted gap, d(closing speed)/d(η along the normal), give per impulse, and its slope in the closing speed."""
    e = reach.restitution
    gap = (at.gap + reach.deep) / (1.0 + e)
    closing = (reach.back - at.gap) / reach.span_s
    sharp = jnp.sqrt(closing**2 + reach.creep**2)
    lost = (1.0 - e * e) / (1.0 + e * e)
    stiff = 1.0 + lost * closing / sharp
    stiff_slope = lost * (reach.creep / sharp) ** 2 / sharp
    give = contacts.give / (reach.weight_s * stiff)
    return gap, 1.0 / reach.span_s, give, -give * stiff_slope / stiff


def _sliding(reach: Reach, at: Face, eta: Array) -> tuple[Array, Array, Array]:
    """Sliding u of the surfaces, displacement of η₁₂, and √(u² + (h ε_v)²)."""
    moved = eta - reach.here
    d = moved[:, :2]
    u = jnp.sum(at.along * d, -1) + moved[:, 2]
    return u, d, jnp.sqrt(u * u + reach.stick**2)
