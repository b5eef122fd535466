"""Why a mechanism rests: what a frictionless, clearance-free copy would do here, and what each change would free."""

from dataclasses import dataclass

import numpy as np

from backend.jam import cone, margin
from backend.jam.ideal import Ideal, ideal, runs_away
from backend.jam.knobs import has_friction, plays
from backend.jam.scene import Scene
from backend.jam.statics import Contacts, Statics
from backend.mechanism.jam_report import Cause, FrictionCone, Margin

PART = 0.1  # of the whole: joints that take less of the drive's work are not named
NO_LEVER = 1e-3  # of the fastest joint's rate: a joint slower than this stands at its dead centre
EXACT = 1e-9  # lever at a dead centre that only rounding would leave
MOST_PLAYS = 20  # loose pins that are tightened one at a time


@dataclass(frozen=True)
class Finding:
    """Why it rests, and what would free it.  lever: of the ideal copy here."""

    jammed: bool
    cause: Cause
    at: tuple[str, ...]
    margin: Margin
    lever: float
    cone: FrictionCone


def find_cause(scene: Scene) -> Finding:
    """Ask every counterfactual of a mechanism at rest (docs/jam.md tells the order and why)."""
    here, copy = scene.statics(), scene.statics(ideal=True)
    obstacles = _outside(here.contacts)
    bare, resting = ideal(copy), ideal(copy, obstacles)
    programme = _cone(scene, here)
    none = Margin()
    if not bare.moves:
        stuck = runs_away(copy, scene.displaced)
        if stuck:
            return Finding(True, "singularity", _dead(copy, bare), none, bare.lever, programme)
        return Finding(False, "none", (), none, bare.lever, programme)
    if not resting.moves:
        if plays(scene.model) and scene.moves(play=0.0):
            return Finding(True, "clearance_lock", _loose(scene), none, bare.lever, programme)
        pushing = obstacles.those(resting.push > 0.0)
        places = tuple(dict.fromkeys(name for names in pushing.names for name in names))
        return Finding(not bool(pushing.ends.all()), "stop", places, none, bare.lever, programme)
    if plays(scene.model) and scene.moves(play=0.0):
        slack = Margin(friction_factor=_friction(scene, programme))
        return Finding(True, "clearance_lock", _loose(scene), slack, resting.lever, programme)
    if has_friction(scene.model) and scene.moves(friction=0.0):
        drive = margin.drive_factor(scene, programme.drive_held or np.inf)
        found = Margin(drive_factor=drive, friction_factor=_friction(scene, programme))
        cause: Cause = "friction_lock" if drive is None else "insufficient_drive"
        return Finding(True, cause, _rubbing(scene, here, resting), found, resting.lever, programme)
    return Finding(False, "none", (), none, resting.lever, programme)


def find_balance(scene: Scene) -> Finding | None:
    """At an exact dead centre, where the drive has no lever at all but a small push off would set it free."""
    copy = scene.statics(ideal=True)
    bare = ideal(copy)
    if not copy.load.any() or not bare.free.size or bare.lever > EXACT or not runs_away(copy, scene.displaced):
        return None
    return Finding(True, "singularity", _dead(copy, bare), Margin(), bare.lever, _cone(scene, scene.statics()))


def _friction(scene: Scene, programme: FrictionCone) -> float | None:
    return margin.friction_factor(scene, programme.friction_needed or 0.0)


def _cone(scene: Scene, here: Statics) -> FrictionCone:
    holds = cone.can_hold(here, scene.radial)
    needed, held = cone.friction_needed(here, scene.radial), cone.drive_held(here, scene.radial)
    return FrictionCone(
        holds=holds,
        friction_needed=needed if np.isfinite(needed) else None,
        drive_held=held if holds and np.isfinite(held) else None,
    )


def _outside(contacts: Contacts) -> Contacts:
    """Ends of travel and other links: what a copy without play would still touch."""
    return contacts.those(contacts.ends | np.array([len(names) == 2 for names in contacts.names], dtype=bool))


def _dead(copy: Statics, here: Ideal) -> tuple[str, ...]:
    """Joints that stand still in every way the mechanism can move; all that turn where none does."""
    rates = np.abs(copy.turns @ here.free).max(-1, initial=0.0)
    moves = np.abs(copy.turns).max(-1) > 0.0
    dead = moves & (rates < NO_LEVER * rates.max(initial=0.0))
    return tuple(f"joint:{copy.joints[j]}" for j in np.flatnonzero(dead if dead.any() else moves))


def _rubbing(scene: Scene, here: Statics, resting: Ideal) -> tuple[str, ...]:
    """Where friction can take the drive's work if it moved as the ideal copy would; the greatest part first."""
    load = np.linalg.norm(scene.radial, axis=-1) * float(scene.plant.scale.length_m)
    a = resting.acceleration
    parts: dict[tuple[str, ...], float] = {
        (f"joint:{joint}",): (here.dry_limit[j] + here.dry_per_load[j] * load[j]) * abs(here.turns[j] @ a)
        for j, joint in enumerate(here.joints)
    }
    # What presses on a wall is not among a joint's rows; the load of its own joint, or of the whole, stands for it.
    drive = float(np.linalg.norm(here.load))
    for names, mu, rub in zip(here.contacts.names, here.contacts.friction, here.contacts.rubs, strict=True):
        parts[names] = parts.get(names, 0.0) + mu * drive * abs(rub @ a)
    bodies = np.array(scene.plant.pads.bodies, dtype=int)
    ids = scene.plant.topology.body_ids
    for body, rows, grip in zip(bodies, here.pads, here.grip, strict=True):
        place = (f"body:{ids[body]}",)
        parts[place] = parts.get(place, 0.0) + grip * float(np.linalg.norm(rows @ a))
    whole = sum(parts.values())
    named = sorted((p for p in parts if parts[p] > PART * max(parts.values()) > 0.0), key=lambda p: -parts[p])
    return tuple(dict.fromkeys(name for names in named for name in names)) if whole > 0.0 else ()


def _loose(scene: Scene) -> tuple[str, ...]:
    """Joints whose play alone, taken away, frees it; all loose ones where no single one does."""
    known = plays(scene.model)
    alone = [a for a in known if scene.moves(play=0.0, only=[a])] if len(known) <= MOST_PLAYS else []
    rows = scene.model.parameters
    return tuple(dict.fromkeys(f"joint:{joint}" for a in alone or known for joint in rows[a].on))
