"""Air against bars: a closed form, and the double pendulum of the withheld check, which knows nothing of ours."""

import numpy as np
import pytest

from backend.blind.withheld.laws import Change, as_drawn, changed
from backend.blind.withheld.linkage import GRAVITY, Link, Linkage, Pin
from backend.blind.withheld.motion import move
from backend.effects.air_drag import AIR_DENSITY_KG_PER_M3
from backend.model.build import build
from tests.mechanisms import bar_inertia, double_pendulum, effect
from tests.motions import follow

MASS, LENGTH, AREA = 0.1, 0.2, 0.05
STEP_S, STEPS = 1e-3, 1000
WHOLE = {"drag_area_m2": AREA, "half_length_m": LENGTH / 2}


@pytest.mark.parametrize("slip", [0.0, 1.0])
def test_a_bar_that_is_spun_about_its_end_slows_as_one_over_time(swinging, slip):
    spun, about_pin = 4.0, bar_inertia(MASS, LENGTH)[2] + MASS * (LENGTH / 2) ** 2
    velocity = np.array([[spun * LENGTH / 2, 0, 0, 0, 0, spun]])
    motion = follow(swinging(0.0, weight=False, air_drag={**WHOLE, "slip": slip}), STEP_S, STEPS, velocity)
    rate = 0.5 * AIR_DENSITY_KG_PER_M3 * AREA * LENGTH**3 / 4 / about_pin * spun  # the arm's cube over the length
    np.testing.assert_allclose(motion.path.rate[:, 0], spun / (1 + rate * motion.path.time_s), atol=1e-5)


def double_pendulum_of_the_check():
    """The same two bars, level, as the withheld check draws linkages."""
    inertia = bar_inertia(MASS, LENGTH)[2]
    links = tuple(
        Link(id, complex(x), 0.0, MASS, LENGTH / 2, inertia, (0.0, LENGTH), 0.01, (complex(LENGTH),))
        for id, x in (("upper", 0.0), ("lower", LENGTH))
    )
    pins = (Pin("shoulder", 0, 1, 0j), Pin("elbow", 1, 2, complex(LENGTH)))
    return Linkage("double pendulum", links, pins, (0, 1), ((-2.0, 2.0), (-2.0, 2.0)))


def test_a_lower_link_feels_the_air_along_its_length_as_the_withheld_check_has_it():
    linkage, per_length = double_pendulum_of_the_check(), 0.5 * AIR_DENSITY_KG_PER_M3 * AREA / LENGTH
    laws = changed(as_drawn(linkage), [Change("drag", 1, per_length)])
    theirs = move(linkage, laws, np.zeros((1, 2)), 1.0)

    def apart(**given):
        air = effect("air", "air_drag", ["lower"], drag_area_m2=AREA, **given)
        drawn = double_pendulum([air]).model_copy(update={"gravity_m_per_s2": (0.0, -GRAVITY, 0.0)})
        path = follow(build(drawn), STEP_S, STEPS).path
        at = np.round(theirs.time_s / STEP_S).astype(int)
        shared = np.abs(path.time_s[at] - theirs.time_s) < 1e-9
        return np.abs(path.q[at] - theirs.state[0, :, :2])[shared].max()

    assert apart(half_length_m=LENGTH / 2, slip=1.0) < 4e-4  # of second order in the step
    assert apart(half_length_m=LENGTH / 2) > 4e-3
    assert apart() > 4e-3
