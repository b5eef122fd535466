"""What an effect is: declared parameters, a place to act, and one of a few shapes of physics.

A shape is all the solver knows.  An effect is a final subclass of one shape, alone in its file; its fields
are its parameters, each declared once with unit, bounds and meaning.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import equinox as eqx
from jaxtyping import Array, Float

Place = Literal["joint", "body", "bodies", "effect", "marker", "world", "camera"]
SLIDING = ("prismatic",)  # joint types whose q is a travel
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
    drawn: str | None = None
    """What a joint's fit calls the value that holds where none is given (a method of mechanism.joint.Fit)."""
    typical: float = 1.0
    """Its usual size, in natural sizes of its unit."""
    natural_unit: str | None = None
    """Another unit whose natural size says how large it is, where its own says nothing of the forces it makes."""
    by_name: bool = False
    """Whether a fit frees it only when it is named."""
    at_least: str | None = None
    """Another parameter of the effect that a drawing must not give more than this one."""
    expected: float | None = None
    """Standard deviation of its value before any data, in natural sizes (`natural` of its row in a model).  None: not
    a cause that a diagnosis frees."""
    unstated: float | None = None
    """As far from its default as it may lie where nobody states it, in its unit: intervals of a fit allow for that.
    None: the default is taken at its word."""
    unstated_is_natural: bool = False
    """Whether `unstated` is in natural sizes: what is soft for a large mechanism is hard for a small one."""
    rests_on: tuple[str, float] | None = None
    """Another parameter that is guessed while nobody gives it, and the share of this one's value that the guess leaves
    open (one standard deviation)."""
    late: bool = False
    """Whether a diagnosis frees it only where the effect without it came out best: it tells apart what is seen well."""
    proportional_to: str | None = None
    """Another parameter, in proportion to which this one acts: where that is nothing, so is the slope in this one."""
    phase: bool = False
    """Whether it is an angle by whose cosine and sine all that the effect does is mixed."""
    tries: tuple[float, ...] = ()
    """Values worth trying, in natural sizes, where nothing says which way to go while the effect is absent; the only
    one is where it stands meanwhile."""


@dataclasses.dataclass(frozen=True)
class Choice:
    """A word that decides an effect's structure; the first option is the default."""

    options: tuple[str, ...]
    doc: str


def parameter(unit: str, doc: str, **rest: Any) -> Any:
    """Declare an effect's parameter (see Declaration); the field is a float array leaf."""
    return eqx.field(metadata={"declaration": Declaration(unit, doc, **rest)})


def choice(*options: str, doc: str) -> Any:
    """Declare a word that decides an effect's structure; the field is static."""
    return eqx.field(static=True, default=options[0], metadata={"choice": Choice(options, doc)})


class AbstractEffect(eqx.Module):
    """An effect at one place.  In a model, leaves carry a leading axis: one row per drawn effect."""

    kind: ClassVar[str]
    acts_on: ClassVar[Place]
    odds: ClassVar[float] = 1.0
    """How often it is the cause of a gap, against the commonest: which of two names to say first where the data cannot
    tell them apart.
    """
    shared: ClassVar[bool] = True
    """Whether one value at all its places is a cause of its own: bars of one stock are all too heavy, but not all off
    balance to the same side, nor do joints lean alike or end their travel at one angle.
    """

    @classmethod
    def declarations(cls) -> dict[str, Declaration]:
        """Parameter name -> what was declared about it, in the file's order."""
        return _of(cls, "declaration")

    @classmethod
    def choices(cls) -> dict[str, Choice]:
        """Name -> the words that decide the effect's structure."""
        return _of(cls, "choice")

    @classmethod
    def structure(cls, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Static fields that drawn parameters decide; effects of one kind and structure share one batch."""
        return {name: parameters.get(name, declared.options[0]) for name, declared in cls.choices().items()}


def _of(cls: type[AbstractEffect], what: str) -> dict[str, Any]:
    return {field.name: field.metadata[what] for field in dataclasses.fields(cls) if what in field.metadata}


class BodyView(eqx.Module):
    """One body as an effect sees it: pose, motion and drawing.  The world itself is a body that rests."""

    p_WC: Float[Array, "3"]
    R_WB: Float[Array, "3 3"]
    v_WC: Float[Array, "3"]
    w_WB_B: Float[Array, "3"]
    mass: Float[Array, ""]
    p_BC: Float[Array, "3"]
    stretch: Float[Array, "3 3"]
    along_B: Float[Array, "3"]
    """Unit direction in which its joints are spread."""
    part: Float[Array, ""]
    """How much of the drawn link it is along its length: less than 1 of a link that bends."""

    def point(self, p_BP: Float[Array, "3"]) -> Float[Array, "3"]:
        """World position of a point drawn on the body, from the body's origin, in B [m] -> W [m]."""
        return self.p_WC + self.R_WB @ (self.stretch @ p_BP - self.p_BC)


class Wrench(eqx.Module):
    """Force in W [N] and torque about the centre of mass [N m], in W or in the body's axes; None is none at all."""

    force: Float[Array, "3"]
    torque: Float[Array, "3"] | None = None
    torque_B: Float[Array, "3"] | None = None
