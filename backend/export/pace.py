"""How fast the springs and dampers of a twin can be, and so how short a copy's step must be."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from backend.export.twin import Twin, TwinBody, TwinJoint, Vector

LONGEST_S = 2.5e-4  # step that keeps loops closed within 1e-7 m and motions within 1e-5 of a linkage's size
SHORTEST_S = 2e-5  # a copy with shorter steps is no use to anyone
RESOLVED = 1.0  # rate x step: the rates are upper bounds
UNSTABLE = 2.5  # rate x step: RK4 is stable up to 2.8


def steady_step(twin: Twin) -> float:
    """The longest step that resolves every spring and damper, between SHORTEST_S and LONGEST_S [s]."""
    fastest = max((rate for _, rate in _rates(twin)), default=0.0)
    return float(np.clip(RESOLVED / max(fastest, 1e-300), SHORTEST_S, LONGEST_S))


def stiffened(twin: Twin) -> tuple[Twin, list[str]]:
    """The twin with joints rigid whose springs no step resolves, such as the section of a link that hardly bends."""
    rigid, said = {}, []
    for joint in twin.joints:
        if joint.stiffness * _ease(twin, joint) > (RESOLVED / SHORTEST_S) ** 2:
            rigid[joint.id] = replace(joint, type="fixed", stiffness=0.0, preload=0.0, damping=0.0, dry=0.0, rotor=0.0)
            said.append(
                f"joint '{joint.id}': its spring of {joint.stiffness:.3g} is too stiff for any step: it is rigid"
            )
    joints = tuple(rigid.get(joint.id, joint) for joint in twin.joints)
    return replace(twin, joints=joints), said


def hasty(twin: Twin, step_s: float) -> list[str]:
    """A sentence for each spring and damper that a step does not resolve."""
    return [
        f"{what}: it acts within {1e3 / rate:.2g} ms, and steps of {1e3 * step_s:.3g} ms may not follow it"
        for what, rate in _rates(twin)
        if rate * step_s > UNSTABLE
    ]


def _rates(twin: Twin) -> Iterator[tuple[str, float]]:
    """Upper bounds of the rates [1/s] of what acts at joints and between bodies."""
    for joint in twin.joints:
        ease = _ease(twin, joint)
        yield f"joint '{joint.id}'", max(joint.damping * ease, float(np.sqrt(max(joint.stiffness, 0.0) * ease)))
    for spring in twin.springs:
        ends = ((spring.a, spring.p_A), (spring.b, spring.p_B))
        ease = sum(_ease_along(twin.body(id_), point) for id_, point in ends)
        yield f"effect '{spring.id}'", max(spring.damping * ease, float(np.sqrt(spring.stiffness * ease)))


def _ease(twin: Twin, joint: TwinJoint) -> float:
    """Inverse of the inertia that both bodies alone oppose along q, with the rotor beside it."""
    ease = 0.0
    for id_, axes in ((joint.a, joint.R_AF), (joint.b, joint.R_BF)):
        body = twin.body(id_)
        if not body.fixed:
            z = axes[:, 2]
            ease += 1.0 / body.mass if joint.type == "prismatic" else float(z @ np.linalg.solve(body.inertia, z))
    return ease / (1.0 + ease * joint.rotor)


def _ease_along(body: TwinBody, point: Vector) -> float:
    """The most that a unit force at a point accelerates the point."""
    if body.fixed:
        return 0.0
    arm = point - body.center
    return 1.0 / body.mass + float(arm @ arm) / float(np.linalg.eigvalsh(body.inertia)[0])
