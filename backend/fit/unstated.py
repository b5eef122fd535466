"""What a fit takes for granted though nobody said so: that the walls of a hole are rigid, dead and smooth.

A soft wall passes for a wider hole, and hardly a sample shows the difference; a wall that gives back passes for a
narrower one.  So the interval of a value must not rest on defaults of its own effect: each parameter that declares how
far it may lie (`unstated` of its declaration) and is neither drawn, free nor overridden counts as a nuisance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from backend.fit.free import FreeParameter
from backend.fit.half_step import HalfStep
from backend.fit.identifiability import Z95, Uncertainty
from backend.fit.nuisance import allowing, secants
from backend.fit.residual import Residuals
from backend.fit.solve import Solution
from backend.fit.starts import at_once
from backend.mechanism import fit_report
from backend.mechanism.effect import Effect
from backend.mechanism.ratios import times
from backend.mechanism.study import Study
from backend.model.model import Address, Model

FALSE_ALARMS = 1e-3  # fits with the right walls that are told to free others
WORTH_SAYING = 1.05  # times as wide
GIVING = 10.0  # times as stiff as the softest: where the search for a stiffness drawn as rigid begins


@dataclass(frozen=True)
class Unstated:
    """A parameter held at a value that nobody stated, and how far it may lie from there; alike in all effects of a kind
    that leave it open: the walls of one mechanism come from one workshop.
    """

    effect: str
    addresses: tuple[Address, ...]
    held: float
    far: float
    unit: str

    @property
    def name(self) -> str:
        """As `--free` takes it."""
        return f"{self.effect}.{self.addresses[0][1]}"

    def at(self, share: float) -> float:
        """Some of the way; of a stiffness in its reciprocal, the give, which is what moves the parts."""
        if self.held > self.far > 0.0:
            return 1.0 / (1.0 / self.held + share * (1.0 / self.far - 1.0 / self.held))
        return self.held + share * (self.far - self.held)


def unstated(study: Study, model: Model, free: Sequence[FreeParameter], added: Sequence[Effect]) -> list[Unstated]:
    """Those of the kinds of effects that have a free parameter."""
    freed = {address for parameter in free for address in parameter.addresses}
    said = {address for experiment in study.experiments for address in model.overridden(experiment.overrides)}
    found: dict[tuple[str, str, float, float, str], list[tuple[str, Address]]] = {}
    table = model.parameters
    for effect in (*study.mechanism.effects, *added):
        if all(effect.id != of for of, _ in freed):
            continue
        place = effect.on[0] if effect in added else effect.id
        for address, row in table.items():
            declared = row.declaration
            if address[0] != effect.id or row.unstated is None:
                continue
            if address[1] not in effect.parameters and address not in freed | said:
                of = (effect.kind, address[1], float(declared.default or 0.0), row.unstated, declared.unit)
                found.setdefault(of, []).append((place, address))
    return [
        Unstated(f"{kind}:{places[0][0] if len(places) == 1 else '*'}", tuple(a for _, a in places), held, far, unit)
        for (kind, _, held, far, unit), places in found.items()
    ]


def with_give(
    start: Float[np.ndarray, " x"], parameters: Sequence[FreeParameter], model: Model
) -> Float[np.ndarray, " x"]:
    """Starting values where walls that are freed and drawn as rigid give a little: rigid ones show no way to go."""
    begun, table = start.copy(), model.parameters
    for j, parameter in enumerate(parameters):
        row = table[parameter.addresses[0]]
        far = row.unstated
        if far is not None and far < float(row.declaration.default or 0.0) <= start[j]:
            begun[j] = GIVING * far
    return begun


class Allowed:
    """What intervals allow for; nothing where all was stated and the step is fine enough.

    guessed: sd of each value for what it rests on. half_step: what a finer step would do to the values.
    """

    def __init__(
        self,
        residuals: Residuals,
        solution: Solution,
        u: Uncertainty,
        held: Sequence[Unstated],
        guessed: Float[np.ndarray, " p"],
        half_step: HalfStep,
    ):
        p = len(residuals.parameters)
        self.names, self.sd, self.guessed, self.half_step = residuals.names[:p], u.sd[:p], guessed, half_step
        noise = u.noise_sd[:p]
        self.bounded = np.isfinite(self.sd) & (noise > 0)
        doubt = float(np.max(self.sd[self.bounded] / noise[self.bounded], initial=1.0))
        changes = [_change(residuals, solution, each) for each in held]
        columns = dict(
            zip(held, at_once([partial(secants, change, solution, doubt) for change in changes]), strict=True)
        )
        self.lost = [each for each, pair in columns.items() if pair is None]
        seen = {each: pair for each, pair in columns.items() if pair is not None}
        self.held = list(seen)
        self.views = [allowing(solution, looks, self.sd, noise) for looks in zip(*seen.values(), strict=True)]

    @property
    def ends(self) -> Float[np.ndarray, "p 2"]:
        """Of the 95% interval of every value, from the value on."""
        own = Z95 * self.sd
        low = np.min([-own, *(view.ends[:, 0] for view in self.views)], axis=0)
        high = np.max([own, *(view.ends[:, 1] for view in self.views)], axis=0)
        more, of_step = Z95 * self.guessed, self.half_step.ends
        low, high = np.hypot(np.hypot(low, more), of_step[:, 0]), np.hypot(np.hypot(high, more), of_step[:, 1])
        return np.stack([-low, high], 1)

    def rows(self) -> tuple[fit_report.Unstated, ...]:
        """As fit.json lists them."""
        shifts = self.views[-1].shift.T if self.views else ()
        return tuple(
            fit_report.Unstated(
                name=each.name, held=each.held, up_to=each.far, unit=each.unit,
                shifts=dict(zip(self.names, shift.tolist(), strict=True)),
            )
            for each, shift in zip(self.held, shifts, strict=True)
        )  # fmt: skip

    def sentences(self) -> Iterator[str]:
        """What was not stated or is too coarse, what that does to the intervals, and what to do about it."""
        yield from self.half_step.sentences(self.sd)
        for each in self.lost:
            yield f"{each.name} was not stated, and intervals do not allow for it: no motion was found."
        if not self.views:
            return
        wider = {self.names[j]: np.ptp(self.ends[j]) / (2.0 * Z95 * self.sd[j]) for j in np.flatnonzero(self.bounded)}
        if grown := [f"{name} {times(share, 2)} times" for name, share in wider.items() if share > WORTH_SAYING]:
            what = ", ".join(f"{each.name} ({_range(each)})" for each in self.held)
            yield f"Nobody stated {what}: intervals allow for it, {', '.join(grown)} as wide. State it, or free it."
        plain = min(self.views, key=lambda view: view.gain)
        if plain.gain > chi2.isf(FALSE_ALARMS, len(self.held)):
            best = self.held[int(np.argmax(plain.gains))]
            yield (
                f"With other walls than the default ones chi-square falls by {plain.gain:.3g}; "
                f"most with another {best.name}: free it."
            )


def _change(residuals: Residuals, solution: Solution, each: Unstated) -> Callable[[float], Float[np.ndarray, " n"]]:
    """Change of the residual as a parameter goes a share of the way that it may lie off."""
    return lambda share: residuals.holding(each.addresses, each.at(share)).residual(solution.x) - solution.residual


def _range(each: Unstated) -> str:
    side = "down" if each.far < each.held else "up"
    return f"{side} to {each.far:g}" + (f" {each.unit}" if each.unit != "1" else "")
