"""A spring that was wound tighter or looser than drawn."""

import equinox as eqx
from jaxtyping import Array, Float

from backend.effects.effect import parameter
from backend.effects.shapes import AbstractSpringError

PRELOAD = "preload_n"  # of an extension spring


class SpringPreloadError(AbstractSpringError):
    """The spring pulls with a constant force more or less than drawn."""

    kind = "spring_preload_error"
    acts_on = "effect"
    amends = ("extension_spring",)
    n: Float[Array, ""] = parameter("N", "true minus drawn pull", expected=0.1)

    def amend(self, effect):
        """Add to the preload."""
        return eqx.tree_at(lambda e: getattr(e, PRELOAD), effect, getattr(effect, PRELOAD) + self.n)
