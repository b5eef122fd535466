"""Which parameters a fit may change: `KIND:ON[.PARAMETER]`, read against a drawing.

ON is an id (a joint, a body, a drawn effect, `world`, `camera`), `*` for every applicable place with a value of its
own, `all` for one value shared by all of them, `all-a+b` by all but those, `a+b` for one shared by those. PARAMETER may
be left out: every parameter of the kind that suits the place is freed. Of a parameter of several numbers each is freed
by itself, as PARAMETER[0], and those that a planar mechanism cannot show are left out unless they are named. An effect
that the drawing lacks is added at its declared defaults, which mean "absent".
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from backend.mechanism.apart import at_each_place, is_mixed, set_apart
from backend.mechanism.constraints import drawn
from backend.mechanism.drawing_error import known
from backend.mechanism.effect import Effect, ParameterValue, kind_named
from backend.mechanism.found_contacts import contacts_declared
from backend.mechanism.joint import WITHOUT_COORDINATE, Joint
from backend.mechanism.kinds import EffectKind, ParameterSpec
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.mobility import joint_axes, plane_normal
from backend.mechanism.study import Tolerance

Address = tuple[str, str]
SMALL_PLAY_M = 1e-4  # where a fit begins to look for play that the drawing does not mention
SMALL_BEND_RAD = 1e-2  # by which a link's own weight at half its length bends it where a fit begins to look for bending
GRAVITY_M_PER_S2 = 9.80665
ALONG = 1 - 1e-6  # cosine above which a component is out of the plane of motion
GRAMMAR = "Write KIND:ON or KIND:ON.PARAMETER, such as viscous_friction:j1 or coulomb_friction:*"


@dataclass(frozen=True)
class FreeParameter:
    """One number of a fit, and every (effect id, parameter) of the model that takes it.

    prior_sd: standard deviation of its tolerance about `start`, None without one. nuisance: freed by a tolerance,
    not by the caller.
    """

    kind: str
    on: tuple[str, ...]
    label: str
    parameter: str
    unit: str
    lower: float
    upper: float
    start: float
    addresses: tuple[Address, ...]
    prior_sd: float | None = None
    nuisance: bool = False

    @property
    def name(self) -> str:
        """`kind:label.parameter`, unique in a fit."""
        return f"{self.kind}:{self.label}.{self.parameter}"


@dataclass(frozen=True)
class Freedom:
    """The free parameters of a fit and the effects that the model needs beside those drawn."""

    parameters: tuple[FreeParameter, ...]
    added: tuple[Effect, ...]


def free_parameters(
    mechanism: Mechanism,
    specs: Iterable[str],
    tolerances: Sequence[Tolerance] = (),
    option: str = "--free",
    recorded: Set[str] = frozenset(),
) -> Freedom:
    """Read specs (each may hold several, comma separated) and tolerances; ValueError with the remedy otherwise.

    option: what the specs were given as, for the sentences.  recorded: drawn effects whose value is on record; what is
    free at a joint or body of one is an effect of its own beside it.
    """
    # Where a model of the drawing as it is has one effect a joint, so that addresses are those of its model.
    whole = {e.id for e in mechanism.effects if not (_from_fits(kind_named(e.kind), e) or is_mixed(mechanism, e))}
    others = {one.id for e in mechanism.effects if e.id in recorded for one in (e, *at_each_place(mechanism, e))}
    reader = _Reader(contacts_declared(set_apart(mechanism, whole)), option, others)
    found: dict[str, FreeParameter] = {}
    for spec in (s.strip() for given in specs for s in given.split(",")):
        if spec:
            for parameter in reader.read(spec):
                found.setdefault(parameter.name, parameter)
    for tolerance in tolerances:
        for place in reader.places(kind_named(tolerance.kind), tolerance.on, tolerance.kind):
            for parameter in reader.at(kind_named(tolerance.kind), (place,), place, None):
                already = found.get(parameter.name)
                kept = already or replace(parameter, nuisance=True)
                found[parameter.name] = replace(kept, prior_sd=tolerance.sd)
    taken: dict[Address, str] = {}
    for parameter in found.values():
        for address in parameter.addresses:
            if address in taken:
                raise ValueError(f"{parameter.name} and {taken[address]} are the same number. Free one of the two.")
            taken[address] = parameter.name
    return Freedom(tuple(found.values()), tuple(reader.added.values()))


class _Reader:
    def __init__(self, mechanism: Mechanism, option: str, others: Set[str]):
        self.mechanism = mechanism
        self.option = option
        self.others = others
        self.added: dict[str, Effect] = {}

    def read(self, spec: str) -> list[FreeParameter]:
        kind_name, colon, rest = spec.partition(":")
        try:
            kind = kind_named(kind_name)
        except ValueError as error:
            raise ValueError(f"{self.option} {spec}: {str(error).rstrip('.')}. {GRAMMAR}.") from None
        if not colon and kind.acts_on in ("world", "camera"):
            rest = kind.acts_on
        on, parameter = self._split(rest, kind)
        if not on:
            raise ValueError(f"{self.option} {spec}: no place is named. {GRAMMAR}.")
        try:
            if on == "*":
                places = self.everywhere(kind, parameter, spec)
                return [p for place in places for p in self.at(kind, (place,), place, parameter)]
            if on == "all" or (on.startswith("all-") and not self._is_id(on)):
                return self.at(kind, self.everywhere(kind, parameter, spec, on[4:]), on, parameter)
            named = on.split("+")
            # Of an effect on joints of both kinds, those that have what is named.
            places = [p for p in self.places(kind, tuple(named), spec) if p in named or self._has(kind, p, parameter)]
            return self.at(kind, tuple(places) or tuple(named), on, parameter)
        except ValueError as error:
            raise ValueError(f"{self.option} {spec}: {error}") from None

    def _split(self, rest: str, kind: EffectKind) -> tuple[str, str | None]:
        """ON and PARAMETER; an id may hold dots, so only a known parameter name is split off."""
        on, dot, last = rest.rpartition(".")
        if dot and (last.partition("[")[0] in kind.parameters or not self._is_place(rest)):
            return on, last
        return rest, None

    def _is_place(self, text: str) -> bool:
        return all(
            self._is_id(part) or part in ("world", "camera", "*", "all")
            for part in text.removeprefix("all-").split("+")
        )

    def _is_id(self, text: str) -> bool:
        m = self.mechanism
        named = any(p.id == text for group in (m.joints, m.bodies, m.effects, m.markers) for p in group)
        return named or any(e.id.startswith(f"{text}@") for e in m.effects)

    def _parts(self, kind: EffectKind, id: str) -> list[str]:
        """The effects that one drawn at several places was set apart into, or the id itself; of a spring that a kind
        amends likewise.
        """
        able = (kind.name, *kind.amends)
        parts = [e.id for e in self.mechanism.effects if e.kind in able and e.id.startswith(f"{id}@")]
        return parts or [id]

    def everywhere(self, kind: EffectKind, parameter: str | None, spec: str, but: str = "") -> tuple[str, ...]:
        """All places of a kind that have the parameter, without those named `a+b`."""
        out = self.places(kind, tuple(but.split("+")), spec) if but else ()
        places = [
            p for p in self.places(kind, "all", spec)
            if p not in out and ((drawn := self._standing(kind, p)) is None or drawn.id not in out)
        ]  # fmt: skip
        having = tuple(p for p in places if self._has(kind, p, parameter))
        return having or tuple(places)  # where none has it, the first one says what there is

    def places(self, kind: EffectKind, on: tuple[str, ...] | str, spec: str) -> tuple[str, ...]:
        """Ids where a kind may act; drawn effects of a kind that joins two bodies. What stands still, and one marker of
        a picture, only by name.
        """
        m = self.mechanism
        drawn = [e.id for e in m.effects if e.kind == kind.name]
        if kind.acts_on in ("world", "camera"):
            able = not kind.names_joints or self._first_joint() is not None
            candidates = [kind.acts_on] if able else []
        elif kind.name == "prescribed_motion":
            # Only where it is drawn: no value of it means "absent", and added it would hold a free joint still.
            motions = [e for e in m.effects if e.kind == kind.name]
            candidates = [e.on[0] if e.on != "all" and len(e.on) == 1 else e.id for e in motions]
        elif kind.acts_on == "joint":
            candidates = [j.id for j in m.joints if any(s.suits(j.type) for s in kind.parameters.values())]
            candidates = [c for c in candidates if m.joint(c).type != "fixed"]
            if kind.name == "pin_friction":
                candidates = [c for c in candidates if (f := m.joint(c).fit) and f.pin_diameter_m]
        elif kind.acts_on == "body":
            candidates = [b.id for b in m.bodies if not b.fixed]
        elif kind.acts_on == "marker":
            candidates = [marker.id for marker in m.markers]
        elif kind.acts_on == "effect":
            candidates = [e.id for e in m.effects if e.kind in kind.amends]
        else:
            candidates = drawn
        if on == "all":
            if not candidates:
                raise ValueError(f"{kind.name} applies nowhere in '{m.name}'; draw it, or what it acts on, first")
            return tuple(candidates)
        if kind.acts_on == "world" and kind.names_joints:
            drawn += [j.id for j in m.joints if kind.suits(j.type)]
        on = tuple(part for id in on for part in self._parts(kind, id))
        if kind.acts_on == "body":  # the pins of a base plate may stand elsewhere than drawn
            drawn += [b.id for b in m.bodies if b.fixed]
        if kind.acts_on == "camera":  # one marker may be seen otherwise than the rest
            drawn += [marker.id for marker in m.markers]
        for place in on:
            if place not in candidates and place not in drawn:
                raise ValueError(f"{kind.name} does not act at '{place}'. {known([*candidates, *drawn])}")
        return tuple(on)

    def at(self, kind: EffectKind, places: tuple[str, ...], label: str, parameter: str | None) -> list[FreeParameter]:
        """One free parameter per parameter name, shared by the places."""
        takers: dict[str, dict[str, Address]] = {}
        for place in places:
            for name in self._names(kind, place, parameter):
                takers.setdefault(name, {})[place] = (self._effect(kind, place).id, name)
        parts = all(place.startswith(f"{label}@") for place in places)  # of one effect, by whose id they go
        return [
            self._parameter(
                kind,
                [label] if parts else list(at),
                label,
                kind.parameters[name.partition("[")[0]],
                name,
                list(at.values()),
            )
            for name, at in takers.items()
        ]

    def _names(self, kind: EffectKind, place: str, parameter: str | None) -> list[str]:
        """The numbers of a kind's parameters that are free at a place."""
        able = [s for s in self._suited(kind, place) if not (s.size > 1 and s.unit == "1")]
        if parameter is None:
            return [name for s in able if not s.by_name for name in self._numbers(kind, s, place)]
        whole = next((s for s in able if s.name == parameter), None)
        every = [name for s in able for name in components(s)]
        if whole is None and parameter not in every:
            directed = parameter.partition("[")[0] in kind.parameters and parameter not in every
            what = "is a direction, or not one of its numbers, and" if directed else "is unknown there and"
            raise ValueError(f"parameter '{parameter}' {what} cannot be freed. {known(every)}")
        return self._numbers(kind, whole, place) if whole else [parameter]

    def _numbers(self, kind: EffectKind, spec: ParameterSpec, place: str) -> list[str]:
        """A parameter's own name, or its components that a planar mechanism can show."""
        names, axis = components(spec), self._across(kind, place)
        if spec.size != 3 or axis is None:
            return names
        return [name for name, along in zip(names, np.abs(axis), strict=True) if along < ALONG]

    def _across(self, kind: EffectKind, place: str) -> np.ndarray | None:
        """Normal of the plane of motion in the axes of a body, or of the world; None without such a plane."""
        m = self.mechanism
        bodies = {b.id: b.pose.rotation() for b in m.bodies}
        normal = plane_normal(list(m.joints), joint_axes(m, list(m.joints), drawn(m)))
        if normal is None or kind.acts_on == "world":
            return normal
        return bodies[place].T @ normal if kind.acts_on == "body" and place in bodies else None

    def _has(self, kind: EffectKind, place: str, parameter: str | None) -> bool:
        """Whether a parameter means something there; None: whatever does."""
        return parameter is None or any(s.name == parameter.partition("[")[0] for s in self._suited(kind, place))

    def _suited(self, kind: EffectKind, place: str) -> list[ParameterSpec]:
        joint = None
        if kind.names_joints:  # a body or a marker may have a joint's name
            drawn = next((e for e in self.mechanism.effects if e.id == place and e.kind == kind.name), None)
            at = drawn.on[0] if drawn and drawn.on != "all" else place
            joint = next((j for j in self.mechanism.joints if j.id == at), None)
            joint = self._first_joint() if joint is None and place == "world" else joint
        return [s for s in kind.parameters.values() if joint is None or s.suits(joint.type)]

    def _first_joint(self) -> Joint | None:
        """The joint that a push on the world gives its speed to: the first that moves by itself."""
        m = self.mechanism
        motions = [e.on for e in m.effects if e.kind == "prescribed_motion"]
        if "all" in motions:
            return None
        driven = {id_ for on in motions for id_ in on}
        fixed = {b.id for b in m.bodies if b.fixed}
        moving = (j for j in m.joints if j.type not in WITHOUT_COORDINATE and not {j.body_a, j.body_b} <= fixed)
        return next((j for j in moving if j.id not in driven), None)

    def _effect(self, kind: EffectKind, place: str) -> Effect:
        """The drawn effect that is, or acts at exactly, this place; otherwise a new one that does nothing yet."""
        if drawn := self._standing(kind, place):
            return drawn
        key = f"{kind.name}@{place}"
        if any(e.id.startswith(f"{kind.name}@") for e in self.mechanism.effects):
            key = f"added {key}"  # else it would pass for one of the places of a drawn effect of that name
        return self.added.setdefault(
            key, Effect(id=key, kind=kind.name, on=(place,), parameters=self._drawn(kind, place))
        )

    def _standing(self, kind: EffectKind, place: str) -> Effect | None:
        for effect in self.mechanism.effects:
            there = tuple(effect.on) == (place,) and effect.id not in self.others
            if effect.kind == kind.name and (effect.id == place or there):
                return effect
        return None

    def _drawn(self, kind: EffectKind, place: str) -> dict[str, ParameterValue]:
        """What the place itself says about the parameters of a new effect."""
        if kind.name == "link_flexibility":
            return {"stiffness_n_m_per_rad": self._limp(place)}
        joint = next((j for j in self.mechanism.joints if j.id == place), None)
        wanted = [(spec.name, spec.drawn) for spec in kind.parameters.values() if spec.drawn]
        values = {name: getattr(joint.fit, method)() if joint and joint.fit else None for name, method in wanted}
        return {name: SMALL_PLAY_M if value is None else value for name, value in values.items()}

    def _limp(self, place: str) -> float:
        """Stiffness of a link that bends a little [N m/rad]: its default, rigid, shows a search no way to go."""
        inertial = self.mechanism.body(place).moving_inertial()
        length = float(np.sqrt(12 * inertial.inertia_kg_m2.principal_moments()[-1] / inertial.mass_kg))
        return 0.5 * inertial.mass_kg * GRAVITY_M_PER_S2 * length / SMALL_BEND_RAD

    def _parameter(
        self, kind, places, label, spec: ParameterSpec, number: str, addresses: list[Address]
    ) -> FreeParameter:
        drawn = {e.id: e for e in (*self.mechanism.effects, *self.added.values())}
        values = []
        for effect_id, name in addresses:
            effect = drawn.get(effect_id)
            given = effect.parameters.get(spec.name) if effect else None
            if given is None and effect and _from_fits(kind, effect):
                given = self._drawn(kind, effect.on[0]).get(spec.name)
            value = np.broadcast_to(np.asarray(spec.default if given is None else given, float), spec.size)
            values.append(value[components(spec).index(name)])
        start = float(np.mean(np.asarray(values, float)))
        lower = -np.inf if spec.lower is None else spec.lower
        upper = np.inf if spec.upper is None else spec.upper
        unit = self._unit(spec, [drawn[effect_id] for effect_id, _ in addresses])
        return FreeParameter(kind.name, tuple(places), label, number, unit, lower, upper, start, tuple(addresses))

    def _unit(self, spec: ParameterSpec, effects: Sequence[Effect]) -> str:
        """Of a joint's coordinate rad where all of them turn, m where all slide."""
        turning, _, sliding = spec.unit.partition(" or ")
        types = {joint.type for joint in self.mechanism.joints for e in effects if e.on != "all" and joint.id in e.on}
        slides = {type == "prismatic" for type in types}
        if not sliding or len(slides) != 1:
            return spec.unit
        return sliding if slides.pop() else turning


def _from_fits(kind: EffectKind, effect: Effect) -> bool:
    """Whether the joints' fits give what a drawn effect leaves out: then it is another one at each."""
    lacking = any(spec.drawn and name not in effect.parameters for name, spec in kind.parameters.items())
    return kind.acts_on == "joint" and lacking


def components(spec: ParameterSpec) -> list[str]:
    """Names of a parameter's numbers: its own, or one for each component."""
    return [spec.name] if spec.size == 1 else [f"{spec.name}[{i}]" for i in range(spec.size)]
