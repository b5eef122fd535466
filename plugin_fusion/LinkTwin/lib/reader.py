"""A Fusion design as a snapshot: plain data in Fusion's own units (cm, kg, rad), meshes beside it.

The only room of `lib` that meets Fusion's objects, with `read_component` and `read_joint`; it asks and writes down,
and decides nothing. Everything here runs on Fusion's main thread.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from .islands import ROOT
from .names import file_names
from .read_component import items, listed, read_component
from .read_joint import attempt, read_joint

SNAPSHOT_VERSION = "1.0"


def read_design(
    design, application, folder: Path, up: str = "auto", progress: Callable[[str, float], None] = lambda *_: None
) -> dict:
    """The snapshot of a design; the meshes of its solids are written to folder/raw/meshes.

    up: the axis against gravity, `x`, `y` or `z`; `auto` asks Fusion's preferences.  progress: told what is being
    read, and the share that is done.
    """
    unread: list = []
    root, keys = design.rootComponent, _Keys()
    occurrences = items(lambda: root.allOccurrences)
    root_key = keys.of(root)
    listed = [record for record in (_occurrence(occurrence, keys, unread) for occurrence in occurrences) if record]
    components = _components(root, occurrences, keys)
    write_mesh = _mesh_writer(design, Path(folder) / "raw")
    found = {}
    for number, (id, component) in enumerate(components.items()):
        progress(f'component "{attempt(lambda c=component: c.name)}"', number / (len(components) + 1))
        found[id] = read_component(component, write_mesh)
    unread += _unasked(components.values())
    progress("joints", len(components) / (len(components) + 1))
    joints = _joints(root, "allJoints", "joints", "joint", unread) + _joints(
        root, "allAsBuiltJoints", "asBuiltJoints", "as_built", unread
    )
    return {
        "snapshot_version": SNAPSHOT_VERSION,
        "units": {"length": "cm", "mass": "kg", "angle": "rad"},
        "fusion_version": attempt(lambda: str(application.version), ""),
        "document": {
            "name": document_name(design, application),
            "saved": bool(attempt(lambda: application.activeDocument.isSaved, False)),
        },
        "up": _up(application, unread) if up == "auto" else up,
        "root": {"component": root_key},
        "occurrences": listed,
        "components": found,
        "joints": joints,
        "rigid_groups": _groups(root, unread),
        "unread": unread,
    }


def document_name(design, application) -> str:
    """The design's name; a document that was never saved has that of its tab, or of its root component."""
    named = attempt(lambda: str(application.activeDocument.name)) or attempt(lambda: str(design.rootComponent.name))
    return named or "Untitled"


class _Keys:
    """What components are called in a snapshot: their ids, and copies and revisions of one design, which share an id,
    by their names and revisions too.
    """

    def __init__(self):
        self._first: dict = {}

    def of(self, component) -> str:
        """The key of a component; the same whenever it is asked for."""
        name = attempt(lambda: str(component.name), "")
        id = attempt(lambda: str(component.id)) or attempt(lambda: str(component.entityToken)) or str(component.name)
        told = (name, attempt(lambda: str(component.revisionId), ""))
        return id if self._first.setdefault(id, told) == told else " ".join((id, *told)).strip()


def _unasked(components) -> list:
    """What ties components together and is no joint."""
    told = []
    for component in components:
        count = attempt(lambda c=component: int(c.assemblyConstraints.count), 0)
        if count:
            name = attempt(lambda c=component: str(c.name), "?")
            told.append(
                f'component "{name}" holds assembly constraints ({count}), left out: only joints are read; '
                "join its parts by joints or as-built joints"
            )
    return told


def _occurrence(occurrence, keys: _Keys, unread: list) -> dict | None:
    path = attempt(lambda: str(occurrence.fullPathName))
    try:
        return {
            "path": str(occurrence.fullPathName),
            "parent": attempt(lambda: str(occurrence.assemblyContext.fullPathName), ROOT),
            "component": keys.of(occurrence.component),
            "transform": [float(entry) for entry in occurrence.transform2.asArray()],
            "pinned": bool(attempt(lambda: occurrence.isGrounded, False)),
            "ground_to_parent": attempt(lambda: bool(occurrence.isGroundToParent)),
            "suppressed": bool(attempt(lambda: occurrence.isSuppressed, False)),
        }
    except Exception as error:  # a linked design that is not loaded raises on its component
        unread.append(f'component "{path or "?"}" cannot be read ({error}) and is left out; reload or relink it')
        return None


def _components(root, occurrences, keys: _Keys) -> dict:
    found = {keys.of(root): root}
    for occurrence in occurrences:
        component = attempt(lambda o=occurrence: o.component)
        if component is not None:
            found.setdefault(keys.of(component), component)
    return found


def _mesh_writer(design, folder: Path) -> Callable:
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    taken: list = []

    def write(body, name: str) -> str:
        taken.append(name)
        relative = "meshes/" + file_names(taken, ".stl")[-1]
        path = folder / relative
        options = design.exportManager.createSTLExportOptions(body, str(path))
        options.sendToPrintUtility = False
        options.isBinaryFormat = True
        # The unit is measured from the file: not every Fusion lets it be set, and not every one tells.
        attempt(lambda: setattr(options, "unitType", 0))
        if not design.exportManager.execute(options) or not path.exists():
            raise OSError("Fusion did not write it")
        return relative

    return write


def _joints(root, everywhere: str, own: str, kind: str, unread: list) -> list:
    found = []
    joints = _everywhere(root, everywhere, own, f"{kind.replace('_', '-')} joints", unread)
    for number, joint in enumerate(joints, 1):
        if isinstance(joint, Exception):
            unread.append(
                f"{kind.replace('_', '-')} joint {number} cannot be read ({joint}) and is left out; "
                "repair it in the timeline"
            )
            continue
        try:
            found.append(read_joint(joint, kind))
        except Exception as error:
            name = attempt(lambda j=joint: str(j.name)) or f"number {number}"
            unread.append(f'joint "{name}" cannot be read ({error}) and is left out; repair it in the timeline')
    return found


def _everywhere(root, everywhere: str, own: str, what: str, unread: list) -> list:
    """All of a kind; where Fusion refuses the list of all, those of the root and of each occurrence, one by one."""
    try:
        return listed(getattr(root, everywhere))
    except Exception as error:
        unread.append(f"Fusion cannot list all {what} ({error}); they are read component by component")
    found = attempt(lambda: listed(getattr(root, own)), [])
    for occurrence in items(lambda: root.allOccurrences):
        for native in attempt(lambda o=occurrence: listed(getattr(o.component, own)), []):
            found.append(attempt(lambda n=native, o=occurrence: n.createForAssemblyContext(o), native))
    return found


def _groups(root, unread: list) -> list:
    found = []
    for number, group in enumerate(_everywhere(root, "allRigidGroups", "rigidGroups", "rigid groups", unread), 1):
        try:
            if isinstance(group, Exception):
                raise group
            found.append(
                {
                    "name": attempt(lambda g=group: str(g.name)) or f"rigid group {number}",
                    "context": attempt(lambda g=group: str(g.assemblyContext.fullPathName), ROOT),
                    "suppressed": bool(attempt(lambda g=group: g.isSuppressed, False)),
                    "members": [str(occurrence.fullPathName) for occurrence in items(lambda g=group: g.occurrences)],
                }
            )
        except Exception as error:
            unread.append(f"rigid group {number} cannot be read ({error}) and is left out; edit it in the timeline")
    return found


def _up(application, unread: list) -> str:
    """y or z, by the modelling orientation of Fusion's preferences."""
    orientation = attempt(lambda: int(application.preferences.generalPreferences.defaultModelingOrientation))
    if orientation not in (0, 1):
        unread.append("which way is up cannot be read from Fusion's preferences; z is taken: set it in the settings")
    return "y" if orientation == 0 else "z"
