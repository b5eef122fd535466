"""Small mechanisms written by hand, as mechanism.json documents."""

import numpy as np

REST = {"position_m": [0.0, 0.0, 0.0], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]}
GROUND = {"id": "ground", "fixed": True, "pose": REST}


def about_z(angle):
    return np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])


def turned(q, v):
    w, u = q[0], np.asarray(q[1:])
    return np.asarray(v) + 2 * np.cross(u, np.cross(u, v) + w * np.asarray(v))


def times(p, q):
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])


def body(id, p, q, mass, com, moments):
    xx, yy, zz = moments
    return {
        "id": id,
        "fixed": False,
        "pose": {"position_m": list(map(float, p)), "quaternion_wxyz": list(map(float, q))},
        "inertial": {
            "mass_kg": mass,
            "center_of_mass_m": list(map(float, com)),
            "inertia_kg_m2": {"xx": xx, "yy": yy, "zz": zz, "xy": 0.0, "xz": 0.0, "yz": 0.0},
        },
    }


def bar(id, start, end, mass=None, width=0.01):
    """A flat bar in the xy plane; its frame at `start`, x towards `end`, its centre of mass elsewhere."""
    d = np.subtract(end, start)
    length = float(np.linalg.norm(d))
    mass = 0.3 * length if mass is None else mass
    square = mass / 12
    moments = (2 * width**2 * square, (length**2 + width**2) * square, (length**2 + width**2) * square)
    return body(id, [*start, 0.0], about_z(np.arctan2(d[1], d[0])), mass, (length / 2, 0.0, 0.0), moments)


def frame_in(body, p_W, q_W):
    q = np.array(body["pose"]["quaternion_wxyz"])
    back = q * [1, -1, -1, -1]
    p = turned(back, np.subtract(p_W, body["pose"]["position_m"]))
    return {"position_m": p.tolist(), "quaternion_wxyz": times(back, np.asarray(q_W, float)).tolist()}


def joint(id, a, b, p_W, q_W=(1.0, 0.0, 0.0, 0.0), type="revolute"):
    return {
        "id": id,
        "type": type,
        "body_a": a["id"],
        "body_b": b["id"],
        "frame_a": frame_in(a, p_W, q_W),
        "frame_b": frame_in(b, p_W, q_W),
    }


def mechanism(bodies, joints, effects=(), markers=(), gravity=(0.0, -9.81, 0.0)):
    return {
        "schema_version": "1.0",
        "name": "by hand",
        "gravity_m_per_s2": list(gravity),
        "bodies": [GROUND, *bodies],
        "joints": list(joints),
        "effects": list(effects),
        "markers": list(markers),
    }


def effect(id, kind, on, **parameters):
    return {"id": id, "kind": kind, "on": on, "parameters": parameters}


def pendulum(angle=0.0, length=0.2, mass=0.1, effects=()):
    """Hanging straight down at q = 0 of the bar, drawn at `angle` from there."""
    down = -np.pi / 2 + angle
    link = bar("link", (0.0, 0.0), (length * np.cos(down), length * np.sin(down)), mass)
    tip = {"id": "tip", "body": "link", "position_m": [length, 0.0, 0.0]}
    return mechanism([link], [joint("j", GROUND, link, (0, 0, 0))], effects, [tip])


def double_pendulum():
    upper, lower = bar("upper", (0.0, 0.0), (0.2, 0.0), 0.1), bar("lower", (0.2, 0.0), (0.4, 0.0), 0.1)
    return mechanism([upper, lower], [joint("j1", GROUND, upper, (0, 0, 0)), joint("j2", upper, lower, (0.2, 0, 0))])


def fourbar(effects=()):
    P = [(0.0, 0.0), (0.05, 0.12), (0.28, 0.2), (0.25, 0.0)]
    crank, coupler, rocker = (bar(id, P[i], P[i + 1]) for i, id in enumerate(("crank", "coupler", "rocker")))
    pairs = [(GROUND, crank), (crank, coupler), (coupler, rocker), (rocker, GROUND)]
    return mechanism(
        [crank, coupler, rocker],
        [joint(f"j{i + 1}", a, b, (*P[i], 0.0)) for i, (a, b) in enumerate(pairs)],
        effects,
    )


SLIDE_X = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)  # z of the frame along x of W


def slider_crank(crank_m=0.05, rod_m=0.15, angle=1.0, effects=()):
    pin = np.array([crank_m * np.cos(angle), crank_m * np.sin(angle)])
    end = np.array([pin[0] + np.sqrt(rod_m**2 - pin[1] ** 2), 0.0])
    crank, rod = bar("crank", (0.0, 0.0), pin), bar("rod", pin, end)
    slider = body("slider", (*end, 0.0), (1.0, 0.0, 0.0, 0.0), 0.1, (0, 0, 0), (1e-5, 1e-5, 1e-5))
    return mechanism(
        [crank, rod, slider],
        [
            joint("j1", GROUND, crank, (0, 0, 0)),
            joint("j2", crank, rod, (*pin, 0)),
            joint("j3", rod, slider, (*end, 0)),
            joint("slide", GROUND, slider, (0, 0, 0), SLIDE_X, "prismatic"),
        ],
        effects,
    )


def scissor(cells, stiffness=200.0, effects=(), gravity=(0.0, 0.0, -9.81)):
    """Cells of two crossed 0.2 m bars along x, opened by a spring in the first; gravity along the pins."""
    half, angle = 0.1, 0.6
    c, s = half * np.cos(angle), half * np.sin(angle)
    bodies, joints = [], []
    for i in range(cells):
        x = 2 * c * i
        rising = bar(f"a{i}", (x, -s), (x + 2 * c, s), 0.05)
        falling = bar(f"b{i}", (x, s), (x + 2 * c, -s), 0.05)
        joints.append(joint(f"centre{i}", rising, falling, (x + c, 0, 0)))
        if i:
            joints.append(joint(f"top{i}", bodies[-2], falling, (x, s, 0)))
            joints.append(joint(f"bottom{i}", bodies[-1], rising, (x, -s, 0)))
        bodies += [rising, falling]
    joints.append(joint("root", GROUND, bodies[0], (0, -s, 0)))
    spring = effect(
        "spring",
        "extension_spring",
        ["a0", "b0"],
        anchor_a_m=[0.0, 0.0, 0.0],
        anchor_b_m=[0.0, 0.0, 0.0],
        stiffness_n_per_m=stiffness,
        free_length_m=1.5 * s,  # it swings back before the bars lie flat
    )
    return mechanism(bodies, joints, [spring, *effects], gravity=gravity)


def sliding_mass(speed_axis=SLIDE_X, effects=(), gravity=(0.0, 0.0, -9.81)):
    mass = body("mass", (0, 0, 0), (1.0, 0.0, 0.0, 0.0), 0.5, (0.01, 0.0, 0.0), (1e-4, 1e-4, 1e-4))
    return mechanism([mass], [joint("slide", GROUND, mass, (0, 0, 0), speed_axis, "prismatic")], effects, (), gravity)


def bennett(a=0.2, alpha=0.6, b=0.15, turn=1.0):
    """Bennett's 4R: opposite links equal, a / sin α = b / sin β; every axis points elsewhere."""
    beta = np.arcsin(b * np.sin(alpha) / a)

    def link(theta, length, twist):
        """Denavit and Hartenberg's link (1955)."""
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(twist), np.sin(twist)
        rows = [[ct, -st * ca, st * sa, length * ct], [st, ct * ca, -ct * sa, length * st], [0, sa, ca, 0]]
        return np.array([*rows, [0, 0, 0, 1]])

    ratio = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    other = 2 * np.arctan(ratio / np.tan(turn / 2))
    chain = [np.eye(4)]
    for theta, length, twist in ((turn, a, alpha), (other, b, beta), (-turn, a, alpha), (-other, b, beta)):
        chain.append(chain[-1] @ link(theta, length, twist))
    if not np.allclose(chain[4], np.eye(4), atol=1e-12):
        raise ValueError("these numbers close no Bennett linkage")
    corners, axes = [T[:3, 3] for T in chain[:4]], [T[:3, 2] for T in chain[:4]]
    links = []
    for k in range(3):
        mass = 0.3 * float(np.linalg.norm(corners[k + 1] - corners[k]))
        centre = 0.5 * (corners[k] + corners[k + 1])
        links.append(body(f"link{k}", corners[k], (1.0, 0, 0, 0), mass, centre - corners[k], (2e-5, 3e-5, 4e-5)))
    parts = [GROUND, *links, GROUND]
    joints = [joint(f"j{k}", parts[k], parts[k + 1], corners[k], towards(axes[k])) for k in range(4)]
    return mechanism(links, joints)


def towards(axis):
    """The rotation that brings z to `axis`."""
    w = np.array([1.0 + axis[2], -axis[1], axis[0], 0.0])
    return w / np.linalg.norm(w)


def loose_pin(place=(0.0, 0.0), mass=0.1, gravity=(0.0, -9.81, 0.0), radius=0.004, **play):
    """A body on a pin of the ground's hole, its centre of mass on the pin's axis, drawn somewhere in the hole."""
    pin = body("pin", (*place, 0.0), (1.0, 0, 0, 0), mass, (0, 0, 0), (1e-5, 1e-5, 1e-5))
    hole = {**joint("j", GROUND, pin, (0, 0, 0)), "frame_b": {**REST}}
    if radius:
        hole["fit"] = {"pin_diameter_m": 2 * radius}
    return mechanism([pin], [hole], [effect("play", "clearance", ["j"], **play)], gravity=gravity)


def roller(slope=0.0, height=0.0, radius=0.01, mass=0.1, **contact):
    """A solid round bar along z above a round rail along x, in a planar joint; gravity leans by `slope` along x."""
    bar = body("bar", (0, radius + 0.02 + height, 0), (1.0, 0, 0, 0), mass, (0, 0, 0), 3 * (0.5 * mass * radius**2,))
    touch = effect(
        "touch",
        "link_contact",
        ["ground", "bar"],
        start_a_m=[-1.0, 0, 0],
        end_a_m=[1.0, 0, 0],
        radius_a_m=0.02,
        start_b_m=[0, 0, -0.05],
        end_b_m=[0, 0, 0.05],
        radius_b_m=radius,
        **contact,
    )
    leaning = (9.81 * np.sin(slope), -9.81 * np.cos(slope), 0.0)
    return mechanism([bar], [joint("j", GROUND, bar, (0, 0, 0), type="planar")], [touch], gravity=leaning)


def falls_on(post, **contact):
    """A bar that falls about z on a round post along z beside its way, which stands still or swings about y."""
    falling = bar("falling", (0, 0), (0.2 * np.sin(1.2), -0.2 * np.cos(1.2)))
    along_z = np.array([np.sqrt(0.5), 0.0, -np.sqrt(0.5), 0.0])
    foot = np.array([0.05, -0.12, -0.1])
    standing = body("post", foot, along_z, 0.06, (0.1, 0, 0), (1e-6, 2e-4, 2e-4))
    standing["fixed"] = not post
    meet = effect(
        "meet",
        "link_contact",
        ["falling", "post"],
        **{f"{end}_{side}_m": [x, 0, 0] for side in "ab" for end, x in (("start", 0.0), ("end", 0.2))},
        radius_a_m=0.01,
        radius_b_m=0.01,
        **contact,
    )
    hinges = [joint("j", GROUND, falling, (0, 0, 0))]
    hinges += [joint("foot", GROUND, standing, foot, towards(np.array([0.0, 1.0, 0.0])))] if post else []
    return mechanism([falling, standing], hinges, [meet])


def two_links(type):
    """A bar on a ball joint, and a second bar on its end by a joint of the type: nothing lies in one plane."""
    upper = body("upper", (0, 0, 0), (1.0, 0, 0, 0), 0.1, (0.1, 0, 0), (2e-5, 3.4e-4, 3.4e-4))
    lower = body("lower", (0.2, 0, 0), (1.0, 0, 0, 0), 0.08, (0.03, 0.08, 0.02), (2e-4, 3e-5, 2.1e-4))
    tilted = towards(np.array([0.36, 0.48, 0.8]))
    joints = [
        joint("ball", GROUND, upper, (0, 0, 0), tilted, "spherical"),
        joint("j", upper, lower, (0.2, 0, 0), tilted, type),
    ]
    return mechanism([upper, lower], joints, gravity=(1.0, -9.0, 3.0))
