"""The file of a fit whose searches go at the same time."""

import numpy as np
import pytest

from backend.fit.checkpoint import Checkpoint
from backend.fit.solve import Iteration


def test_each_of_several_searches_goes_on_from_its_own_stages(tmp_path):
    path = tmp_path / "fit.checkpoint.json"
    kept = Checkpoint(path, "a fit")
    for k, spread in enumerate((1.0, 2.0, 3.0)):
        kept.branch(k).begin(spread).add(Iteration(0, 5.0, 0.1, np.array([spread, k])))
    kept.branch(1).write()  # of one search alone; what the others did is kept with it
    again = Checkpoint.resume(path, "a fit")
    for k, spread in enumerate((1.0, 2.0, 3.0)):
        stage = again.branch(k).known()
        assert stage is not None
        assert (stage.spread, stage.end) == (spread, None)
        np.testing.assert_array_equal(stage.history[0].parameters, [spread, k])
        assert again.branch(k).known() is None
    assert again.known() is None  # no stage of its own came after them
    again.remove()
    assert not path.exists()


def test_what_another_version_wrote_is_refused_by_that_name(tmp_path):
    path = tmp_path / "fit.checkpoint.json"
    path.write_text('{"format": 1, "digest": "a fit", "stages": []}')
    with pytest.raises(ValueError, match="another version of linktwin: start again without --resume"):
        Checkpoint.resume(path, "a fit")
