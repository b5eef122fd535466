"""A link found to bend: the drawing that is fitted has a hinge more than the one that was measured."""

import numpy as np
import pandas as pd

from backend.fit.free import free_parameters
from backend.fit.prediction import addresses_of
from backend.fit.run import Run
from backend.mechanism.study import Experiment, Release
from backend.model.build import build
from backend.model.system import system
from backend.simulate.assemble import start
from backend.simulate.points import marker_positions
from tests.mechanisms import fourbar


def test_a_start_is_found_where_a_marker_stands_though_a_link_bends():
    drawn = fourbar()
    freedom = free_parameters(drawn, ["link_flexibility:coupler"])
    model = build(drawn, freedom.added)
    knee = np.array([0.28, 0.2, 0.0]) + 1e-5 * np.random.default_rng(0).standard_normal((20, 3))
    x, y, z = knee.T
    seen = pd.DataFrame(
        {"time_s": 0.005 * np.arange(20), "marker": "knee", "x_m": x, "y_m": y, "z_m": z, "sigma_m": 1e-5}
    )
    release = Release(time_s=0.08, at_rest=True)
    run = Run.of(Experiment("e", "fit", release, tracks=seen), model, addresses_of(freedom.parameters), 1e-3)
    plant = system(model)
    begin = start(plant, run.found.reference, run.found.motions, np.zeros(1), np.zeros(1))
    np.testing.assert_allclose(marker_positions(model, plant, begin.pose)[0], knee.mean(0), atol=2e-5)
    assert run.found.motions.shape[-1] == 1
