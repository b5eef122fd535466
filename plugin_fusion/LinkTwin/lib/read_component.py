"""One component of Fusion as plain data: its own solids with mass properties, cylinders and meshes."""

from __future__ import annotations

from .read_joint import attempt, numbers

CYLINDER = 1  # adsk.core.SurfaceTypes.CylinderSurfaceType
LINE, ARC, CIRCLE = 0, 1, 2  # adsk.core.Curve3DTypes
VERY_HIGH = 3  # adsk.fusion.CalculationAccuracy.VeryHighCalculationAccuracy
MARKER = "marker"


def read_component(component, write_mesh) -> dict:
    """A component's record, everything in its own frame: native objects know no other.

    write_mesh: writes the mesh of a body under a name and returns that name; it may raise.
    """
    name = attempt(lambda: str(component.name)) or "component"
    solids = [body for body in items(lambda: component.bRepBodies)]
    record = {
        "name": name,
        "bodies": [_solid(body, name, write_mesh) for body in solids],
        "cylinders": [face for body in solids if _shown(body) for face in _cylinders(body)],
        "markers": _markers(component),
    }
    for mesh in items(lambda: component.meshBodies):
        record["bodies"].append(
            {"name": attempt(lambda m=mesh: str(m.name)) or "mesh", "visible": _shown(mesh), "solid": False}
        )
    return record


def items(read) -> list:
    """The items of a collection, skipping those that raise."""
    found = attempt(lambda: listed(read())) or []
    return [item for item in found if item is not None and not isinstance(item, Exception)]


def listed(collection) -> list:
    """The items of a collection, or of an array (Fusion's `all...` properties give one), which has no count and no
    item; with the exception in place of one that raises.
    """
    count = attempt(lambda: int(collection.count))  # of a list, count is a method
    pick = collection.__getitem__ if count is None else collection.item
    found: list = []
    for at in range(len(collection) if count is None else count):
        try:
            found.append(pick(at))
        except Exception as error:  # whatever Fusion raises about one item, the others are read
            found.append(error)
    return found


def _shown(body) -> bool:
    """Whether a body's own light bulb is on; its components' do not matter."""
    return bool(attempt(lambda: body.isLightBulbOn, True))


def _solid(body, component: str, write_mesh) -> dict:
    record = {
        "name": attempt(lambda: str(body.name)) or "body",
        "visible": _shown(body),
        "solid": bool(attempt(lambda: body.isSolid, True)),
        "material": attempt(lambda: str(body.material.name), ""),
    }
    if not (record["visible"] and record["solid"]):
        return record
    try:
        record.update(_weight(body))
    except Exception as error:  # whatever Fusion raises, the body is named and the export goes on
        return {**record, "error": str(error)}
    box = attempt(lambda: body.boundingBox)
    record["box_cm"] = attempt(lambda: [numbers(box.minPoint), numbers(box.maxPoint)])
    try:
        record["mesh"] = write_mesh(body, f"{component}-{record['name']}")
    except Exception as error:
        record["mesh"], record["mesh_error"] = None, str(error)
    return record


def _weight(body) -> dict:
    properties = body.getPhysicalProperties(VERY_HIGH)
    answered, *moments = properties.getXYZMomentsOfInertia()
    if not answered:
        raise ValueError("Fusion gives no moments of inertia")
    return {
        "mass_kg": float(properties.mass),
        "volume_cm3": float(properties.volume),
        "center_cm": numbers(properties.centerOfMass),
        "moments_kg_cm2": [float(moment) for moment in moments],
    }


def _cylinders(body) -> list:
    """Cylindrical faces: axis, radius, reach along the axis, and whether matter lies inside (pin) or outside (hole)."""
    found = []
    for face in items(lambda: body.faces):
        if attempt(lambda f=face: int(f.geometry.surfaceType)) == CYLINDER:
            record = attempt(lambda f=face: _cylinder(f))
            if record:
                found.append(record)
    return found


def _cylinder(face) -> dict | None:
    surface = face.geometry
    origin, axis = numbers(surface.origin), numbers(surface.axis)
    reach = [
        sum((p - o) * a for p, o, a in zip(point, origin, axis))
        for edge in items(lambda: face.edges)
        for point in _points(edge)
    ]
    answered, normal = face.evaluator.getNormalAtPoint(face.pointOnFace)
    if not (reach and answered):
        return None
    foot = numbers(face.pointOnFace)
    along = sum((p - o) * a for p, o, a in zip(foot, origin, axis))
    outward = sum(n * (p - o - along * a) for n, p, o, a in zip(numbers(normal), foot, origin, axis))
    return {
        "origin_cm": origin,
        "axis": axis,
        "radius_cm": float(surface.radius),
        "low_cm": min(reach),
        "high_cm": max(reach),
        "area_cm2": float(face.area),
        "sense": "pin" if outward > 0.0 else "hole",
    }


def _points(edge) -> list:
    """Points that tell how far an edge reaches along the axis: a circle's centre, and the ends of all others."""
    curve = attempt(lambda: edge.geometry)
    if attempt(lambda: int(curve.curveType)) in (ARC, CIRCLE):
        return [numbers(curve.center)]
    ends = (attempt(lambda: numbers(edge.startVertex.geometry)), attempt(lambda: numbers(edge.endVertex.geometry)))
    return [point for point in ends if point]


def _markers(component) -> list:
    """Construction points whose name begins with `marker`."""
    found = []
    for point in items(lambda: component.constructionPoints):
        name = attempt(lambda p=point: str(p.name), "")
        place = attempt(lambda p=point: numbers(p.geometry))
        if name.lower().startswith(MARKER) and place:
            found.append({"name": name, "position_cm": place})
    return found
