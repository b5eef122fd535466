"""What no effect of the library is needed for: unknown smooth forces at joints, unknown smooth shifts in the picture.

r ~ N(J x + L a, I + s² L L'), a the sizes of bumps in time, s on a grid relative to what the noise lets through. The
evidence of a place is the mean over the grid; the posterior of a is the missing force against time (Kennedy and
O'Hagan 2001 for the discrepancy; Alvarez, Luengo and Lawrence 2009 for the force behind it).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_triangular
from scipy.special import logsumexp
from scipy.stats import chi2

from backend.diagnose.bumps import bumps_at
from backend.diagnose.fitted import Fitted
from backend.diagnose.flutter import flutters, waves
from backend.diagnose.probe import Probe
from backend.diagnose.seer import Seer
from backend.diagnose.subject import ALIKE, Subject
from backend.fit.measured import AXES

SIZES = np.geomspace(0.3, 3e4, 11)  # sd of a bump, in sigmas of the data that it moves
DRAWS = 4000
ALONE = 0.05  # share of a row's noise that is left where all else explains most of it: less tells nothing


@dataclass(frozen=True)
class Latent:
    """Whitened responses to bumps, one matrix a place: `joint:ID` (forces), `marker:ID` and `camera` (shifts).

    Columns run over experiments, then (for shifts) axes, then bumps in time. unit: size of a bump with s = 1.
    """

    places: dict[str, Float[np.ndarray, "n bumps"]]
    unit: dict[str, float]

    @property
    def forces(self) -> list[str]:
        """Places where forces act."""
        return [p for p in self.places if p.startswith("joint:")]

    @classmethod
    def of(cls, places: dict[str, Float[np.ndarray, "n bumps"]]) -> Latent:
        """From all columns of each place; those that move nothing say nothing."""
        places = {k: L[:, np.linalg.norm(L, axis=0) > 1e-9 * max(np.linalg.norm(L), 1e-300)] for k, L in places.items()}
        places = {k: L for k, L in places.items() if L.shape[1]}
        return cls(places, {k: 1.0 / float(np.median(np.linalg.norm(L, axis=0))) for k, L in places.items()})

    def scaled(self, place: str) -> np.ndarray:
        """Columns for s = 1."""
        return self.places[place] * self.unit[place]


def forces(subject: Subject, fitted: Fitted, within: float = ALIKE) -> list[Float[np.ndarray, "samples joints waves"]]:
    """Response of every experiment's samples to each bump of force at each joint, before any whitening, about a fit or
    one that moves alike.
    """
    first = -len(subject.joints) - len(subject.axes)
    joints = range(first, -len(subject.axes))

    def one(i: int) -> np.ndarray:
        return np.nan_to_num(fitted.rough[i].drive_slopes(fitted.gliding, fitted.own(i), joints))

    return subject.alike("forces", fitted.r, lambda: subject.over(one, range(len(fitted.rough))), within)


def responses(subject: Subject, fitted: Fitted, raw: Sequence[np.ndarray] | None = None) -> Latent:
    """Responses about a fitted motion. raw: of the forces, where they are known from a motion alike."""
    seer = Seer(subject, fitted.probes, fitted.fraction)
    places = force_responses(subject, seer, raw or forces(subject, fitted))
    return Latent.of(places | _shifts(subject, fitted, seer))


def force_responses(subject: Subject, seer: Seer, raw: Sequence[np.ndarray]) -> dict[str, Float[np.ndarray, "n bumps"]]:
    """Whitened responses to bumps of force at each joint, by place."""
    made = [white(slopes) for white, slopes in zip(seer.white, raw, strict=True)]
    return {
        f"joint:{id}": _blocks(seer.count, seer.rows, [m[:, j] for m in made]) for j, id in enumerate(subject.joints)
    }


def markers_and_axes(fitted: Fitted) -> tuple[list[str], list[str]]:
    """`marker:ID` of all that were seen, and the coordinates that were measured of any."""
    seen = {(c.at, c.coordinate) for p in fitted.probes for c in p.data.channels if c.at.startswith("marker:")}
    return sorted({at for at, _ in seen}), sorted({axis for _, axis in seen})


def moving_bumps(probe: Probe) -> Float[np.ndarray, "samples waves"]:
    """Bumps in time at an experiment's samples; none before the release, where nothing moves."""
    shape = bumps_at(probe.since_release_s, probe.duration_s, probe.bumps.shape[1])
    shape[probe.data.still] = 0.0
    return shape


def _shifts(subject: Subject, fitted: Fitted, seer: Seer) -> dict[str, np.ndarray]:
    markers, axes = markers_and_axes(fitted)
    if not markers:
        return {}
    blocks: dict[str, list[list[np.ndarray]]] = {m: [] for m in (*markers, "camera")}
    for p, white in zip(fitted.probes, seer.white, strict=True):
        shape = moving_bumps(p)
        at = np.array([c.at for c in p.data.channels])[p.data.channel]
        axis = np.array([c.coordinate for c in p.data.channels])[p.data.channel]
        for place in blocks:
            on = at == place if place != "camera" else np.isin(at, markers)
            blocks[place].append([white(shape * (on & (axis == a))[:, None]) for a in axes if a in AXES])
    n = seer.count
    stacked = {k: _blocks(n, seer.rows, [np.concatenate(parts, 1) for parts in runs]) for k, runs in blocks.items()}
    bent = warp(fitted, seer, axes)
    size = np.median(np.linalg.norm(stacked["camera"], axis=0))
    stacked["camera"] = np.concatenate([stacked["camera"], bent * size / np.linalg.norm(bent, axis=0)], 1)
    for marker, hz in flutters(fitted, markers).items():
        place = marker if len(markers) > 1 else "camera"
        more = _blocks(n, seer.rows, waves(fitted, marker, hz))
        stacked[place] = np.concatenate([stacked[place], more * size / np.linalg.norm(more, axis=0)], 1)
    return stacked if len(markers) > 1 else {"camera": stacked["camera"]}


def warp(fitted: Fitted, seer: Seer, axes: Sequence[str], of: str | None = None) -> Float[np.ndarray, "n terms"]:
    """Shifts that depend on where in the picture a point is: cubics in its predicted place, the same at all times.

    of: one marker alone (`marker:ID`), about the middle of its own way: about another's all powers would be alike.
    """
    seen, whose = [], []
    for i, p in enumerate(fitted.probes):
        value = np.nan_to_num(p.predict(fitted.values, fitted.own(i))[0])  # measured places would carry their own noise
        where = {}
        for c, channel in enumerate(p.data.channels):
            rows = np.flatnonzero(p.data.channel == c)
            where |= {
                (channel.at, channel.coordinate, t): v for t, v in zip(p.data.time_s[rows], value[rows], strict=True)
            }
        keys = [(p.data.channels[c].at, t) for c, t in zip(p.data.channel, p.data.time_s, strict=True)]
        seen.append(np.array([[where.get((at, a, t), np.nan) for a in axes] for at, t in keys]))
        whose.append(np.array([at == of if of else at.startswith("marker:") for at, _ in keys]))
    every = np.concatenate(seen)[np.concatenate(whose)]
    count = np.maximum(np.isfinite(every).sum(0), 1)  # a marker need not be measured along every axis
    middle = np.nansum(every, 0) / count
    reach = max(float(np.sqrt(np.nansum((every - middle) ** 2) / count.sum())), 1e-300)
    columns = []
    for p, places, marker, white in zip(fitted.probes, seen, whose, seer.white, strict=True):
        u = np.nan_to_num((places - middle) / reach)
        powers = [a for a in np.ndindex(*(4,) * len(axes)) if sum(a) <= 3]
        terms = np.stack([np.prod(u ** np.array(a), axis=1) for a in powers], 1)
        axis = np.array([c.coordinate for c in p.data.channels])[p.data.channel]
        columns.append(np.concatenate([white(terms * (marker & (axis == a))[:, None]) for a in axes], 1))
    made = np.concatenate(columns)
    return made[:, np.linalg.norm(made, axis=0) > 1e-9]


def _blocks(n: int, rows: Sequence[slice], parts: Sequence[np.ndarray]) -> np.ndarray:
    """(n, columns): one block a run, each with columns of its own."""
    made, at = np.zeros((n, sum(p.shape[1] for p in parts))), 0
    for r, p in zip(rows, parts, strict=True):
        made[r, at : at + p.shape[1]] = p
        at += p.shape[1]
    return made


@dataclass(frozen=True)
class Beside:
    """Columns of unknown sizes beside a fit, with all that the fit itself may do taken out of them (Schur complement).

    known: log evidence of the fit alone, without its sign terms.  G, b: what is left of L'L and of L'r.
    """

    known: float
    G: Float[np.ndarray, "m m"]
    b: Float[np.ndarray, " m"]

    @classmethod
    def of(cls, fitted: Fitted, L: Float[np.ndarray, "n m"]) -> Beside:
        """Raises LinAlgError where the fit's own columns have no curvature."""
        few, J = fitted.count, fitted.J
        shift = fitted.values - fitted.choice.start
        H, pull = J.T @ J + np.diag(fitted.precision), J.T @ fitted.r
        pull[:few] -= shift / fitted.choice.prior_sd**2
        c = np.linalg.cholesky(H + 1e-13 * np.diag(np.diag(H)))
        U, y = solve_triangular(c, J.T @ L, lower=True), solve_triangular(c, pull, lower=True)
        missed = fitted.chi2 + float(np.sum((shift / fitted.choice.prior_sd) ** 2)) - float(y @ y)
        sizes = float(np.sum(np.log(np.diag(c))) + np.sum(np.log(fitted.choice.prior_sd)))
        return cls(-0.5 * missed - sizes, L.T @ L - U.T @ U, L.T @ fitted.r - U.T @ y)

    def evidence(self, which: Sequence[int] | slice = slice(None)) -> Float[np.ndarray, " sizes"]:
        """Log evidence with some of the columns, for each of the sizes that they may have."""
        some = np.arange(self.b.size)[which]
        w, V = np.linalg.eigh(self.G[np.ix_(some, some)])
        stiff = np.maximum(w, 0.0) + SIZES[:, None] ** -2.0
        gained = np.sum((V.T @ self.b[some]) ** 2 / stiff, 1)
        return self.known + 0.5 * gained - 0.5 * np.sum(np.log(stiff), 1) - some.size * np.log(SIZES)


def evidence(fitted: Fitted, L: Float[np.ndarray, "n bumps"]) -> Float[np.ndarray, " sizes"]:
    """Log evidence with unknown bumps of each size beside the fit; none is log_evidence without its sign terms."""
    return Beside.of(fitted, L).evidence()


def log_mean(z: Sequence[float] | Float[np.ndarray, " n"]) -> float:
    """Log evidence where each of several was as likely beforehand; of none, minus infinity."""
    return float(logsumexp(z) - np.log(len(z))) if len(z) else -np.inf


def posterior(fitted: Fitted, L: Float[np.ndarray, "n bumps"], s: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the bumps, of the size s."""
    k, m = fitted.x.size, L.shape[1]
    A = np.concatenate([fitted.J, L], 1)
    H = A.T @ A + np.diag(np.concatenate([fitted.precision, np.full(m, s**-2.0)]))
    C = np.linalg.pinv(H, hermitian=True)
    return (C @ (A.T @ fitted.r))[k:], C[k:, k:]


def omnibus(
    r: Float[np.ndarray, " n"],
    J: Float[np.ndarray, "n x"],
    precision: Float[np.ndarray, " x"],
    L: Float[np.ndarray, "n bumps"],
    rng: np.random.Generator,
) -> float:
    """Probability of as large a ‖L' P⊥ r‖² from noise alone: a weighted sum of chi-squares.

    J, precision: slopes of what is known up to a prior, which P⊥ takes out.
    """
    H = np.linalg.pinv(J.T @ J + np.diag(precision), hermitian=True)
    JL = J.T @ L
    score = L.T @ r - JL.T @ (H @ (J.T @ r))
    spectrum = np.linalg.eigvalsh(L.T @ L - JL.T @ H @ JL)
    spectrum = spectrum[spectrum > 1e-9 * spectrum.max()]
    statistic = float(score @ score)
    p = (1.0 + np.sum((rng.standard_normal((DRAWS, spectrum.size)) ** 2) @ spectrum >= statistic)) / (DRAWS + 1.0)
    if p < 5e-3:  # Satterthwaite's tail where draws are too few
        mean, square = spectrum.sum(), float(np.sum(spectrum**2))
        p = min(p, float(chi2.sf(statistic * mean / square, mean**2 / square)))
    return float(p)


def basis(fitted: Fitted, latent: Latent) -> tuple[np.ndarray, np.ndarray]:
    """(A, R): columns of fit, forces and shifts, each of unit length, and R with A R orthonormal."""
    A = np.concatenate([fitted.J, *[latent.places[p] for p in latent.places]], 1)
    A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    w, V = np.linalg.eigh(A.T @ A)
    good = w > 1e-7 * w.max()
    return A, V[:, good] / np.sqrt(w[good])


def left_over(fitted: Fitted, latent: Latent) -> Float[np.ndarray, " n"]:
    """What neither the fit nor any unknown force or shift explains, row by row."""
    A, R = basis(fitted, latent)
    return fitted.r - A @ (R @ (R.T @ (A.T @ fitted.r)))


def studentised(fitted: Fitted, latent: Latent) -> Float[np.ndarray, " n"]:
    """The same, each row in units of what noise leaves there: at the end of a record a shift follows even a wild
    sample most of the way. A row that forces and shifts follow all the way, as they do a last one behind others that
    were dropped, is what the fit misses there: no neighbour tells more of it.
    """
    A, R = basis(fitted, latent)
    Q = A @ R
    left = 1.0 - np.sum(Q**2, 1)
    return np.where(left > ALONE, (fitted.r - Q @ (Q.T @ fitted.r)) / np.sqrt(np.maximum(left, ALONE)), fitted.r)


def neighbour_correlation(fitted: Fitted, latent: Latent, follows: np.ndarray) -> float:
    """Correlation of neighbouring rows of the noise, from what is left over.

    follows: rows that come one sample after the row before them. What the projection takes out of white noise, which
    makes neighbours correlate by themselves, is put back.
    """
    A, R = basis(fitted, latent)
    Q = A @ R
    e = fitted.r - Q @ (Q.T @ fitted.r)
    rows = np.flatnonzero(follows)
    power = float(e @ e) / max(e.size - R.shape[1], 1)
    taken = float(np.sum(Q[rows] * Q[rows - 1]))
    both = float(np.sum(1.0 - np.sum(Q[rows] ** 2, 1)))
    return (float(e[rows] @ e[rows - 1]) / max(power, 1e-300) + taken) / max(both, 1.0)
