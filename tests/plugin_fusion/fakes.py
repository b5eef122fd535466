"""Fusion's objects as far as the reader asks them: what is not here raises, as Fusion's own would."""

from types import SimpleNamespace
from typing import Any

import numpy as np


class Things:
    """A Fusion collection. An item that is an exception is raised when it is asked for."""

    def __init__(self, *items: Any):
        self._items = list(items)

    @property
    def count(self) -> int:
        return len(self._items)

    def item(self, at: int) -> Any:
        if isinstance(self._items[at], Exception):
            raise self._items[at]
        return self._items[at]

    def itemById(self, id: str) -> Any:
        return next((item for item in self._items if item.id == id), None)


class Array:
    """What Fusion's help calls an array: a sequence, without the count and item of a collection."""

    def __init__(self, *items: Any):
        self._items = list(items)

    def __len__(self) -> int:
        return len(self._items)

    def __getitem__(self, at: int) -> Any:
        if isinstance(self._items[at], Exception):
            raise self._items[at]
        return self._items[at]


class Fake(SimpleNamespace):
    """An object of Fusion; an attribute that holds an exception raises it."""

    def __getattribute__(self, name: str) -> Any:
        value = super().__getattribute__(name)
        if isinstance(value, Exception):
            raise value
        return value


def point(xyz) -> Fake:
    """A Point3D or Vector3D."""
    x, y, z = (float(entry) for entry in xyz)
    return Fake(x=x, y=y, z=z)


def matrix(rows) -> Fake:
    """A Matrix3D of sixteen numbers."""
    return Fake(asArray=lambda: tuple(float(entry) for entry in rows))


def properties(mass_kg, volume_cm3, center_cm, moments_kg_cm2) -> Fake:
    """PhysicalProperties; moments: xx, yy, zz, xy, yz, xz."""
    return Fake(
        mass=mass_kg,
        volume=volume_cm3,
        centerOfMass=point(center_cm),
        getXYZMomentsOfInertia=lambda: (True, *moments_kg_cm2),
    )


def body(name: str, weight: Fake | Exception, box, faces=(), **more) -> Fake:
    """A BRepBody that weighs what it is told, at the highest accuracy alone."""

    def weigh(accuracy: int) -> Fake:
        assert accuracy == 3, "VeryHighCalculationAccuracy"
        if isinstance(weight, Exception):
            raise weight
        return weight

    told = {"name": name, "isLightBulbOn": True, "isSolid": True, "material": Fake(name="Aluminum 6061")}
    corners = Fake(minPoint=point(box[0]), maxPoint=point(box[1]))
    return Fake(**{**told, "getPhysicalProperties": weigh, "boundingBox": corners, "faces": Things(*faces), **more})


def component(name: str, *bodies: Fake, points=(), **more) -> Fake:
    """A Component; its id is its name."""
    told = {"name": name, "id": name, "bRepBodies": Things(*bodies), "meshBodies": Things()}
    return Fake(**{**told, "constructionPoints": Things(*points), **more})


def occurrence(path: str, of: Fake | Exception, rows, parent: Fake | None = None, **more) -> Fake:
    """An Occurrence; `transform` is the property that no longer tells the truth."""
    told = {"fullPathName": path, "name": path.rpartition("+")[2], "component": of, "assemblyContext": parent}
    told |= {"transform": RuntimeError("use transform2"), "transform2": matrix(rows)}
    return Fake(**{**told, "isGrounded": False, "isGroundToParent": False, "isSuppressed": False, **more})


def geometry(origin_cm, vectors=((1, 0, 0), (0, 1, 0), (0, 0, 1))) -> Fake:
    """A JointGeometry."""
    names = ("primaryAxisVector", "secondaryAxisVector", "thirdAxisVector")
    return Fake(origin=point(origin_cm), **{name: point(v) for name, v in zip(names, vectors, strict=True)})


def limits(lower=None, upper=None) -> Fake:
    """JointLimits with the sides that are given switched on; the others keep a value that means nothing."""
    return Fake(
        isMinimumValueEnabled=lower is not None,
        minimumValue=99.0 if lower is None else lower,
        isMaximumValueEnabled=upper is not None,
        maximumValue=-99.0 if upper is None else upper,
    )


def revolute(axis, value=0.0, **sides) -> Fake:
    """A RevoluteJointMotion."""
    return Fake(jointType=1, rotationAxisVector=point(axis), rotationValue=value, rotationLimits=limits(**sides))


def slider(axis, value=0.0, **sides) -> Fake:
    """A SliderJointMotion."""
    return Fake(jointType=2, slideDirectionVector=point(axis), slideValue=value, slideLimits=limits(**sides))


def joint(name: str, motion: Fake | Exception, one, two, origin_one, origin_two=None, **more) -> Fake:
    """A Joint between two occurrences, None for the root component."""
    told = {"name": name, "jointMotion": motion, "occurrenceOne": one, "occurrenceTwo": two, "assemblyContext": None}
    told |= {"geometryOrOriginOne": geometry(origin_one)}
    told |= {"geometryOrOriginTwo": geometry(origin_one if origin_two is None else origin_two)}
    return Fake(**{**told, "isSuppressed": False, "isLocked": False, "errorOrWarningMessage": "", **more})


def as_built(name: str, motion: Fake, one, two, origin=None, **more) -> Fake:
    """An AsBuiltJoint; without an origin where it is rigid."""
    told = {"name": name, "jointMotion": motion, "occurrenceOne": one, "occurrenceTwo": two, "assemblyContext": None}
    told |= {"geometry": None if origin is None else geometry(origin)}
    return Fake(**{**told, "isSuppressed": False, "errorOrWarningMessage": "", **more})


def design(
    name: str, occurrences=(), joints=(), as_builts=(), groups=(), root_bodies=(), write_mesh=None, **more
) -> Fake:
    """A Design; its exportManager writes meshes by `write_mesh(body, path)`."""
    told = {"allOccurrences": Things(*occurrences), "allJoints": Array(*joints)}
    told |= {"allAsBuiltJoints": Array(*as_builts), "allRigidGroups": Array(*groups)}
    root = component(name, *root_bodies, **{**told, **more})
    return Fake(rootComponent=root, exportManager=_exports(write_mesh))


def application(document="design v1", saved=True, orientation=1, **more) -> Fake:
    """The Application; orientation 0 is y up, 1 is z up."""
    general = Fake(defaultModelingOrientation=orientation)
    told = {"activeDocument": Fake(name=document, isSaved=saved), "preferences": Fake(generalPreferences=general)}
    return Fake(**{"version": "2.0.20000", **told, **more})


def _exports(write_mesh) -> Fake:
    def execute(options) -> bool:
        assert options.isBinaryFormat
        assert options.sendToPrintUtility is False
        if write_mesh is None:
            return False
        write_mesh(options.body, options.path)
        return True

    return Fake(createSTLExportOptions=lambda body, path: Fake(body=body, path=path), execute=execute)


def box_body(name: str, low, high, density=2.7e-3, **more) -> Fake:
    """A box of aluminium."""
    from tests.plugin_fusion.snapshots import solid

    told = solid(low, high, name, density)
    weight = properties(told["mass_kg"], told["volume_cm3"], told["center_cm"], told["moments_kg_cm2"])
    return body(name, weight, np.array([low, high], float), **more)


def write_box(of: Fake, path: str) -> None:
    """The mesh of a box, in millimetres."""
    from tests.plugin_fusion.addin import room
    from tests.plugin_fusion.snapshots import box_mesh

    low, high = ([corner.x, corner.y, corner.z] for corner in (of.boundingBox.minPoint, of.boundingBox.maxPoint))
    placement = room("lib.placement").Placement()
    room("lib.stl").write(path, [(box_mesh(low, high), 1.0, placement)])
