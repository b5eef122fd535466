"""A spring that is stiffer or softer than drawn."""

import equinox as eqx
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractSpringError

STIFFNESS = {"extension_spring": "stiffness_n_per_m", "torsion_spring": "stiffness_n_m_per_rad"}


class SpringStiffnessError(AbstractSpringError):
    """The spring is stiffer or softer than drawn, at the same free length or rest angle."""

    kind = "spring_stiffness_error"
    acts_on = "effect"
    amends = tuple(STIFFNESS)
    relative: Float[Array, ""] = parameter("1", "true / drawn - 1", lower=-0.95, expected=0.1)

    def amend(self, effect):
        """Scale the stiffness."""
        name = STIFFNESS[effect.kind]
        return eqx.tree_at(lambda e: getattr(e, name), effect, (1 + self.relative) * getattr(effect, name))
