"""Start poses and rates that meet every joint, and the joint rows that are enough to hold them.

Maximal coordinates: each moving body has (dp, dφ) in W, and each joint six rows (see poses.joint_rows).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from backend.blind.drawing import Drawing
from backend.blind.poses import (
    COORDINATE,
    MET,
    Poses,
    cross_matrix,
    joint_frame,
    joint_rows,
    rotation_by,
    size_m,
)

CLOSED = 1e-12  # of the mechanism's size: a few hundred roundings
ROUNDED = 1e-6  # of the mechanism's size: drawings carry seven digits
RANK = 1e-6  # of a unit row: rounding leaves 1e-13 on a redundant row, a true one is far above


def drawn_poses(drawing: Drawing) -> Poses:
    """As drawn, at rest."""
    n = len(drawing.bodies)
    p = np.array([body.p_WB for body in drawing.bodies])
    R = np.array([body.R_WB for body in drawing.bodies])
    return Poses(p, R, np.zeros((n, 3)), np.zeros((n, 3)))


def row_jacobian(drawing: Drawing, poses: Poses) -> np.ndarray:
    """(joints, 6, 6 x moving): slopes of the joint rows; lengths count in the mechanism's size."""
    column = {body: 6 * k for k, body in enumerate(drawing.moving)}
    scale = size_m(drawing)
    J = np.zeros((len(drawing.joints), 6, 6 * len(column)))
    for rows, joint in zip(J, drawing.joints, strict=True):
        _, R_WA = joint_frame(poses, joint.a, joint.p_AF, joint.R_AF)
        p_WB, _ = joint_frame(poses, joint.b, joint.p_BF, joint.R_BF)
        for body, sign in ((joint.a, -1.0), (joint.b, 1.0)):
            if body not in column:
                continue
            k = column[body]
            rows[:3, k : k + 3] = sign * R_WA.T
            rows[:3, k + 3 : k + 6] = -sign * R_WA.T @ cross_matrix(p_WB - poses.p_WB[body]) / scale
            rows[3:, k + 3 : k + 6] = sign * R_WA.T
            if joint.type == "universal":
                x_b = poses.R_WB[joint.b] @ joint.R_BF[:, 0]
                rows[5, k + 3 : k + 6] = sign * np.cross(x_b, R_WA[:, 1])
    return J


def constraint_jacobian(drawing: Drawing, poses: Poses, still: bool = False) -> np.ndarray:
    """The rows of row_jacobian that the joints hold, joint by joint; still: loose pins stay where they are in holes."""
    J = row_jacobian(drawing, poses)
    held = [J[i, MET[joint.type] if still else joint.held, :] for i, joint in enumerate(drawing.joints)]
    return np.concatenate(held) if held else np.zeros((0, J.shape[2]))


def _solve(C: np.ndarray, c: np.ndarray, G: np.ndarray, g: np.ndarray) -> np.ndarray:
    """x with C x = c (least squares where it cannot) that brings G x nearest to g."""
    if not len(C):
        return np.linalg.lstsq(G, g, rcond=RANK)[0]
    U, s, Vt = np.linalg.svd(C)
    rank = int((s > RANK * s[0]).sum())
    x = Vt[:rank].T @ ((U.T @ c)[:rank] / s[:rank])
    Z = Vt[rank:].T
    return x + Z @ np.linalg.lstsq(G @ Z, g - G @ x, rcond=RANK)[0]


def assemble(drawing: Drawing, joint_positions: Mapping[str, float] | None = None) -> Poses:
    """Poses that meet every joint, near the drawn ones, with the named joints at their positions [rad or m].

    Joints that are not named stay as near to the drawing as the loops let them.  ValueError if none closes.
    """
    poses = drawn_poses(drawing)
    scale, wanted = size_m(drawing), dict(joint_positions or {})
    _check_names(drawing, wanted)
    start = _coordinates(drawing, poses)
    goal = {id: _nearest_turn(drawing, id, value, start[id]) for id, value in wanted.items()}
    far = max((abs(goal[id] - start[id]) for id in goal), default=0.0)
    parts = max(1, int(np.ceil(far / (0.1 * min(1.0, scale)))))  # short ways, so that Newton keeps its branch
    for part in range(1, parts + 1):
        target = {id: start[id] + (goal[id] - start[id]) * part / parts for id in goal}
        for _ in range(30):
            if _correct(drawing, poses, target, start) < CLOSED * 10:
                break
        else:
            asked = " with " + ", ".join(f"{id} = {value:g}" for id, value in wanted.items()) if wanted else ""
            raise ValueError(
                f"the joints stay open by {_miss(drawing, poses):.3g} m{asked}; "
                "check the drawn poses and joint frames, or ask for positions that the loops allow"
            )
    return poses


def _correct(drawing: Drawing, poses: Poses, target: Mapping[str, float], start: Mapping[str, float]) -> float:
    """One Gauss-Newton step, in place; returns its size, lengths in the mechanism's size."""
    scale = size_m(drawing)
    J, rows = row_jacobian(drawing, poses), [joint_rows(joint, poses) for joint in drawing.joints]
    rows_at = _places(drawing)
    units = np.array([scale, scale, scale, 1.0, 1.0, 1.0])
    C, c, G, g = [], [], [], []
    for i, joint in enumerate(drawing.joints):
        for k in MET[joint.type]:
            C.append(J[i, k])
            c.append((rows_at[i][k] - rows[i][k]) / units[k])
        if joint.moves:
            k = COORDINATE[joint.type]
            wish = target.get(joint.id, start[joint.id]) - rows[i][k]
            if joint.turns:
                wish = (wish + np.pi) % (2 * np.pi) - np.pi
            matrix, right = (C, c) if joint.id in target else (G, g)
            matrix.append(J[i, k])
            right.append(wish / units[k])
    n = J.shape[2]
    x = _solve(np.reshape(C, (-1, n)), np.array(c), np.reshape(G, (-1, n)), np.array(g))
    x *= min(1.0, 0.3 / max(np.abs(x).max(initial=0.0), 1e-300))
    for k, body in enumerate(drawing.moving):
        poses.p_WB[body] += scale * x[6 * k : 6 * k + 3]
        poses.R_WB[body] = rotation_by(x[6 * k + 3 : 6 * k + 6]) @ poses.R_WB[body]
    missed = _miss(drawing, poses) / scale
    return max(missed, float(np.abs(x).max(initial=0.0)) * 1e-3)  # the last step is quadratically too small


def _miss(drawing: Drawing, poses: Poses) -> float:
    """Largest unmet row [m]."""
    units = np.array([1.0, 1.0, 1.0, *3 * [size_m(drawing)]])
    rows = [
        np.abs(units * (joint_rows(joint, poses) - place))[list(MET[joint.type])].max()
        for joint, place in zip(drawing.joints, _places(drawing), strict=True)
    ]
    return float(max(rows, default=0.0))


def _places(drawing: Drawing) -> list[np.ndarray]:
    """Where each joint's held rows start: at zero, but a loose pin where it was drawn in its hole."""
    drawn, places = drawn_poses(drawing), []
    for joint in drawing.joints:
        place = np.zeros(6)
        if joint.play:
            offset = joint_rows(joint, drawn)[:2]
            if np.linalg.norm(offset) > ROUNDED * size_m(drawing):  # else it is a rounded zero
                place[:2] = offset
        places.append(place)
    return places


def _coordinates(drawing: Drawing, poses: Poses) -> dict[str, float]:
    return {j.id: float(joint_rows(j, poses)[COORDINATE[j.type]]) for j in drawing.joints if j.moves}


def _nearest_turn(drawing: Drawing, id: str, value: float, near: float) -> float:
    joint = next(joint for joint in drawing.joints if joint.id == id)
    return near + (value - near + np.pi) % (2 * np.pi) - np.pi if joint.turns else value


def _check_names(drawing: Drawing, named: Mapping[str, float]) -> None:
    known = [joint.id for joint in drawing.joints if joint.moves]
    if unknown := sorted(set(named) - set(known)):
        raise ValueError(f"no moving joint is called {', '.join(unknown)}; known: {', '.join(known)}")


def set_in_motion(drawing: Drawing, poses: Poses, joint_velocities: Mapping[str, float] | None) -> None:
    """Give the bodies the velocities that the named joint rates [rad/s or m/s] ask for, in place.

    Joints not named move as little as the loops let them.  ValueError where rates contradict the loops.
    """
    wanted = dict(joint_velocities or {})
    _check_names(drawing, wanted)
    if not any(wanted.values()):
        return
    scale, J = size_m(drawing), row_jacobian(drawing, poses)
    C, c, G = (
        [*constraint_jacobian(drawing, poses, still=True)],
        [0.0] * sum(len(MET[j.type]) for j in drawing.joints),
        [],
    )
    for i, joint in enumerate(drawing.joints):
        if joint.id in wanted:
            C.append(J[i, COORDINATE[joint.type]])
            c.append(wanted[joint.id] / (1.0 if joint.turns else scale))
        elif joint.moves:
            G.append(J[i, COORDINATE[joint.type]])
    n = J.shape[2]
    x = _solve(np.array(C), np.array(c), np.reshape(G, (-1, n)), np.zeros(len(G)))
    miss = np.abs(np.array(C) @ x - c).max()
    if miss > 1e-8 * (1.0 + np.abs(c).max()):
        raise ValueError(
            f"the joint rates {wanted} contradict the loops by {miss:.3g} rad/s; give the rate of one joint per freedom"
        )
    for k, body in enumerate(drawing.moving):
        poses.v_WB[body] = scale * x[6 * k : 6 * k + 3]
        poses.w_WB_B[body] = poses.R_WB[body].T @ x[6 * k + 3 : 6 * k + 6]


def spanning_tree(drawing: Drawing) -> list[tuple[int, int, int]]:
    """Joints of a breadth-first tree from the fixed bodies: (joint, parent body, child body)."""
    return _forest(drawing)[0]


def roots(drawing: Drawing) -> list[int]:
    """Moving bodies that no joint ties to a fixed one, one for each group: they float."""
    return _forest(drawing)[1]


def _forest(drawing: Drawing) -> tuple[list[tuple[int, int, int]], list[int]]:
    reached = [i for i, body in enumerate(drawing.bodies) if body.fixed]
    seen, edges, floating, front = set(reached), [], [], 0
    while True:
        while front < len(reached):
            here, front = reached[front], front + 1
            for k, joint in enumerate(drawing.joints):
                for there in {joint.a, joint.b} - {here} if here in (joint.a, joint.b) else ():
                    if there not in seen:
                        seen.add(there)
                        reached.append(there)
                        edges.append((k, here, there))
        rest = [i for i in drawing.moving if i not in seen]
        if not rest:
            return edges, floating
        seen.add(rest[0])
        reached.append(rest[0])
        floating.append(rest[0])


def independent_rows(drawing: Drawing, poses: Poses) -> list[tuple[int, ...]]:
    """For each joint, the rows (0..5) that together hold all that the joints hold, and nothing twice.

    A tree's rows are independent; closing joints' rows are taken by pivoting until the rest follow.
    The rank is judged a little way along the mechanism's free motion, because a toggle hides rows.
    """
    tree = {k for k, _, _ in spanning_tree(drawing)}
    J = constraint_jacobian(drawing, _nudged(drawing, poses))
    labels = [(i, k) for i, joint in enumerate(drawing.joints) for k in joint.held]
    first = [r for r, (i, _) in enumerate(labels) if i in tree]
    later = [r for r, (i, _) in enumerate(labels) if i not in tree]
    taken = list(first)
    Q = np.linalg.qr(J[first].T)[0] if first else np.zeros((J.shape[1], 0))
    rest = J[later] - (J[later] @ Q) @ Q.T
    while len(later):
        norms = np.linalg.norm(rest, axis=1)
        best = int(norms.argmax())
        if norms[best] < RANK:
            break
        direction = rest[best] / norms[best]
        taken.append(later[best])
        rest = rest - np.outer(rest @ direction, direction)
        rest[best] = 0.0
    kept = {labels[r] for r in taken}
    return [tuple(k for k in j.held if (i, k) in kept) for i, j in enumerate(drawing.joints)]


def row_margin(drawing: Drawing, poses: Poses, kept: list[tuple[int, ...]]) -> float:
    """How well the kept rows stand for all of them: ratio of the smallest singular values, 1 at best.

    It is 1, and stays so, where the rows left out only repeat what the kept rows hold squarely (a planar loop).
    Below, as on Bennett's loop, the kept rows may lose rank on the way where the whole does not.
    """
    if all(held == joint.held for held, joint in zip(kept, drawing.joints, strict=True)):
        return 1.0
    near = _nudged(drawing, poses)
    J = row_jacobian(drawing, near)
    rows = [J[i, list(held)] for i, held in enumerate(kept)]
    smallest = [np.linalg.svd(M, compute_uv=False) for M in (np.concatenate(rows), constraint_jacobian(drawing, near))]
    rank = len(smallest[0])
    return float(smallest[0][rank - 1] / smallest[1][rank - 1])


def _nudged(drawing: Drawing, poses: Poses) -> Poses:
    """A neighbouring pose that closes, a hundredth along the free motions; the same where there are none."""
    C = constraint_jacobian(drawing, poses, still=True)
    Vt, s = np.linalg.svd(C)[2], np.linalg.svd(C, compute_uv=False)
    free = Vt[int((s > RANK * s.max(initial=1.0)).sum()) :]
    if not len(free):
        return poses
    x = free.T @ np.cos(1.0 + np.arange(len(free)))  # any generic mixture of the freedoms
    x *= 0.01 / np.abs(x).max()
    near = Poses(poses.p_WB.copy(), poses.R_WB.copy(), poses.v_WB, poses.w_WB_B)
    for k, body in enumerate(drawing.moving):
        near.p_WB[body] += size_m(drawing) * x[6 * k : 6 * k + 3]
        near.R_WB[body] = rotation_by(x[6 * k + 3 : 6 * k + 6]) @ near.R_WB[body]
    start = _coordinates(drawing, near)
    for _ in range(20):
        if _correct(drawing, near, {}, start) < 1e-9:
            return near
    return poses
