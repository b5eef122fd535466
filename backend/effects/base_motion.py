"""A base that shakes: a table, a floor, a hand that holds the rig."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractBaseMotion


class BaseMotion(AbstractBaseMotion):
    """The base shakes along a line, s(t) = amplitude sin(2π f t + phase); time counts from the stated release.

    Every body feels -m s''(t) beside its weight, and a camera that stands still sees everything moved by s(t).  The
    mechanism is computed in the base's frame: it is held, and let go at rest, with respect to the base, and a simulated
    run shows it as seen from there.  Air and bed move with the base.  Frames from before the release show whether the
    base shook all along, or rested until the release set it off.
    """

    kind = "base_motion"
    acts_on = "world"
    odds = 0.3
    amplitude_m: Float[Array, "3"] = parameter("m", "of the base's displacement, in W", size=3, expected=0.01)
    frequency_hz: Float[Array, ""] = parameter(
        "Hz", "of the shaking", default=1.0, lower=0.0, by_name=True, expected=0.5,
        # Steps of a fifth: coarser ones lose a shaking of few periods behind the kick that begins it, alike for all.
        tries=(0.08, 0.11, 0.15, 0.2, 0.25, 0.3, 0.35, 0.42, 0.5, 0.6, 0.7, 0.84, 1.0, 1.2, 1.4),
    )  # fmt: skip
    phase_rad: Float[Array, ""] = parameter(
        "rad", "at the stated release", by_name=True, expected=3.0, phase=True,
        tries=(0.0, 0.4, 0.8, 1.2, 1.6, 2.0, 2.4, 2.8),
    )  # fmt: skip
    begins_at_release: Float[Array, ""] = parameter(
        "1", "share of the shaking that begins with the release: 1 for a base that rests until then",
        lower=0.0, upper=1.0, by_name=True, expected=1.0, tries=(0.5,),
    )  # fmt: skip

    def displacement(self, time_s):
        """A sine; before the release, as much of it as did not begin then."""
        before = self._sine(jnp.minimum(time_s, 0.0)) - self._sine(jnp.zeros_like(time_s))
        return self._sine(jnp.maximum(time_s, 0.0)) + (1.0 - self.begins_at_release) * before

    def acceleration(self, time_s):
        """Second derivative of the sine."""
        return -((2 * jnp.pi * self.frequency_hz) ** 2) * self._sine(time_s)

    def _sine(self, time_s):
        return jnp.sin(2 * jnp.pi * self.frequency_hz * time_s + self.phase_rad)[..., None] * self.amplitude_m
