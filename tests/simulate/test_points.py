"""Markers of a motion that ends early, found block by block."""

import jax
import numpy as np

from backend.model.build import build
from backend.model.state import Start, drawn_pose
from backend.model.system import system
from backend.simulate.points import BLOCK, marker_paths, marker_velocities, markers_until
from backend.simulate.rollout import rollout
from tests.mechanisms import double_pendulum, effect
from tests.motions import still

STEPS, STEP_S = 3 * BLOCK + 7, 1e-3


def test_markers_stand_where_they_do_in_the_whole_motion_with_their_slopes():
    model = build(double_pendulum([effect("f", "viscous_friction", ["elbow"])]))

    def seen(damping, until):
        plant = system(model.with_parameters({("f", "damping_n_m_s_per_rad"): damping}))
        path = rollout(plant, Start(drawn_pose(model, plant), still(model)), STEP_S, STEPS)
        whole = marker_paths(model, plant, path), marker_velocities(model, plant, path)
        return whole, markers_until(model, plant, path, until)

    # Of one motion: a second program rounds otherwise, and a double pendulum makes that grow.
    sloped = jax.jit(lambda until: jax.jvp(lambda d: seen(d, until), (np.array(1e-3),), (np.array(1.0),)))
    for until in (BLOCK - 1, BLOCK, 2 * BLOCK + 3, STEPS):
        values, slopes = sloped(until)
        whole, early = (jax.tree.leaves([values[k], slopes[k]]) for k in (0, 1))
        for all_, some in zip(whole, early, strict=True):
            np.testing.assert_allclose(some[: until + 1], all_[: until + 1], rtol=0, atol=1e-12 * np.abs(all_).max())
            np.testing.assert_array_equal(some[(until // BLOCK + 1) * BLOCK :], 0.0)
            assert np.abs(all_).max() > 0.0
