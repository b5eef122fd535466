"""A Fusion design as a snapshot: plain data in Fusion's own units (cm, kg, rad), meshes beside it.

The only room of `lib` that meets Fusion's objects, with `read_component` and `read_joint`; it asks and writes down,
and decides nothing. Everything here runs on Fusion's main thread.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from .islands import ROOT
from .names import file_names
from .read_component import items, read_component
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
    root = design.rootComponent
    occurrences = items(lambda: root.allOccurrences)
    listed = [record for record in (_occurrence(occurrence, unread) for occurrence in occurrences) if record]
    components = _components(root, occurrences)
    write_mesh = _mesh_writer(design, Path(folder) / "raw")
    found = {}
    for number, (id, component) in enumerate(components.items()):
        progress(f'component "{attempt(lambda c=component: c.name)}"', number / (len(components) + 1))
        found[id] = read_component(component, write_mesh)
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
        "root": {"component": _id(root)},
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


def _id(component) -> str:
    return attempt(lambda: str(component.id)) or attempt(lambda: str(component.entityToken)) or str(component.name)


def _occurrence(occurrence, unread: list) -> dict | None:
    path = attempt(lambda: str(occurrence.fullPathName))
    try:
        return {
            "path": str(occurrence.fullPathName),
            "parent": attempt(lambda: str(occurrence.assemblyContext.fullPathName), ROOT),
            "component": _id(occurrence.component),
            "transform": [float(entry) for entry in occurrence.transform2.asArray()],
            "pinned": bool(attempt(lambda: occurrence.isGrounded, False)),
            "ground_to_parent": attempt(lambda: bool(occurrence.isGroundToParent)),
            "suppressed": bool(attempt(lambda: occurrence.isSuppressed, False)),
        }
    except Exception as error:  # a linked design that is not loaded raises on its component
        unread.append(f'component "{path or "?"}" cannot be read ({error}) and is left out; reload or relink it')
        return None


def _components(root, occurrences) -> dict:
    found = {_id(root): root}
    for occurrence in occurrences:
        component = attempt(lambda o=occurrence: o.component)
        if component is not None:
            found.setdefault(_id(component), component)
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
    """All joints; where Fusion refuses the list of all, those of the root and of each occurrence, one by one."""
    joints, failed = _listed(lambda: getattr(root, everywhere))
    if joints is None:
        unread.append(
            f"Fusion cannot list all {kind.replace('_', '-')} joints ({failed}); they are read component by component"
        )
        joints = _listed(lambda: getattr(root, own))[0] or []
        for occurrence in items(lambda: root.allOccurrences):
            for native in _listed(lambda o=occurrence: getattr(o.component, own))[0] or []:
                joints.append(attempt(lambda n=native, o=occurrence: n.createForAssemblyContext(o), native))
    found = []
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


def _listed(read: Callable) -> tuple:
    """The items of a collection, with the exception in place of one that raises; None and why where there is none."""
    try:
        collection = read()
        count = int(collection.count)
    except Exception as error:
        return None, error
    found: list = []
    for at in range(count):
        try:
            found.append(collection.item(at))
        except Exception as error:
            found.append(error)
    return found, None


def _groups(root, unread: list) -> list:
    found = []
    for number, group in enumerate(_listed(lambda: root.allRigidGroups)[0] or [], 1):
        try:
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
