"""What an effect is: declared parameters, a place to act, and one of a few shapes of physics.

A shape is all the solver knows.  An effect is a final subclass of one shape, alone in its file; its fields
are its parameters, each declared once with unit, bounds and meaning.
"""

import dataclasses
from typing import Any, ClassVar, Literal

import equinox as eqx
from jaxtyping import Array, Float

Place = Literal["joint", "body", "bodies", "world", "camera"]
TURNING = ("revolute", "cylindrical", "planar")  # joint types whose q is a turn


@dataclasses.dataclass(frozen=True)
class Declaration:
    """One parameter of an effect.  `default` None means that a drawing must give it."""

    unit: str
    doc: str
    default: float | None = 0.0
    lower: float | None = None
    upper: float | None = None
    size: int = 1
    joint_types: tuple[str, ...] | None = None
    drive: Literal["mean", "end"] | None = None
    """How a step reads a recorded drive: its mean over the step, or its value at the step's end."""


def parameter(unit: str, doc: str, **rest: Any) -> Any:
    """Declare an effect's parameter (see Declaration); the field is a float array leaf."""
    return eqx.field(metadata={"declaration": Declaration(unit, doc, **rest)})


class AbstractEffect(eqx.Module):
    """An effect at one place.  In a model, leaves carry a leading axis: one row per drawn effect."""

    kind: ClassVar[str]
    acts_on: ClassVar[Place]

    @classmethod
    def declarations(cls) -> dict[str, Declaration]:
        """Parameter name -> what was declared about it, in the file's order."""
        return {field.name: field.metadata["declaration"] for field in dataclasses.fields(cls)}


class BodyView(eqx.Module):
    """One body as an effect sees it: pose, motion and drawing.  The world itself is a body that rests."""

    p_WC: Float[Array, "3"]
    R_WB: Float[Array, "3 3"]
    v_WC: Float[Array, "3"]
    w_WB_W: Float[Array, "3"]
    mass: Float[Array, ""]
    p_BC: Float[Array, "3"]
    stretch: Float[Array, "3 3"]

    def point(self, p_BP: Float[Array, "3"]) -> Float[Array, "3"]:
        """World position of a point drawn on the body, from the body's origin, in B [m] -> W [m]."""
        return self.p_WC + self.R_WB @ (self.stretch @ p_BP - self.p_BC)


class Wrench(eqx.Module):
    """Force [N] and torque about the centre of mass [N m], both in W."""

    force: Float[Array, "3"]
    torque: Float[Array, "3"]
