"""The shapes of physics that the solver knows.  Every effect is one of them."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from backend.effects.effect import AbstractEffect, BodyView, Wrench

Scalar = Float[Array, ""]


class AbstractJointDamping(AbstractEffect):
    """Effort against a joint's rate, in proportion to it."""

    @abstractmethod
    def damping(self) -> Scalar:
        """N m s/rad at a turning joint, N s/m at a sliding one."""


class AbstractRub(AbstractEffect):
    """Dry friction at a joint, which gives a little before it slides."""

    @abstractmethod
    def presliding(self) -> Scalar:
        """How far the joint gives under friction that has not let go, as if it were elastic up to there [rad or m]."""

    @abstractmethod
    def onset(self) -> Scalar:
        """Rate at which friction bears 71% of its limit: below it a joint creeps that would hold [rad/s or m/s]."""


class AbstractDryFriction(AbstractRub):
    """Effort against a joint's motion up to a limit that grows linearly with the load the joint carries."""

    @abstractmethod
    def limit(self, load: Scalar, pin_radius: Scalar) -> Scalar:
        """Largest effort [N m or N] under a radial reaction `load` [N]; pin_radius in m."""


class AbstractRateFriction(AbstractRub):
    """Effort against a joint's motion up to a limit that changes with the joint's rate."""

    @abstractmethod
    def limit(self, rate: Scalar) -> Scalar:
        """Largest effort [N m or N] at a rate of either sign [rad/s or m/s]."""


class AbstractJointEffort(AbstractEffect):
    """Effort along a joint's coordinate that depends on where the joint is."""

    @abstractmethod
    def effort(self, q: Scalar) -> Scalar:
        """Effort in the direction of growing q [N m or N]."""

    @abstractmethod
    def potential(self, q: Scalar) -> Scalar:
        """Energy stored at q [J]; its slope is minus the effort where it is conservative, 0 where a drive."""


class AbstractJointInertia(AbstractEffect):
    """Inertia that turns or travels with a joint's coordinate."""

    @abstractmethod
    def inertia(self) -> Scalar:
        """kg m² at a turning joint, kg at a sliding one."""


class Wall(eqx.Module):
    """What a unilateral contact does beside keeping parts apart."""

    friction: Scalar
    """Largest friction force over normal force [1]."""
    give: Scalar
    """Penetration over normal force [m/N]; 0 is rigid."""
    restitution: Scalar
    """Speed after over speed before an impact [1]."""


class AbstractJointStop(AbstractEffect):
    """Two unilateral gaps along a joint's coordinate."""

    @abstractmethod
    def ends(self) -> tuple[Scalar, Scalar]:
        """Lowest and highest q that the stops allow [rad or m]."""

    @abstractmethod
    def wall(self) -> Wall:
        """How the ends answer a blow."""


class AbstractJointClearance(AbstractEffect):
    """A pin that moves inside its hole."""

    shape: eqx.AbstractVar[str]
    """'circle', or 'rectangle': separate bounds along x and y of frame A."""
    rings: eqx.AbstractVar[int]
    """1: the pin stays parallel to the hole; 2: it also tilts, held at both ends of its bearing."""

    @abstractmethod
    def radius(self) -> Scalar:
        """Largest offset of the pin's axis from the hole's [m]."""

    @abstractmethod
    def bearing_length(self) -> Scalar:
        """Distance of the two rings [m]."""

    @abstractmethod
    def wall(self) -> Wall:
        """How the hole answers the pin."""


class AbstractSection(AbstractEffect):
    """A spring hinge inside a body, which `backend.model.flexible` cuts in two there."""

    @abstractmethod
    def stiffness(self) -> Scalar:
        """Against bending [N m/rad]."""

    @abstractmethod
    def damping(self) -> Scalar:
        """Against the rate of bending [N m s/rad]."""


class AbstractJointMotion(AbstractEffect):
    """A joint whose coordinate is given."""

    @abstractmethod
    def target(self) -> Scalar:
        """q at the end of the step [rad or m]."""


class AbstractBodyForce(AbstractEffect):
    """Forces that depend on where bodies are.  The second body takes the reaction."""

    @abstractmethod
    def wrench(self, a: BodyView, b: BodyView) -> tuple[Wrench, Wrench | None]:
        """Wrenches on a and on b, each about its centre of mass; None on the world."""

    @abstractmethod
    def potential(self, a: BodyView, b: BodyView) -> Scalar:
        """Energy stored [J]; 0 where the force is a drive."""


class AbstractDrag(AbstractEffect):
    """A force on one body against its velocity."""

    @abstractmethod
    def wrench(self, body: BodyView) -> Wrench:
        """Wrench about the body's centre of mass; it never does positive work."""


class AbstractStrut(AbstractEffect):
    """A line between a point on each of two bodies that pulls and damps along itself."""

    @abstractmethod
    def anchors(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """The line's ends in the first and in the second body [m]."""

    @abstractmethod
    def tension(self, length: Scalar) -> Scalar:
        """Pull between the ends [N] at a length [m]."""

    @abstractmethod
    def damping(self) -> Scalar:
        """Against lengthening [N s/m]."""

    @abstractmethod
    def potential(self, length: Scalar) -> Scalar:
        """Energy stored [J]."""


class Capsule(eqx.Module):
    """A rod with round ends, in body axes, from the body's origin."""

    start: Float[Array, "3"]
    end: Float[Array, "3"]
    radius: Scalar


class AbstractLinkContact(AbstractEffect):
    """Two bodies that cannot pass through each other."""

    @abstractmethod
    def capsules(self) -> tuple[Capsule, Capsule]:
        """What of the first and of the second body touches."""

    @abstractmethod
    def wall(self) -> Wall:
        """How they answer each other."""


class AbstractBedFriction(AbstractEffect):
    """A body that slides on the bed under its own weight."""

    @abstractmethod
    def coefficient(self) -> Scalar:
        """Friction force over the force on the bed [1]."""


class AbstractDrawnError(AbstractEffect):
    """A difference between the part and its drawing."""

    @abstractmethod
    def redraw(self, drawing, place: int):
        """The drawing with this body or joint (an index; past the moving bodies for the world) as it really is."""


class AbstractMarkerError(AbstractEffect):
    """A marker that sits elsewhere on its body than drawn."""

    @abstractmethod
    def moved(self, p_BM: Float[Array, "3"], axis_B: Float[Array, "3"]) -> Float[Array, "3"]:
        """Where it sits, in body axes [m]; axis_B is the line of sight at the drawn pose, a unit vector."""


class AbstractSpringError(AbstractEffect):
    """A difference between another effect and its drawing; `on` names that effect."""

    amends: ClassVar[tuple[str, ...]]
    """Kinds that it can stand on."""

    @abstractmethod
    def amend(self, effect: AbstractEffect) -> AbstractEffect:
        """The other effect as it really is."""


class AbstractBaseMotion(AbstractEffect):
    """A base that moves in W and takes everything fixed with it; the mechanism is computed in the base's frame."""

    @abstractmethod
    def displacement(self, time_s: Float[Array, "*batch"]) -> Float[Array, "*batch 3"]:
        """Of the base, in W [m]."""

    @abstractmethod
    def acceleration(self, time_s: Scalar) -> Float[Array, "3"]:
        """Of the base, in W [m/s²]."""


class AbstractHold(AbstractEffect):
    """A mechanism that is held for longer than stated."""

    @abstractmethod
    def delay(self) -> Scalar:
        """Time from the stated release to the true one [s]."""


class AbstractPush(AbstractEffect):
    """A speed of joints at the moment of release."""

    @abstractmethod
    def speed(self, turning: Bool[Array, ""]) -> Scalar:
        """Of a joint that turns [rad/s] or slides [m/s]."""


class Camera(eqx.Module):
    """Where a camera looks from: along `axis`, at the middle of what is drawn."""

    axis: Float[Array, "3"]
    """Unit direction in W about which joints turn."""
    down: Float[Array, "3"]
    """Unit direction in W from the first row of a picture to the last."""
    center: Float[Array, "3"]
    """Point in W at the picture's middle [m]."""
    reach: Scalar
    """Longest extent of what is drawn [m]."""

    @property
    def right(self) -> Float[Array, "3"]:
        """Unit direction in W along the rows of a picture, so that right x down = axis."""
        return jnp.cross(self.down, self.axis)

    def aimed(self, right_m: Scalar, down_m: Scalar) -> Float[Array, "3"]:
        """World point where a line of sight meets the picture, so far from the middle of what is drawn [m]."""
        return self.center + right_m * self.right + down_m * self.down


class Sight(eqx.Module):
    """Points as a camera meets them."""

    p_WP: Float[Array, "*batch 3"]
    v_WP: Float[Array, "*batch 3"]
    time_s: Float[Array, "*batch"]
    """Since the stated release [s]."""
    began_s: Float[Array, ""]
    """First frame of the record, counted alike."""


class AbstractView(AbstractEffect):
    """A difference between where a point is and where the camera says it is."""

    @abstractmethod
    def view(self, sight: Sight, camera: Camera) -> Float[Array, "*batch 3"]:
        """Reported position of world points [m]."""


class AbstractShutter(AbstractEffect):
    """A difference between when a picture was taken and when a point in it was."""

    @abstractmethod
    def delay(self, sight: Sight, camera: Camera) -> Float[Array, "*batch"]:
        """Time by which the point was taken later than its picture [s]."""


class AbstractClock(AbstractEffect):
    """A difference between the time a sample carries and when it was taken."""

    @abstractmethod
    def true_time(self, time_s: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """When a sample that says `time_s` was taken [s]."""


@jax.jit
def across(axis: Float[Array, "3"]) -> Float[Array, "2 3"]:
    """The two coordinate axes that lie across a direction best, in order: x and y across z, x and z across y."""
    two = jnp.array([[1, 2], [0, 2], [0, 1]])[jnp.argmax(jnp.abs(axis))]
    return jnp.eye(3)[two]
