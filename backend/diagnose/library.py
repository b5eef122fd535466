"""What may be missing from the drawing: every effect of the library, at every place where it can act.

An effect is a candidate because its file declares how large it may be (`Declaration.expected`), in the mechanism's own
natural sizes: nothing here knows a kind by name. All candidates of one structure stand in one model, absent, so that
one compiled program serves them all.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

from backend.diagnose.candidate import Candidate
from backend.effects.catalogue import catalogue
from backend.effects.effect import AbstractEffect
from backend.effects.shapes import (
    AbstractDrawnError,
    AbstractDryFriction,
    AbstractJointClearance,
    AbstractJointStop,
    AbstractLinkContact,
    AbstractSection,
)
from backend.fit.free import Freedom, FreeParameter, free_parameters
from backend.mechanism.constraints import drawn as drawn_placement
from backend.mechanism.constraints import size_m
from backend.mechanism.effect import Effect
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.mobility import binding_joints
from backend.mechanism.study import Tolerance
from backend.model.build import build
from backend.model.model import ParameterRow

RUBBING = "friction_coefficient"  # of walls
SWITCHING = (AbstractJointClearance, AbstractJointStop, AbstractSection)  # nothing to first order while absent
DECLARED_ONLY = (AbstractLinkContact,)  # their geometry must be drawn
SMOOTH, LOAD = "smooth", "load"
PLAYS = frozenset(kind for kind, e in catalogue().items() if issubclass(e, AbstractJointClearance))  # families of play
BENDING = frozenset(kind for kind, e in catalogue().items() if issubclass(e, AbstractSection))  # families of bending
STOPS = frozenset(kind for kind, e in catalogue().items() if issubclass(e, AbstractJointStop))  # families of ends
TIGHT = 1e-6  # mechanism lengths: play of a pin that is as good as none
GIVES = (10.0, 1.0, 0.1)  # of the softest stiffness that nobody need state: where a search for it begins
OF_DRAWN = 0.3  # of a value that is drawn: how far it may be off before any data
FAINT = 1e-6  # of the size that is expected: so little of an absent effect is there that it tells its shape's slope
KNOWN_ENOUGH = 3.0  # a tolerance of a drawing is a finding beyond so many of its standard deviations


@dataclass(frozen=True)
class Library:
    """Candidates of one family, the parameters they take and the effects that carry them.

    nuisances: indices of the parameters that every fit frees (the study's tolerances, its cameras' numbers). neutral:
    what every parameter is where no candidate takes it.
    """

    family: str
    parameters: tuple[FreeParameter, ...]
    added: tuple[Effect, ...]
    candidates: tuple[Candidate, ...]
    nuisances: tuple[int, ...]
    neutral: tuple[float, ...]


def family_of(effect: type[AbstractEffect]) -> str:
    """Effects that change the structure of the model stand apart, one family each."""
    if issubclass(effect, SWITCHING):
        return effect.kind
    return LOAD if issubclass(effect, AbstractDryFriction) and _grows_with_load(effect) else SMOOTH


def strikes(members: Iterable[Candidate]) -> bool:
    """Whether parts strike or bend in any of them, so that its law is not that of a smooth force."""
    return any(c.family not in (SMOOTH, LOAD) for c in members)


def rubs_dry(kind: str) -> bool:
    """Whether a kind is dry friction of a size of its own, which friction that grows with load may look like."""
    effect = catalogue()[kind]
    return issubclass(effect, AbstractDryFriction) and not _grows_with_load(effect)


def _grows_with_load(effect: type[AbstractEffect]) -> bool:
    """Friction whose limit no number of its own but a coefficient gives couples the joints' rows."""
    return all(d.unit == "1" for d in effect.declarations().values() if not d.by_name)


def families(without: frozenset[str] = frozenset()) -> dict[str, tuple[str, ...]]:
    """Kinds that may be causes, by family, "smooth" first. without: kinds to leave out."""
    found: dict[str, tuple[str, ...]] = {SMOOTH: ()}
    for kind, effect in catalogue().items():
        if kind not in without and kind != "gravity" and not issubclass(effect, DECLARED_ONLY) and _expected(effect):
            found[family_of(effect)] = (*found.get(family_of(effect), ()), kind)
    return found


def _expected(effect: type[AbstractEffect]) -> bool:
    return any(d.expected is not None for d in effect.declarations().values())


def library(
    mechanism: Mechanism,
    family: str,
    tolerances: Sequence[Tolerance] = (),
    without: frozenset[str] = frozenset(),
    driven: frozenset[str] = frozenset(),
) -> Library:
    """Everything smooth, and one further family beside it, with the study's tolerances.

    without: kinds that are no candidates. The model keeps them, absent, and its compiled program serves all the same.
    driven: drawn effects whose value is on record: what is amiss beside one is an effect of its own.
    """
    kinds = families()
    wanted = kinds[SMOOTH] if family == SMOOTH else (*kinds[SMOOTH], *kinds[family])
    loose = free_parameters(mechanism, (), tolerances, recorded=driven)
    found: list[FreeParameter] = []
    added: dict[str, Effect] = {e.id: e for e in loose.added}
    # The family's own kinds first: others that cannot stand beside them, or beside a tolerance, are left out.
    for kind in reversed(wanted):
        for freedom in _places_of(mechanism, driven, kind, added if family != SMOOTH else {}):
            found += [p for p in freedom.parameters if all(p.name != f.name for f in found)]
            added |= {e.id: e for e in freedom.added}
    found += [p for p in loose.parameters if all(p.name != f.name for f in found)]
    table = build(mechanism, tuple(added.values())).parameters
    known = {p.name: p.prior_sd for p in loose.parameters}
    wide: list[float | None] = []
    for p in found:
        row = table[p.addresses[0]]
        sd = row.expected
        if sd is not None and not _out_of_reach(p, sd):
            sd = max(sd, OF_DRAWN * abs(p.start))
        own = known.get(p.name)
        wide.append(max(sd, KNOWN_ENOUGH * own) if sd is not None and own is not None else sd)
    rows = [table[p.addresses[0]] for p in found]
    tries = [
        () if p.addresses[0][0] not in added else tuple(t * row.natural for t in row.declaration.tries)
        for p, row in zip(found, rows, strict=True)
    ]
    late = {i: t for i, row in enumerate(rows) if row.declaration.late for t in tries[i][:1]}
    found = [
        replace(p, start=t[0]) if len(t) == 1 and i not in late else p
        for i, (p, t) in enumerate(zip(found, tries, strict=True))
    ]
    as_causes = [
        replace(p, prior_sd=sd, start=0.0 if _out_of_reach(p, sd) else p.start)
        for p, sd in zip(found, wide, strict=True)
    ]
    tight = TIGHT * float(build(mechanism).scale.length_m)
    neutral = tuple(
        p.start if p.name in known or sd is None or p.addresses[0][0] not in added else _absent(p, sd, row, tight)
        for p, sd, row in zip(found, wide, rows, strict=True)
    )
    parameters = tuple(replace(p, prior_sd=known.get(p.name, sd)) for p, sd in zip(found, wide, strict=True))
    nuisances = tuple(i for i, p in enumerate(found) if p.name in known)
    unstated = {i: around for i, (p, row) in enumerate(zip(found, rows, strict=True)) if (around := _around(p, row))}
    candidates = [
        c for c in _candidates(mechanism, wanted, as_causes, found, tries, unstated, late) if c.kind not in without
    ]
    return Library(family, parameters, tuple(added.values()), _shared_out(candidates), nuisances, neutral)


def _shared_out(candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Every kind as likely as the next, whichever of its places it acts at."""
    places = Counter(c.kind for c in candidates)
    mean = len(candidates) / max(len(places), 1)

    def shared(c: Candidate) -> Candidate:
        return replace(c, share=mean / places[c.kind], closer=tuple(map(shared, c.closer)))

    return tuple(map(shared, candidates))


def _absent(p: FreeParameter, sd: float, row: ParameterRow, tight: float) -> float:
    """What a number is while its effect is not there: pins fit, links do not bend."""
    effect = catalogue()[p.kind]
    if any(d.proportional_to == p.parameter for d in effect.declarations().values()):
        return p.start + FAINT * sd
    if issubclass(effect, AbstractJointClearance):
        return tight
    held = row.declaration.default
    return float(held) if issubclass(effect, AbstractSection) and held is not None else p.start


def _can_be_built(mechanism: Mechanism, added: Mapping[str, Effect]) -> bool:
    try:
        build(mechanism, tuple(added.values()))
    except ValueError:
        return False
    return True


def _out_of_reach(p: FreeParameter, sd: float | None) -> bool:
    """Absent means so large that it never matters: a stop that is never met, a link that never bends."""
    return sd is not None and abs(p.start) > 100.0 * sd


def _places_of(mechanism: Mechanism, driven: frozenset[str], kind: str, beside: Mapping[str, Effect]) -> list[Freedom]:
    """The kind everywhere; place by place where it cannot act at all of them, with these effects beside it."""
    everywhere = [j.id for j in mechanism.joints]
    try:
        freedom = free_parameters(mechanism, _asked(mechanism, kind, "*", everywhere), recorded=driven)
    except ValueError:
        return []  # it acts nowhere in this mechanism
    if _can_be_built(mechanism, {**beside, **{e.id: e for e in freedom.added}}):
        return [freedom]
    found = []
    for on in dict.fromkeys(p.on for p in freedom.parameters):
        try:
            one = free_parameters(mechanism, _asked(mechanism, kind, "+".join(on), on), recorded=driven)
        except ValueError:
            continue
        if _can_be_built(mechanism, both := {**beside, **{e.id: e for e in one.added}}):
            found.append(one)
            beside = both
    return found


def _asked(mechanism: Mechanism, kind: str, place: str, on: Sequence[str]) -> list[str]:
    """What is free at a place, which names these joints or none: what is freed by itself, and by name what a joint of
    its type has.
    """
    types = {j.type for j in mechanism.joints if j.id in on}
    named = [
        name for name, d in catalogue()[kind].declarations().items()
        if d.by_name and (d.expected is not None or d.unstated is not None)
        and (d.joint_types is None or types & set(d.joint_types))
    ]  # fmt: skip
    return [f"{kind}:{place}", *(f"{kind}:{place}.{name}" for name in named)]


def _candidates(
    mechanism: Mechanism,
    kinds: Sequence[str],
    parameters: Sequence[FreeParameter],
    drawn: Sequence[FreeParameter],
    tries: Sequence[tuple[float, ...]],
    unstated: Mapping[int, Sequence[tuple[float, float]]],
    late: Mapping[int, float],
) -> Iterator[Candidate]:
    still = {body.id for body in mechanism.bodies if body.fixed}
    binding = binding_joints(mechanism, drawn_placement(mechanism), size_m(mechanism))
    for kind in kinds:
        family = family_of(catalogue()[kind])
        binds = binding if _redraws_a_joint(catalogue()[kind]) else frozenset()
        own_late = {i: start for i, start in late.items() if parameters[i].kind == kind}
        own_unstated = [i for i in unstated if parameters[i].kind == kind]
        at: dict[tuple[str, ...], list[int]] = {}
        for i, p in enumerate(parameters):
            if p.kind == kind and p.prior_sd is not None and i not in late and not binds & set(p.on):
                at.setdefault(p.on, []).append(i)
        for on, rows in at.items():
            far = [i for i in rows if _out_of_reach(drawn[i], parameters[i].prior_sd)]
            far = rows if issubclass(catalogue()[kind], AbstractJointStop) else far  # a drawn end is one of two, too
            for each in [[i] for i in far] if len(far) > 1 else [rows]:
                own = tuple(parameters[i] for i in each)
                takes = tuple((i,) for i in each)
                worth = tuple(tries[i] for i in each)
                places, reach = _places(mechanism, kind, on), _reach(mechanism, kind, on)
                made = Candidate(kind, on, places, reach, own, takes, family, worth, len(far) > 1)
                rest = {take: unstated[take[0]] for take in _alike_at([on], own_unstated, parameters)}
                shape = {take: own_late[take[0]] for take in _alike_at([on], own_late, parameters)}
                closer = _closer(made, parameters, rest)
                yield replace(made, closer=closer + _shaped(made, parameters, shape))
        effect = catalogue()[kind]
        if len(at) < 2 or not effect.shared or effect.acts_on in ("world", "camera"):
            continue
        alike: dict[tuple[str, ...], dict[tuple[float, ...], list[tuple[str, ...]]]] = {}
        for on, rows in at.items():
            if effect.acts_on == "body" and still.issuperset(on):  # there by its tolerance alone
                continue
            names, drawn_at = zip(*((parameters[i].parameter, parameters[i].start) for i in rows), strict=True)
            alike.setdefault(names, {}).setdefault(drawn_at, []).append(on)
        # Those that turn, and those that slide; of each those that are drawn alike.
        several = [list(of.values()) for of in alike.values() if any(len(ons) > 1 for ons in of.values())]
        for ons, kin in ((ons, of) for of in several for ons in of if len(ons) > 1):
            takes = tuple(tuple(group) for group in zip(*(at[on] for on in ons), strict=True))
            everywhere = tuple(o for on in ons for o in on)
            label = _together(everywhere, [o for others in kin if others is not ons for on in others for o in on])
            own = tuple(replace(parameters[t[0]], label=label) for t in takes)
            worth = tuple(tries[t[0]] for t in takes)
            places, reach = _places(mechanism, kind, everywhere), _reach(mechanism, kind, everywhere)
            made = Candidate(kind, everywhere, places, reach, own, takes, family, worth, len(several) > 1, label=label)
            rest = {take: unstated[take[0]] for take in _alike_at(ons, own_unstated, parameters)}
            shape = {take: own_late[take[0]] for take in _alike_at(ons, own_late, parameters)}
            yield replace(made, closer=_closer(made, parameters, rest) + _shaped(made, parameters, shape))


def _alike_at(
    ons: Sequence[tuple[str, ...]], rows: Iterable[int], parameters: Sequence[FreeParameter]
) -> Iterator[tuple[int, ...]]:
    """Of these rows those that are at these places, one number after the other, each of all places together."""
    named: dict[str, list[int]] = {}
    for on in ons:
        for i in (i for i in rows if parameters[i].on == on):
            named.setdefault(parameters[i].parameter, []).append(i)
    return (tuple(take) for take in named.values())


def _redraws_a_joint(effect: type[AbstractEffect]) -> bool:
    """Whether it says that a joint is not as drawn, which rigid parts of a loop may not be able to follow."""
    return issubclass(effect, AbstractDrawnError) and effect.acts_on == "joint"


def _together(on: Sequence[str], others: Sequence[str]) -> str:
    """Places in a word, as `--free` takes it."""
    if not others:
        return "all"
    return f"all-{'+'.join(others)}" if len(others) < len(on) else "+".join(on)


def _around(p: FreeParameter, row: ParameterRow) -> list[tuple[float, float]]:
    """Where a number that nobody states may begin, and its sd about there; a stiffness by its order of magnitude."""
    held, far = row.declaration.default, row.unstated
    if held is None or far is None or p.start != held:
        return []
    if held > far > 0.0:
        return [(far * f, 5.0 * far * f) for f in GIVES]
    return [(held, 0.5 * abs(far - held))]


def _closer(
    made: Candidate,
    parameters: Sequence[FreeParameter],
    unstated: Mapping[tuple[int, ...], Sequence[tuple[float, float]]],
) -> tuple[Candidate, ...]:
    """The same with what nobody states of it: takes, and of each where it may begin with its sd."""
    if not unstated:
        return ()
    found, label = [], made.parameters[0].label
    for begin in product(*unstated.values()):
        more = tuple(
            replace(p, start=start, prior_sd=sd, upper=min(p.upper, start + 2.0 * sd), label=label)
            for p, (start, sd) in zip((parameters[take[0]] for take in unstated), begin, strict=True)
        )
        found.append(
            replace(
                made,
                parameters=made.parameters + more,
                takes=(*made.takes, *unstated),
                tries=made.tries + ((0.0,),) * len(more),
            )
        )
    return tuple(found)


def _shaped(
    made: Candidate, parameters: Sequence[FreeParameter], late: Mapping[tuple[int, ...], float]
) -> tuple[Candidate, ...]:
    """The same with those of its numbers that are freed late, from where each is worth beginning."""
    if not late:
        return ()
    more = tuple(replace(parameters[t[0]], start=start, label=made.parameters[0].label) for t, start in late.items())
    return (
        replace(
            made,
            parameters=made.parameters + more,
            takes=(*made.takes, *late),
            tries=made.tries + tuple((p.start,) for p in more),
        ),
    )


PART = {"joint": "joint", "body": "body", "bodies": "body", "marker": "marker", "camera": "marker", "world": "joint"}
"""Parts on which a kind stands, by what it acts on: of the picture one marker, of the surroundings one joint."""


def _places(mechanism: Mechanism, kind: str, on: Sequence[str]) -> tuple[str, ...]:
    """`joint:ID`, `body:ID`, `marker:ID`, `effect:ID`, `camera`, `world`. A joint and a marker may have one name."""
    acts_on = catalogue()[kind].acts_on
    drawn = set() if acts_on in ("joint", "body", "marker") else {e.id for e in mechanism.effects}

    def place(id: str) -> str:
        if id == acts_on and acts_on in ("camera", "world"):
            return id
        return f"effect:{id}" if id in drawn else f"{PART[acts_on]}:{id}"

    return tuple(map(place, on))


def _reach(mechanism: Mechanism, kind: str, on: Sequence[str]) -> frozenset[str]:
    moving, places = {b.id for b in mechanism.bodies if not b.fixed}, _places(mechanism, kind, on)
    at = [j for j in mechanism.joints if f"joint:{j.id}" in places]
    return frozenset(places) | {f"body:{b}" for j in at for b in (j.body_a, j.body_b) if b in moving}
