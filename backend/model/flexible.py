"""Links that bend: a drawing in which each of them is two halves on a hinge at its centre of mass.

The first half keeps the link's id, the other is `ID:far`, the hinge `ID:section`.  Both keep the link's own axes and
origin, so that points drawn on the link stay where they were.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from backend.effects.catalogue import effect_of_kind
from backend.effects.shapes import AbstractDrag, AbstractSection
from backend.mechanism.body import Body, Inertia, Inertial
from backend.mechanism.effect import Effect
from backend.mechanism.joint import Joint
from backend.mechanism.kinds import effect_kinds
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.pose import Frame, Pose
from backend.model.lengthwise import held_points, length_axis

FAR, SECTION = ":far", ":section"
TURNS_ABOUT_Z = ("revolute", "cylindrical", "planar")
COMMON = 1e-3  # rad by which the axes of a link's joints may differ and still be one direction
POINTS = {"anchor_a_m": 0, "anchor_b_m": 1, "point_m": 0}  # parameters that are points of the effect's nth body
LUMP = 0.75  # share of the mass's spread along the link that the halves' distance makes: a uniform bar's
FLAT = 1e-9  # of the inertia: second moment across a plate without thickness, which rounding may turn negative


class Cut(NamedTuple):
    """Where and how a link is cut, in body axes."""

    center: Float[np.ndarray, "3"]
    along: Float[np.ndarray, "3"]
    """Unit vector from the first half to the far one."""
    axis: Float[np.ndarray, "3"]
    """Unit axis of the hinge."""

    def beyond(self, p_BP: Sequence[float]) -> bool:
        """Whether a point of the link belongs to the far half."""
        return bool((np.asarray(p_BP) - self.center) @ self.along > 0.0)


def split(mechanism: Mechanism, effects: Sequence[Effect] = ()) -> Mechanism:
    """The drawing, with further effects beside those drawn, whose flexible links are cut in two.

    Mass, centre of mass and inertia of a straight link are those drawn, exactly.  A drawing without flexible links
    comes back with its effects alone changed, one that is cut already as it is.  Raises ValueError naming the link
    that cannot be cut, and why.
    """
    drawn = [*mechanism.effects, *effects]
    sections = [e for e in drawn if issubclass(effect_of_kind(e.kind), AbstractSection)]
    if not sections:
        return mechanism.model_copy(update={"effects": tuple(drawn)})
    cuts: dict[str, Cut] = {}
    joints = [j.id for j in mechanism.joints]
    for effect in sections:
        for id_ in _bodies_of(effect, mechanism):
            if id_ + SECTION in joints and mechanism.joint(id_ + SECTION).body_b == id_ + FAR:
                continue  # cut before
            if id_ in cuts:
                raise ValueError(f"effect '{effect.id}': body '{id_}' bends already; one section per link, remove one")
            cuts[id_] = _cut(effect, id_, mechanism)
    halves = [half for b in mechanism.bodies for half in (_halves(b, cuts[b.id]) if b.id in cuts else [b])]
    hinges = [_hinge(id_, cut) for id_, cut in cuts.items()]
    for what, ids in (("body", [b.id for b in halves]), ("joint", [j.id for j in (*mechanism.joints, *hinges)])):
        for id_ in {i for i in ids if ids.count(i) > 1}:
            raise ValueError(f"{what} id '{id_}' is needed for a link that bends; rename the {what} drawn so")
    return mechanism.model_copy(
        update={
            "bodies": tuple(halves),
            "joints": (*(_rehung(j, cuts) for j in mechanism.joints), *hinges),
            "markers": tuple(
                m.model_copy(update={"body": _half(m.body, m.position_m, cuts)}) for m in mechanism.markers
            ),
            "effects": tuple(_moved(e, mechanism, cuts) for e in drawn),
        }
    )


def whole(half: str) -> str:
    """The link that a half (or a hinge) belongs to."""
    return half.removesuffix(FAR).removesuffix(SECTION)


def _bodies_of(effect: Effect, mechanism: Mechanism) -> list[str]:
    return [b.id for b in mechanism.bodies if not b.fixed] if effect.on == "all" else list(effect.on)


def _cut(effect: Effect, id_: str, mechanism: Mechanism) -> Cut:
    body = mechanism.body(id_)
    if body.fixed or body.inertial is None:
        raise ValueError(f"effect '{effect.id}': body '{id_}' is fixed and cannot bend; name a body that moves")
    given = np.asarray(effect.parameters.get("axis", (0.0, 0.0, 0.0)), float)
    axis = given if given.any() else _joint_axis(effect, id_, mechanism)
    along = length_axis(held_points(mechanism)[id_])
    return Cut(np.array(body.inertial.center_of_mass_m), along, axis / np.linalg.norm(axis))


def _joint_axis(effect: Effect, id_: str, mechanism: Mechanism) -> np.ndarray:
    """The direction that the link's turning joints share."""
    sides = [(j, f) for j in mechanism.joints for b, f in ((j.body_a, j.frame_a), (j.body_b, j.frame_b)) if b == id_]
    axes = [(j.id, f.rotation()[:, 2]) for j, f in sides if j.type in TURNS_ABOUT_Z]
    remedy = "give `axis`, in the body's axes"
    if not axes:
        raise ValueError(f"effect '{effect.id}': no joint of '{id_}' turns about an axis to bend about; {remedy}")
    for joint, axis in axes[1:]:
        apart = float(np.arcsin(min(1.0, float(np.linalg.norm(np.cross(axis, axes[0][1]))))))
        if apart > COMMON:
            raise ValueError(
                f"effect '{effect.id}': joints '{axes[0][0]}' and '{joint}' of '{id_}' turn about axes "
                f"{np.degrees(apart):.3g} degrees apart; {remedy}"
            )
    return axes[0][1]


def _halves(body: Body, cut: Cut) -> list[Body]:
    """Halves of m/2 at ±a from the centre: E = 2 E_half + m a² u uᵀ, with E the second moment of the mass about it.

    m a² = ¾ / (uᵀ E⁻¹ u): for a bar along u that is m (L/4)², and no body asks for an impossible half.
    """
    inertial = body.moving_inertial()
    J, m, u = inertial.inertia_kg_m2.matrix(), inertial.mass_kg, cut.along
    spread, axes = np.linalg.eigh(0.5 * np.trace(J) * np.eye(3) - J)
    spread = np.maximum(spread, FLAT * np.trace(J))
    a = np.sqrt(LUMP / (m * np.sum((u @ axes) ** 2 / spread)))
    half = 0.5 * (J - m * a**2 * (np.eye(3) - np.outer(u, u)))
    names = "xx", "yy", "zz", "xy", "xz", "yz"
    inertia = Inertia(**{n: float(half["xyz".index(n[0]), "xyz".index(n[1])]) for n in names})

    def at(offset: float) -> Inertial:
        x, y, z = (float(c) for c in cut.center + offset * u)
        return Inertial(mass_kg=0.5 * m, center_of_mass_m=(x, y, z), inertia_kg_m2=inertia)

    first = body.model_copy(update={"inertial": at(-a)})
    return [first, Body(id=body.id + FAR, pose=Pose(**body.pose.model_dump()), inertial=at(a))]


def _hinge(id_: str, cut: Cut) -> Joint:
    x, y, z = (float(c) for c in cut.center)
    frame = Frame(position_m=(x, y, z), quaternion_wxyz=_towards(cut.axis))
    return Joint(id=id_ + SECTION, type="revolute", body_a=id_, body_b=id_ + FAR, frame_a=frame, frame_b=frame)


def _towards(axis: np.ndarray) -> tuple[float, float, float, float]:
    """The shortest turn that takes z to a unit axis."""
    turn = np.array([1.0 + axis[2], -axis[1], axis[0], 0.0])
    turn = turn if turn[0] > 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])
    w, x, y, z = (float(c) for c in turn / np.linalg.norm(turn))
    return w, x, y, z


def _half(id_: str, p_BP: Sequence[float], cuts: dict[str, Cut]) -> str:
    """The half that carries a point of a body; the body itself where it does not bend."""
    return id_ + FAR if id_ in cuts and cuts[id_].beyond(p_BP) else id_


def _rehung(joint: Joint, cuts: dict[str, Cut]) -> Joint:
    a = _half(joint.body_a, joint.frame_a.position_m, cuts)
    b = _half(joint.body_b, joint.frame_b.position_m, cuts)
    return joint.model_copy(update={"body_a": a, "body_b": b})


def _moved(effect: Effect, mechanism: Mechanism, cuts: dict[str, Cut]) -> Effect:
    """The effect on the parts that take its place."""
    type_, on = effect_of_kind(effect.kind), effect.on
    if type_.acts_on == "joint" and on == "all":
        # Spelled out, or it would act at the hinges inside links too.
        kind = effect_kinds()[effect.kind]
        on = tuple(j.id for j in mechanism.joints if kind.suits(j.type))
    elif type_.acts_on == "bodies" and set(on) & set(cuts):
        on = _held_at(effect, mechanism, cuts)
    elif issubclass(type_, AbstractSection):
        on = tuple(_bodies_of(effect, mechanism))
    elif type_.acts_on == "body":
        bodies = _bodies_of(effect, mechanism)
        bent = [b for b in bodies if b in cuts]
        if bent and not (effect.kind in ("mass_error", "length_error") or issubclass(type_, AbstractDrag)):
            raise ValueError(
                f"effect '{effect.id}': {effect.kind} cannot act on '{bent[0]}', which bends and is computed as two "
                "halves; let one of the two effects go"
            )
        on = tuple(half for b in bodies for half in ([b, b + FAR] if b in cuts else [b]))
    return effect.model_copy(update={"on": on})


def _held_at(effect: Effect, mechanism: Mechanism, cuts: dict[str, Cut]) -> tuple[str, ...]:
    """The halves that carry the effect's points; a torque, which has none, stays with the first half."""
    where: dict[int, Any] = {}
    for name, spec in effect_kinds()[effect.kind].parameters.items():
        if name in POINTS:
            where[POINTS[name]] = np.broadcast_to(np.asarray(effect.parameters.get(name, spec.default), float), 3)
        elif spec.size == 3 and spec.unit == "m":
            raise ValueError(
                f"effect '{effect.id}': {effect.kind} cannot act on '{(set(effect.on) & set(cuts)).pop()}', which "
                "bends: it spans both halves; let one of the two effects go"
            )
    if 0 in where and 1 not in where and len(effect.on) == 2:  # both bodies are held at one point of space
        first, second = (mechanism.body(id_).pose for id_ in effect.on)
        where[1] = second.rotation().T @ (first.place(where[0]) - np.array(second.position_m))
    return tuple(_half(id_, where[i], cuts) if i in where else id_ for i, id_ in enumerate(effect.on))
