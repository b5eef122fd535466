"""Bundle adjustment of one camera that stands still: lens, pose and heights from bed marks and moving bars.

Triggs et al. (2000), "Bundle adjustment".  Unknown are what the camera is (one set for all frames) and where each dot
was in each frame; those places touch their own frame alone and are eliminated there (Schur complement).  What is known
beforehand of lens and heights is a normal prior, z ~ N(0, 1) along each of its axes, so that a camera calibrated with
a board, a phone of which nothing is known, and heights given or not are one problem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from backend.observe.bars import Bar
from backend.observe.plane import Plane
from backend.observe.viewpoint import LENS, POSE, Viewpoint

PLAY_M = 2e-5  # pins wander so much within their holes from frame to frame
MOST_STEPS = 2000  # focal length and distance err together: along that valley hundreds are taken, each a little
SETTLED = 1e-9  # of the objective: a step that gains less is the last


@dataclass(frozen=True)
class Prior:
    """What is known of lens (camera.PARAMETERS) and heights [m] before this clip: mean, and columns of scatter.

    root: covariance = root @ root.T; values that are held have rows of zeros.
    """

    lens: Float[np.ndarray, "9"]
    heights_m: Float[np.ndarray, "marker"]
    root: Float[np.ndarray, "lens_and_heights k"]

    @classmethod
    def of(cls, lens: np.ndarray, heights_m: np.ndarray, covariance: np.ndarray) -> Prior:
        """From a covariance, which may be singular."""
        size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        values, axes = np.linalg.eigh(covariance / np.outer(size, size))
        kept = values > 1e-13 * max(values.max(), 0.0)
        return cls(lens, heights_m, size[:, None] * axes[:, kept] * np.sqrt(values[kept]))


@dataclass(frozen=True)
class Marks:
    """Points in the plane of the bed: where they are (x, y) [m], where they are seen [px], and how well.

    sd_px: of each mark, along each axis; the error of its place on the bed counts there too.
    """

    metres: Float[np.ndarray, "mark 2"]
    px: Float[np.ndarray, "mark 2"]
    sd_px: Float[np.ndarray, "mark"]


@dataclass(frozen=True)
class Dots:
    """Tracked dots of a few frames [px], NaN where unseen, their covariance, and what is known of their distances."""

    px: Float[np.ndarray, "frame marker 2"]
    cov_px2: Float[np.ndarray, "frame marker 2 2"]
    bars: Sequence[Bar] = ()
    bar_sd_m: float = 1e-4

    @classmethod
    def none(cls, markers: int) -> Dots:
        """No frame at all."""
        return cls(np.zeros((0, markers, 2)), np.zeros((0, markers, 2, 2)))


@dataclass(frozen=True)
class Bundle:
    """The camera that explains all, its heights [m], and the covariance of lens, pose and heights.

    bar_error_m: how much longer each bar is than drawn.  misfit: root of chi-square per degree of freedom.
    """

    view: Viewpoint
    heights_m: Float[np.ndarray, "marker"]
    covariance: Float[np.ndarray, "all all"]
    bar_error_m: Float[np.ndarray, "bar"]
    bar_sd_m: Float[np.ndarray, "bar"]
    misfit: float
    mark_rms_px: float


def adjust(plane: Plane, start: Viewpoint, prior: Prior, marks: Marks, dots: Dots) -> Bundle:
    """The most probable camera.  start: a first guess of its pose; of the lens the prior's mean is the first."""
    problem = _Problem(plane, prior, marks, dots)
    state = problem.begin(start)
    now, damping = problem.linearise(state), 1e-4
    for _ in range(MOST_STEPS):
        trial = problem.moved(state, *now.step(damping))
        then = problem.linearise(trial)
        gained = now.cost - then.cost
        if gained >= 0:
            state, now, damping = trial, then, max(damping / 5, 1e-12)
            if gained <= SETTLED * now.cost:
                break
        else:
            damping *= 10
            if damping > 1e8:
                break
    return problem.told(state, now)


@dataclass(frozen=True)
class _State:
    """z: along the prior's axes; longer: bars than drawn [m]; xy: of every dot in every frame, on the bed [m]."""

    z: np.ndarray
    view: Viewpoint
    longer: np.ndarray
    xy: np.ndarray


@dataclass(frozen=True)
class _Linear:
    """Whitened residuals and slopes: r0, J0 of what concerns all frames; r, by_own, by_all of each frame."""

    r0: Float[np.ndarray, "n0"]
    J0: Float[np.ndarray, "n0 all"]
    r: Float[np.ndarray, "frame n"]
    by_own: Float[np.ndarray, "frame n own"]
    by_all: Float[np.ndarray, "frame n all"]
    unseen: Float[np.ndarray, "frame own own"]

    @property
    def cost(self) -> float:
        """Sum of squares; infinite where a point fell behind the camera."""
        cost = float(self.r0 @ self.r0 + np.sum(self.r**2))
        return cost if np.isfinite(cost) else np.inf

    def reduced(self, damping: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Normal equations of what concerns all, each frame's own eliminated, and how its own follow."""
        own = np.einsum("fni,fnj->fij", self.by_own, self.by_own) + self.unseen
        own = own + damping * np.einsum("fii,ij->fij", own, np.eye(own.shape[1]))
        both = np.einsum("fni,fna->fia", self.by_own, self.by_all)
        pull = np.einsum("fni,fn->fi", self.by_own, self.r)
        follow = np.linalg.solve(own, np.concatenate([both, pull[..., None]], 2))
        H = self.J0.T @ self.J0 + np.einsum("fna,fnb->ab", self.by_all, self.by_all)
        g = self.J0.T @ self.r0 + np.einsum("fna,fn->a", self.by_all, self.r)
        H = H + damping * np.diag(np.diag(H)) - np.einsum("fia,fib->ab", both, follow[..., :-1])
        return H, g - np.einsum("fia,fi->a", both, follow[..., -1]), follow[..., :-1], follow[..., -1]

    def step(self, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """The Levenberg-Marquardt step of what concerns all, and of each frame's own."""
        H, g, follow, alone = self.reduced(damping)
        common = -np.linalg.solve(H, g)
        return common, -(alone + follow @ common)


class _Problem:
    def __init__(self, plane: Plane, prior: Prior, marks: Marks, dots: Dots):
        self.plane, self.prior, self.marks, self.dots = plane, prior, marks, dots
        self.frames, self.count = dots.px.shape[:2]
        self.k, self.size = prior.root.shape[1], prior.root.shape[1] + POSE + len(dots.bars)
        self.a = np.array([b.a for b in dots.bars], int)
        self.b = np.array([b.b for b in dots.bars], int)
        self.length = np.array([b.length_m for b in dots.bars])
        self.seen = np.isfinite(dots.px[..., 0])
        cov = np.where(self.seen[..., None, None], dots.cov_px2, np.eye(2))
        self.white = np.linalg.inv(np.linalg.cholesky(cov)) * self.seen[..., None, None]
        both_seen = self.seen[:, self.a] & self.seen[:, self.b]
        self.grip = both_seen / PLAY_M

    def begin(self, start: Viewpoint) -> _State:
        view = Viewpoint(self.prior.lens, start.R_CW, start.p_WC)
        xy = np.zeros(self.dots.px.shape)
        for f, px in enumerate(self.dots.px):
            seen = self.seen[f]
            xy[f, seen] = view.on_plane(px[seen], self.plane, self.prior.heights_m[seen])
        return _State(np.zeros(self.k), view, np.zeros(len(self.length)), xy)

    def moved(self, state: _State, common: np.ndarray, own: np.ndarray) -> _State:
        z = state.z + common[: self.k]
        lens = self.prior.lens + self.prior.root[:LENS] @ z
        view = state.view.moved(np.r_[lens - state.view.values, common[self.k : self.k + POSE]])
        return _State(z, view, state.longer + common[self.k + POSE :], state.xy + own.reshape(state.xy.shape))

    def heights(self, state: _State) -> np.ndarray:
        return self.prior.heights_m + self.prior.root[LENS:] @ state.z

    def linearise(self, state: _State) -> _Linear:
        # How lens and pose move with what is unknown of all frames.
        by_all = np.zeros((LENS + POSE, self.size))
        by_all[:LENS, : self.k] = self.prior.root[:LENS]
        by_all[LENS:, self.k : self.k + POSE] = np.eye(POSE)
        expected = np.r_[np.ones(self.k), np.zeros(POSE), np.full(len(self.length), 1 / self.dots.bar_sd_m)]
        known = np.diag(expected)[expected > 0]
        flat = self.plane.at(np.c_[self.marks.metres, np.zeros(len(self.marks.metres))])
        weight = 1 / self.marks.sd_px[:, None]
        off = ((state.view.pixels(flat) - self.marks.px) * weight).ravel()
        slope = (state.view.slopes(flat)[0] @ by_all * weight[..., None]).reshape(-1, self.size)
        values = np.r_[state.z, state.longer / self.dots.bar_sd_m]
        r, by_own, by_common = self._of_frames(state, by_all)
        return _Linear(
            np.r_[values, off], np.r_[known, slope], r, by_own, by_common,
            np.einsum("fi,ij->fij", np.repeat(~self.seen, 2, axis=1), np.eye(2 * self.count)),
        )  # fmt: skip

    def _of_frames(self, state: _State, by_all: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        F, M, B, axes = self.frames, self.count, len(self.length), self.plane.axes()
        toward = np.sign(self.plane.from_world(state.view.p_WC)[2])
        height = np.broadcast_to(toward * self.heights(state), (F, M))
        p_W = self.plane.at(np.concatenate([state.xy, height[..., None]], 2)).reshape(-1, 3)
        by_view, by_point = (s.reshape(F, M, 2, s.shape[-1]) for s in state.view.slopes(p_W))
        miss = state.view.pixels(p_W).reshape(F, M, 2) - np.where(self.seen[..., None], self.dots.px, 0.0)
        by_common = by_view @ by_all
        by_common[..., : self.k] += toward * np.einsum("fmiw,w,mk->fmik", by_point, axes[2], self.prior.root[LENS:])
        by_place = np.zeros((F, M, 2, M, 2))
        by_place[:, np.arange(M), :, np.arange(M)] = np.moveaxis(self.white @ by_point @ axes[:2].T, 1, 0)
        apart = state.xy[:, self.a] - state.xy[:, self.b]
        away = np.linalg.norm(apart, axis=2)
        along = np.divide(apart, away[..., None], out=np.zeros_like(apart), where=away[..., None] > 0)
        by_length, bar = np.zeros((F, B, M, 2)), np.arange(B)
        by_length[:, bar, self.a] += along * self.grip[..., None]
        by_length[:, bar, self.b] -= along * self.grip[..., None]
        longer = np.zeros((F, B, self.size))
        longer[:, bar, self.k + POSE + bar] = -self.grip
        r = np.concatenate(
            [
                np.einsum("fmij,fmj->fmi", self.white, miss).reshape(F, 2 * M),
                self.grip * (away - self.length - state.longer),
            ], 1,
        )  # fmt: skip
        by_own = np.concatenate([by_place.reshape(F, 2 * M, 2 * M), by_length.reshape(F, B, 2 * M)], 1)
        return r, by_own, np.concatenate([(self.white @ by_common).reshape(F, 2 * M, self.size), longer], 1)

    def told(self, state: _State, linear: _Linear) -> Bundle:
        inverse = np.linalg.inv(linear.reduced()[0])
        marks = linear.r0[-2 * len(self.marks.px) :].reshape(-1, 2) * self.marks.sd_px[:, None]
        data = 2 * len(self.marks.px) + 2 * int(self.seen.sum()) + int((self.grip > 0).sum())
        # Each value with a prior brings a row of its own; pose and places do not.
        free = data - POSE - 2 * int(self.seen.sum())
        misfit = float(np.sqrt(linear.cost / max(free, 1)))
        inverse = inverse * max(misfit, 1.0) ** 2
        to_all = np.zeros((LENS + POSE + self.count, self.size))
        to_all[:LENS, : self.k] = self.prior.root[:LENS]
        to_all[LENS : LENS + POSE, self.k : self.k + POSE] = np.eye(POSE)
        to_all[LENS + POSE :, : self.k] = self.prior.root[LENS:]
        spread = np.sqrt(np.diag(inverse)[self.k + POSE :])
        return Bundle(
            state.view, self.heights(state), to_all @ inverse @ to_all.T, state.longer, spread, misfit,
            float(np.sqrt(np.mean(marks**2))),
        )  # fmt: skip
