"""Small mechanisms written by hand, for every question whose answer is known beforehand.

Parts are given in the world frame as they stand in the drawing; joint frames in both bodies follow from that, so that
every joint starts at q = 0.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from backend.mechanism.effect import Effect
from backend.mechanism.mechanism import Mechanism
from backend.mechanism.read import parse_mechanism

Z = (0.0, 0.0, 1.0)
DOWN = (0.0, -9.81, 0.0)
LEANING = (0.8, -9.7, 1.1)
WEIGHTLESS = (0.0, 0.0, 0.0)
PIN_RADIUS_M = 0.004

Document = dict[str, Any]


def effect(id: str, kind: str, on: Sequence[str] | str, **parameters: Any) -> Effect:
    """An effect as a drawing lists it."""
    return Effect(id=id, kind=kind, on=on, parameters=parameters)


def drawing(
    name: str,
    bodies: Sequence[Document],
    joints: Sequence[tuple],
    effects: Sequence[Effect] = (),
    markers: Sequence[tuple] = (),
    gravity: Sequence[float] = DOWN,
) -> Mechanism:
    """joints: (id, type, body_a, body_b, point_W, axis_W); markers: (id, body, point_W)."""
    ground = {"id": "ground", "fixed": True, "pose": pose((0, 0, 0), Rotation.identity())}
    placed = {b["id"]: b["pose"] for b in [ground, *bodies]}
    return parse_mechanism(
        {
            "schema_version": "1.0",
            "name": name,
            "gravity_m_per_s2": list(map(float, gravity)),
            "bodies": [ground, *bodies],
            "joints": [
                {
                    "id": id,
                    "type": type,
                    "body_a": a,
                    "body_b": b,
                    "frame_a": frame_in(placed[a], point, axis),
                    "frame_b": frame_in(placed[b], point, axis),
                    "fit": {"pin_diameter_m": 2 * PIN_RADIUS_M},
                }
                for id, type, a, b, point, axis in joints
            ],
            "effects": [e.model_dump(mode="json") for e in effects],
            "markers": [
                {"id": id, "body": body, "position_m": frame_in(placed[body], point, Z)["position_m"]}
                for id, body, point in markers
            ],
        }
    )


def document(mechanism: Mechanism) -> Document:
    """The drawing as plain data, to change and read again."""
    return mechanism.model_dump(mode="json", exclude_none=True)


def pose(position: Sequence[float], attitude: Rotation) -> Document:
    """A pose in W as a drawing writes it."""
    return {
        "position_m": [float(x) for x in position],
        "quaternion_wxyz": [float(x) for x in attitude.as_quat(scalar_first=True)],
    }


def attitude(placed: Document) -> Rotation:
    """The rotation R_WB of a drawn pose."""
    return Rotation.from_quat(placed["quaternion_wxyz"], scalar_first=True)


def towards(axis: Sequence[float]) -> Rotation:
    """A frame whose z points along `axis`."""
    z = np.asarray(axis, float) / np.linalg.norm(axis)
    helper = np.eye(3)[np.argmin(np.abs(z))]
    x = np.cross(helper, z) / np.linalg.norm(np.cross(helper, z))
    return Rotation.from_matrix(np.stack([x, np.cross(z, x), z], 1))


def frame_in(placed: Document, point_W: Sequence[float], axis_W: Sequence[float]) -> Document:
    """A joint's frame in a body, from where it stands in W."""
    back = attitude(placed).inv()
    return pose(back.apply(np.subtract(point_W, placed["position_m"])), back * towards(axis_W))


def body(
    id: str,
    position: Sequence[float],
    turned: Rotation,
    mass: float,
    inertia: np.ndarray,
    center: Sequence[float] = (0, 0, 0),
) -> Document:
    """inertia: about the centre of mass, (3,) principal moments in body axes or a (3, 3) tensor [kg m²]."""
    tensor = np.diag(inertia) if np.ndim(inertia) == 1 else np.asarray(inertia)
    moments = {a + b: float(tensor["xyz".index(a), "xyz".index(b)]) for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")}
    inertial = {"mass_kg": mass, "center_of_mass_m": [float(x) for x in center], "inertia_kg_m2": moments}
    return {"id": id, "pose": pose(position, turned), "inertial": inertial}


def bar_inertia(mass: float, length: float, width: float = 0.01) -> np.ndarray:
    """Principal moments of a square bar along x [kg m²]."""
    across = mass * (length**2 + width**2) / 12
    return np.array([mass * width**2 / 6, across, across])


def bar(id: str, start: Sequence[float], end: Sequence[float], mass: float | None = None) -> Document:
    """A bar whose origin is at `start` and whose x axis points to `end`; 0.3 kg per metre by default."""
    along = np.subtract(end, start, dtype=float)
    length = float(np.linalg.norm(along))
    mass = 0.3 * length if mass is None else mass
    x = along / length
    up = np.array(Z) if abs(x[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    y = np.cross(up, x) / np.linalg.norm(np.cross(up, x))
    turned = Rotation.from_matrix(np.stack([x, y, np.cross(x, y)], 1))
    return body(id, start, turned, mass, bar_inertia(mass, length), (length / 2, 0, 0))


def pendulum(
    angle: float = 0.5,
    length: float = 0.2,
    mass: float = 0.1,
    effects: Sequence[Effect] = (),
    gravity: Sequence[float] = DOWN,
) -> Mechanism:
    """A bar on one pin, `angle` from hanging straight down."""
    tip = (length * np.sin(angle), -length * np.cos(angle), 0.0)
    link = bar("link", (0, 0, 0), tip, mass)
    pins = [("pin", "revolute", "ground", "link", (0, 0, 0), Z)]
    return drawing("pendulum", [link], pins, effects, [("tip", "link", tip)], gravity)


def double_pendulum(effects: Sequence[Effect] = (), length: float = 0.2, mass: float = 0.1) -> Mechanism:
    """Two bars, both drawn level."""
    elbow, tip = (length, 0, 0), (2 * length, 0, 0)
    bars = [bar("upper", (0, 0, 0), elbow, mass), bar("lower", elbow, tip, mass)]
    pins = [
        ("shoulder", "revolute", "ground", "upper", (0, 0, 0), Z),
        ("elbow", "revolute", "upper", "lower", elbow, Z),
    ]
    return drawing("double pendulum", bars, pins, effects, [("tip", "lower", tip)])


def fourbar(
    effects: Sequence[Effect] = (), coupler_to: Sequence[float] = (0.28, 0.2), density: float = 0.3
) -> Mechanism:
    """Crank, coupler and rocker between two pins of the ground."""
    corners = np.array([[0, 0, 0], [0.05, 0.12, 0], [*coupler_to, 0], [0.25, 0, 0]], float)
    names = ["crank", "coupler", "rocker"]
    masses = density * np.linalg.norm(np.diff(corners, axis=0), axis=1)
    bars = [bar(n, corners[i], corners[i + 1], float(masses[i])) for i, n in enumerate(names)]
    ends = ["ground", *names, "ground"]
    pins = [(f"j{i + 1}", "revolute", ends[i], ends[i + 1], corners[i], Z) for i in range(4)]
    return drawing("fourbar", bars, pins, effects, [("knee", "coupler", corners[2])])


SPAN_M, SIDE_M = 0.2, 0.1


def parallelogram(effects: Sequence[Effect] = (), angle: float = 1.0) -> Mechanism:
    """Two equal cranks and a coupler; the ground is a bar between their pins, drawn with its mass."""
    across, up = SPAN_M * np.array([1.0, 0, 0]), SIDE_M * np.array([np.cos(angle), np.sin(angle), 0.0])
    corners = [0 * up, up, up + across, across]
    bars = [bar("crank", *corners[:2]), bar("coupler", *corners[1:3]), bar("rocker", corners[3], corners[2])]
    ends = ["ground", "crank", "coupler", "rocker", "ground"]
    pins = [(f"j{i + 1}", "revolute", ends[i], ends[i + 1], corners[i], Z) for i in range(4)]
    drawn = document(drawing("parallelogram", bars, pins, effects))
    drawn["bodies"][0]["inertial"] = bar("ground", corners[0], corners[3])["inertial"]
    return parse_mechanism(drawn)


def slider_crank(
    angle: float = 0.4, crank: float = 0.05, rod: float = 0.15, effects: Sequence[Effect] = ()
) -> Mechanism:
    """A crank, a rod and a block that slides along x."""
    pin = crank * np.array([np.cos(angle), np.sin(angle), 0.0])
    wrist = np.array([pin[0] + np.sqrt(rod**2 - pin[1] ** 2), 0.0, 0.0])
    block = body("block", wrist, Rotation.identity(), 0.05, np.array([2e-5, 2e-5, 3e-5]))
    parts = [bar("crank", (0, 0, 0), pin), bar("rod", pin, wrist), block]
    joints = [
        ("main", "revolute", "ground", "crank", (0, 0, 0), Z),
        ("crankpin", "revolute", "crank", "rod", pin, Z),
        ("wrist", "revolute", "rod", "block", wrist, Z),
        ("slide", "prismatic", "ground", "block", wrist, (1.0, 0, 0)),
    ]
    return drawing("slider-crank", parts, joints, effects)


def bennett(a: float = 0.2, twist: float = 0.6, b: float = 0.15, angle: float = 1.0) -> Mechanism:
    """Bennett's overconstrained loop: opposite links equal, a / sin α = b / sin β (Bennett 1903)."""
    other_twist = np.arcsin(b * np.sin(twist) / a)
    ratio = np.sin((other_twist + twist) / 2) / np.sin((other_twist - twist) / 2)
    other_angle = 2 * np.arctan(ratio / np.tan(angle / 2))
    where, turned = np.zeros(3), Rotation.identity()
    corners, axes = [where], [turned.apply(Z)]
    for joint, length, link_twist in (
        (angle, a, twist),
        (other_angle, b, other_twist),
        (-angle, a, twist),
        (-other_angle, b, other_twist),
    ):
        turned = turned * Rotation.from_rotvec([0, 0, joint])
        where = where + turned.apply([length, 0, 0])
        turned = turned * Rotation.from_rotvec([link_twist, 0, 0])
        corners.append(where)
        axes.append(turned.apply(Z))
    if np.linalg.norm(where) + turned.magnitude() > 1e-12:
        raise ValueError(f"the loop stays open by {np.linalg.norm(where):.3g} m and {turned.magnitude():.3g} rad")
    links = [bar(f"link{k}", corners[k], corners[k + 1]) for k in range(3)]
    ends = ["ground", "link0", "link1", "link2", "ground"]
    pins = [(f"j{k}", "revolute", ends[k], ends[k + 1], corners[k], axes[k]) for k in range(4)]
    return drawing("Bennett", links, pins, gravity=(1.0, -9.0, 3.0))


def scissor(
    cells: int, effects: Sequence[Effect] = (), half: float = 0.1, angle: float = 0.6, stiffness: float = 50.0
) -> Mechanism:
    """A row of crossed bars along x, hinged to the ground at one end, opened by a spring in the first cell."""
    c, s = half * np.cos(angle), half * np.sin(angle)
    bars, pins = [], []
    for i in range(cells):
        x = 2 * c * i
        bars.append(bar(f"a{i}", (x, -s, 0), (x + 2 * c, s, 0), 0.05))
        bars.append(bar(f"b{i}", (x, s, 0), (x + 2 * c, -s, 0), 0.05))
        pins.append((f"cross{i}", "revolute", f"a{i}", f"b{i}", (x + c, 0, 0), Z))
        if i:
            pins.append((f"top{i}", "revolute", f"a{i - 1}", f"b{i}", (x, s, 0), Z))
            pins.append((f"bottom{i}", "revolute", f"b{i - 1}", f"a{i}", (x, -s, 0), Z))
    pins.append(("root", "revolute", "ground", "a0", (0, -s, 0), Z))
    spring = effect(
        "spring",
        "extension_spring",
        ["a0", "b0"],
        anchor_a_m=[0, 0, 0],
        anchor_b_m=[0, 0, 0],
        stiffness_n_per_m=stiffness,
        free_length_m=float(half * np.sin(angle)),
    )
    tip = (2 * c * cells, s, 0)
    return drawing("scissor", bars, pins, [spring, *effects], [("tip", f"a{cells - 1}", tip)])


SKEW_INERTIA = np.array([[3.0, 0.4, -0.2], [0.4, 2.2, 0.3], [-0.2, 0.3, 1.4]]) * 1e-4


def free_body(effects: Sequence[Effect] = (), gravity: Sequence[float] = WEIGHTLESS) -> Mechanism:
    """An asymmetric body that nothing holds, its centre of mass away from its origin."""
    thrown = body(
        "stone", (0.1, -0.2, 0.3), Rotation.from_rotvec([0.3, 0.2, -0.5]), 0.2, SKEW_INERTIA, (0.01, 0.02, -0.03)
    )
    return drawing("free body", [thrown], [], effects, gravity=gravity)


def free_pair() -> Mechanism:
    """Two asymmetric bodies joined by a skew hinge, flying freely."""
    one = body("one", (0, 0, 0), Rotation.identity(), 0.2, SKEW_INERTIA, (0.0, 0.01, 0.0))
    two = body("two", (0.1, 0, 0), Rotation.from_rotvec([0.4, 0, 0.2]), 0.3, 2 * SKEW_INERTIA, (0.02, 0.0, 0.01))
    hinge = ("hinge", "revolute", "one", "two", (0.05, 0.01, 0.0), (0.3, 0.5, 0.8))
    return drawing("free pair", [one, two], [hinge], gravity=WEIGHTLESS)


def sliding_mass(effects: Sequence[Effect] = (), mass: float = 0.5, gravity: Sequence[float] = WEIGHTLESS) -> Mechanism:
    """A block on a straight rail along x."""
    block = body("block", (0, 0, 0), Rotation.identity(), mass, np.array([2e-4, 3e-4, 4e-4]))
    rail = ("rail", "prismatic", "ground", "block", (0, 0, 0), (1, 0, 0))
    return drawing("sliding mass", [block], [rail], effects, gravity=gravity)


def bead_on_bar(effects: Sequence[Effect] = ()) -> Mechanism:
    """A swinging bar with a bead that slides along it: one joint of each moving kind, motion that never repeats."""
    start, tip = np.zeros(3), np.array([0.16, -0.12, 0.0])
    bead = body("bead", 0.5 * tip, Rotation.identity(), 0.05, np.array([2e-5, 3e-5, 4e-5]), (0.002, 0.001, 0.0))
    joints = [
        ("pin", "revolute", "ground", "bar", start, Z),
        ("rail", "prismatic", "bar", "bead", 0.5 * tip, tip),
    ]
    return drawing(
        "bead on bar", [bar("bar", start, tip, 0.1), bead], joints, effects, [("bead", "bead", 0.5 * tip)], LEANING
    )


def spatial_fourbar(coupler_ends: tuple[str, str] = ("spherical", "spherical")) -> Mechanism:
    """A crank about z and a rocker about a skew axis, their ends held together by a coupler (RSSR, RSUR, ...)."""
    pivot, crank_end = np.zeros(3), np.array([0.05, 0.0, 0.0])
    hinge, axis = np.array([0.2, 0.05, 0.06]), np.array([0.3, 1.0, 0.2])
    rocker_end = hinge + np.array([-0.02, -0.03, 0.18])
    along = rocker_end - crank_end
    parts = [
        bar("crank", pivot, crank_end),
        bar("coupler", crank_end, rocker_end),
        bar("rocker", hinge, rocker_end),
    ]
    joints = [
        ("main", "revolute", "ground", "crank", pivot, Z),
        ("near", coupler_ends[0], "crank", "coupler", crank_end, along),
        ("far", coupler_ends[1], "rocker", "coupler", rocker_end, along),
        ("hinge", "revolute", "ground", "rocker", hinge, axis),
    ]
    return drawing("spatial four-bar", parts, joints, gravity=(1.0, -2.0, -9.0))
