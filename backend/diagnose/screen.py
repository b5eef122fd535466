"""All candidates at once, to first order: how much of the misfit each could take away."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product

import numpy as np
from jaxtyping import Float

from backend.diagnose.candidate import WIDE, Candidate
from backend.diagnose.fitted import LARGE, Fitted
from backend.diagnose.library import FAINT
from backend.diagnose.seer import Seer
from backend.diagnose.subject import ALIKE, SAME, Subject

DRAWS = 2000
EARLY = 0.35  # of the records
DIFFERENT = 0.01  # of a response, above which two do not do the same


@dataclass(frozen=True)
class Screen:
    """Signatures about a fit, with what the fit's own numbers can imitate taken out.

    S: (n, all) whitened slopes in every parameter of the library. r: what is left over, projected alike. own: by how
    much the fit's own numbers and starts change where they follow what is left over; taken: and by how much less of it
    for each parameter.
    """

    subject: Subject
    fitted: Fitted
    S: Float[np.ndarray, "n all"]
    r: Float[np.ndarray, " n"]
    own: Float[np.ndarray, " own"]
    taken: Float[np.ndarray, "own all"]
    early: Screen | None = None
    """Of the first part of the records alone, where the misfit is large: later, first order no longer holds."""

    def rescaled(self, scale: float) -> Screen:
        """The same, had all sigmas been larger by `scale`."""
        return replace(self, S=self.S / scale, r=self.r / scale)

    def signature(self, candidate: Candidate) -> Float[np.ndarray, "n own"]:
        """Projected response to the candidate's numbers."""
        return self.S @ candidate.ties(self.S.shape[1])

    def done_by(self, candidate: Candidate, offsets: Float[np.ndarray, " own"]) -> Float[np.ndarray, " n"]:
        """What numbers of the candidate that lie so far off their starts do, to first order."""
        return self.signature(candidate) @ self._steps(candidate, offsets)

    def _steps(self, candidate: Candidate, offsets: Float[np.ndarray, " own"]) -> Float[np.ndarray, " own"]:
        """Along its responses; what is there has its shape in those to its sizes."""
        there = candidate in self.fitted.choice.candidates
        return np.where(candidate.sizes, offsets, 0.0) if there else candidate.steps(offsets)

    def gain(self, candidate: Candidate) -> float:
        """b' (S' P⊥ S + Λ)⁻¹ b, and what a tolerance that it sets free pays: twice the log likelihood that it would
        gain to first order.
        """
        S = self.signature(candidate)
        b, H = S.T @ self.r, S.T @ S + np.diag(candidate.prior_sd**-2.0)
        step = np.linalg.solve(H, b)
        freed = sum(off**2 * relief for _, _, off, relief in self.strained(candidate))
        return (float(b @ step) if candidate.allows(step) else 0.0) + freed

    def strained(self, candidate: Candidate) -> list[tuple[str, float, float, float]]:
        """Of every tolerance that the fit has used and the candidate would set free: the candidate's number that takes
        it, its value, how many of its sd it is off, and the share of their square that the candidate's wider sd saves.
        """
        choice, known = self.fitted.choice, self.subject.library.parameters
        used = {
            p.name: (value, p.start, sd)
            for p, value, sd in zip(choice.parameters, self.fitted.values, choice.prior_sd, strict=True)
        }
        found = []
        for own, take, wide in zip(candidate.parameters, candidate.takes, candidate.prior_sd, strict=True):
            for name in (known[i].name for i in take if i in self.subject.library.nuisances):
                if name in used:
                    value, start, sd = used[name]
                    off, relief = float((value - start) / sd), max(1.0 - float(sd / wide) ** 2, 0.0)
                    found.append((own.name, float(value), off, relief))
        return found

    def guess(self, candidate: Candidate) -> dict[str, float]:
        """First-order values of the candidate's numbers, by name; of tolerances that one sets free, their mean."""
        S = self.signature(candidate)
        step = np.linalg.solve(S.T @ S + np.diag(candidate.prior_sd**-2.0), S.T @ self.r)
        held: dict[str, list[float]] = {}
        for name, value, *_ in self.strained(candidate):
            held.setdefault(name, []).append(value)
        return _values(candidate, step) | {name: float(np.mean(values)) for name, values in held.items()}

    def imitated(self, candidate: Candidate, done: Float[np.ndarray, " n"]) -> dict[str, float] | None:
        """Values by which the candidate does to first order what another did, by name; None where it cannot."""
        S = self.signature(candidate)
        step = np.linalg.lstsq(S, done, rcond=1e-12)[0]
        off = candidate.offsets(step)
        if np.sum((done - self.done_by(candidate, off)) ** 2) >= DIFFERENT * (done @ done):
            return None
        return {p.name: float(p.start + d) for p, d in zip(candidate.parameters, off, strict=True)}

    def moved(self, members: Sequence[Candidate], values: Mapping[str, float]) -> Float[np.ndarray, " own"]:
        """By how much the fit's own numbers and starts change where members have these values, to first order."""
        there = np.zeros(self.S.shape[1])
        for c in members:
            off = np.array([values.get(p.name, p.start) - p.start for p in c.parameters])
            for take, step in zip(c.takes, self._steps(c, off), strict=True):
                there[list(take)] += step
        return self.own - self.taken @ there

    def ranking(self, candidates: Sequence[Candidate]) -> list[tuple[Candidate, float]]:
        """Largest gain first."""
        gains = [(c, self.gain(c)) for c in candidates]
        return sorted(gains, key=lambda pair: -(pair[1] + 2.0 * pair[0].log_odds))

    def sets(
        self, candidates: Sequence[Candidate], size: int
    ) -> Iterator[tuple[tuple[Candidate, ...], float, dict[str, float]]]:
        """Every set of so many of these candidates: its gain, and first-order sizes, by name."""
        ends = np.cumsum([0, *(len(c.parameters) for c in candidates)])
        spans = [np.arange(a, b) for a, b in pairwise(ends)]
        S = self.S @ np.concatenate([c.ties(self.S.shape[1]) for c in candidates], 1)
        H, b = S.T @ S + np.diag(np.concatenate([c.prior_sd for c in candidates]) ** -2.0), S.T @ self.r
        for some in combinations(range(len(candidates)), size):
            members, at = [candidates[i] for i in some], np.concatenate([spans[i] for i in some])
            if any(one.overlaps(other) for one, other in combinations(members, 2)):
                continue
            try:
                step = np.linalg.solve(H[np.ix_(at, at)], b[at])
            except np.linalg.LinAlgError:  # slopes that grew past all bounds, as through blows
                continue
            steps = np.split(step, np.cumsum([spans[i].size for i in some])[:-1])
            if all(c.allows(own) for c, own in zip(members, steps, strict=True)):
                values: dict[str, float] = {}
                for c, own in zip(members, steps, strict=True):
                    values |= {name: value for name, value in _values(c, own).items() if name in c.told}
                yield tuple(members), float(b[at] @ step), values

    def ceiling(self) -> float:
        """What all candidates together would gain to first order: no set of them gains more."""
        sd = np.zeros(self.S.shape[1])
        for c in self.subject.library.candidates:
            for take, own in zip(c.takes, c.prior_sd, strict=True):
                sd[list(take)] = np.maximum(sd[list(take)], own)
        S = self.S[:, sd > 0] * sd[sd > 0]
        b = S.T @ self.r
        return float(b @ np.linalg.solve(S.T @ S + np.eye(len(b)), b))

    def detectable(self, candidate: Candidate) -> Float[np.ndarray, " own"]:
        """Smallest amplitude of each number that would stand out of the noise, at four of its sd."""
        S = self.signature(candidate)
        size = np.linalg.norm(S, axis=0)
        return 4.0 / np.maximum(size, 1e-300)

    def p_value(self, candidates: Sequence[Candidate], rng: np.random.Generator) -> float:
        """Probability that noise alone gives any candidate as large a gain as the largest here."""
        # Noise in the span of all signatures has their Gram matrix as its covariance: no whole record is drawn.
        G = self.S.T @ self.S
        w, V = np.linalg.eigh(G)
        draws = (rng.standard_normal((DRAWS, w.size)) * np.sqrt(np.maximum(w, 0.0))) @ V.T
        largest, seen = np.zeros(DRAWS), 0.0
        for c in candidates:
            T = c.ties(self.S.shape[1])
            H = T.T @ G @ T + np.diag(c.prior_sd**-2.0)
            b = draws @ T
            step = np.linalg.solve(H, b.T).T
            gain = np.where(c.allows(step), np.sum(b * step, 1), 0.0)
            for *_, relief in self.strained(c):  # a tolerance that holds is used like one
                gain = gain + relief * rng.standard_normal(DRAWS) ** 2
            largest = np.maximum(largest, gain)
            seen = max(seen, self.gain(c))
        return float((1.0 + np.sum(largest >= seen)) / (DRAWS + 1.0))


def _values(candidate: Candidate, step: Float[np.ndarray, " own"]) -> dict[str, float]:
    far = WIDE * candidate.prior_sd
    off = candidate.offsets(np.clip(step, -far, far))
    return {
        p.name: float(np.clip(p.start + d, p.lower, p.upper)) for p, d in zip(candidate.parameters, off, strict=True)
    }


def containing(about: Screen, candidates: Sequence[Candidate]) -> dict[str, list[Candidate]]:
    """Forms with a shape of their own, by the name of a simpler candidate at the same place that each contains."""
    found: dict[str, list[Candidate]] = {}
    for wide in candidates:
        if any(wide.tries):
            for c in candidates:
                if c.on == wide.on and c.sizes.sum() == 1 < wide.sizes.sum() and _contains(about, wide, c):
                    found.setdefault(c.name, []).append(wide)
                    break
    return found


def _contains(about: Screen, wide: Candidate, c: Candidate) -> bool:
    done = about.signature(c)[:, c.sizes][:, 0]
    return bool(np.any(done)) and about.imitated(wide, done) is not None


def tuned(about: Screen, candidate: Candidate) -> dict[str, float]:
    """Values to begin with, by name, for numbers whose slope is nothing while the effect is absent: the best of those
    worth trying, with first-order values of the rest.
    """
    fitted, subject = about.fitted, about.subject
    seer = Seer(subject, fitted.probes, fitted.fraction)
    rest, (probes, _) = np.flatnonzero(candidate.sizes), fitted.slope_probes(ALIKE)
    choices = [worth or (p.start,) for worth, p in zip(candidate.tries, candidate.parameters, strict=True)]
    turn = candidate.turning
    phases = (0.0,) if turn is None else choices[turn]
    if turn is not None:
        choices[turn] = (0.0,)
    J = fitted.free
    H = np.linalg.pinv(J.T @ J + np.diag(fitted.precision), hermitian=True)

    def slopes(values: tuple[float, ...]) -> Float[np.ndarray, "n sizes"]:
        neutral = subject.neutral.copy()
        for take, value in zip(candidate.takes, values, strict=True):
            neutral[list(take)] = value
        directions = candidate.ties(neutral.size)[:, rest].T

        def one(i: int) -> np.ndarray:
            probe = probes[i].choose(fitted.choice.ties, neutral)
            return seer.white[i](np.nan_to_num(probe.slopes(fitted.gliding, fitted.own(i), directions)))

        S = np.concatenate(subject.over(one, range(len(probes))))
        return S - J @ (H @ (J.T @ S))

    sd = candidate.prior_sd[rest]
    best: tuple[float, dict[str, float]] = (0.0, {})
    for values in product(*choices):
        cosine = slopes(values)
        sine = cosine if turn is None else slopes((*values[:turn], 0.5 * np.pi, *values[turn + 1 :]))
        for phase in phases:
            S = np.cos(phase) * cosine + np.sin(phase) * sine
            b = S.T @ about.r
            step = np.linalg.solve(S.T @ S + np.diag(sd**-2.0), b)
            if (gain := float(b @ step)) > best[0]:
                found = dict(zip((p.name for p in candidate.parameters), values, strict=True))
                found |= {} if turn is None else {candidate.parameters[turn].name: phase}
                best = gain, found | {candidate.parameters[i].name: float(d) for i, d in zip(rest, step, strict=True)}
    return best[1]


def screen(subject: Subject, fitted: Fitted) -> Screen:
    """One sweep of forward sensitivities about a fit, or about one that moves alike."""
    seer = Seer(subject, fitted.probes, fitted.fraction)
    S = library_slopes(fitted).copy()
    S[:, sorted(set(np.flatnonzero(fitted.choice.ties.any(1)).tolist()))] = 0.0
    whole = _projected(subject, fitted, S, fitted.r, fitted.free)
    if fitted.chi2 < LARGE * fitted.r.size:
        return whole
    since = [p.since_release_s[white.keep] / p.duration_s for p, white in zip(fitted.probes, seer.white, strict=True)]
    first = np.concatenate(since) <= EARLY * fitted.fraction
    return replace(whole, early=_projected(subject, fitted, S[first], fitted.r[first], fitted.free[first]))


def beyond(fitted: Fitted, given: Sequence[Candidate]) -> Screen:
    """Signatures about a fit's own motion with some of its members given up: what else could do what they do. Of no
    size, these have no shape either.
    """
    choice = fitted.choice
    names = {p.name for c in given for p in c.parameters}
    own = np.array([p.name in names for p in choice.parameters])
    shift = np.where(own[: choice.own] & choice.sizes, (fitted.values - choice.start)[: choice.own], 0.0)
    rest = np.concatenate([~own, np.ones(fitted.x.size - fitted.count, bool)])
    S = library_slopes(fitted, SAME, fitted.choice.candidates)
    left = replace(fitted, J=fitted.J[:, rest], precision=fitted.precision[rest], held=fitted.held[rest])
    return _projected(fitted.subject, left, S, fitted.r + fitted.J[:, : choice.own] @ shift, left.free)


def library_slopes(
    fitted: Fitted, within: float = ALIKE, present: Sequence[Candidate] = ()
) -> Float[np.ndarray, "n parameters"]:
    """Whitened slopes of every parameter of the library, about a fit or one that moves alike. Shapes of what is absent
    have none, or where they act in proportion to a size theirs at the size that is expected; present: those whose
    shapes are asked for.
    """
    subject = fitted.subject
    seer, known = Seer(subject, fitted.probes, fitted.fraction), subject.library
    absent = np.zeros(len(known.parameters), bool)
    for c in known.candidates:
        absent[[i for take, size in zip(c.takes, c.sizes, strict=True) if not size for i in take]] = True
    far = np.ones(absent.size)
    for c in known.candidates:
        if c.proportional is not None:
            shape = list(c.takes[c.proportional[1]])
            absent[shape], far[shape] = False, 1.0 / FAINT
    for c in present:
        own = [i for take in c.takes for i in take]
        absent[own], far[own] = False, 1.0
    telling = np.flatnonzero(~absent)
    directions = np.diag(far)[telling]
    probes, how = fitted.slope_probes(within)

    def one(i: int) -> np.ndarray:
        return seer.white[i](np.nan_to_num(probes[i].slopes(fitted.gliding, fitted.own(i), directions)))

    def sweep() -> np.ndarray:
        S = np.zeros((seer.count, absent.size))
        S[:, telling] = np.concatenate(subject.over(one, range(len(probes))))
        return S

    # A spring that is there tells another slope of where it rests than one that is not.
    there = [c.name for c in fitted.choice.candidates if c.proportional is not None]
    what = " ".join(["library", *(c.name for c in present), "about", *there])
    return subject.alike(what + how, fitted.r, sweep, within)


def _projected(subject: Subject, fitted: Fitted, S: np.ndarray, r: np.ndarray, J: np.ndarray) -> Screen:
    H = np.linalg.pinv(J.T @ J + np.diag(fitted.precision), hermitian=True)
    own, taken = H @ (J.T @ r), H @ (J.T @ S)
    return Screen(subject, fitted, S - J @ taken, r - J @ own, own, taken)
