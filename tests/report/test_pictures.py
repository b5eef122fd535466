"""Linked pictures: what the browser plays back is what was simulated, as far as it was."""

import json

import numpy as np
import pytest

from backend.report.chart import Chart, Series
from backend.report.evidence import Motion, Overlay
from backend.report.pictures import FRAMES, Linked, Pictures, write_pictures

TURN = np.linspace(0.0, 4.0 * np.pi, 2001)  # two whole turns about z


def turning(lost_from: int | None = None) -> Motion:
    half = 0.5 * TURN
    q = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], 1)
    q *= np.where(np.arange(len(q)) % 2, -1.0, 1.0)[:, None]  # the same rotations, signs at random
    p = np.stack([np.cos(TURN), np.sin(TURN), 0 * TURN], 1)
    if lost_from is not None:
        p[lost_from:] = np.nan
    return Motion(0.001 * np.arange(len(TURN)), {"link": p}, {"link": q})


def written(tmp_path, overlay: Overlay) -> dict:
    chart = Chart("tip", "time [s]", "x", [Series("x", np.arange(3.0), np.arange(3.0))])
    path = write_pictures(Pictures("fit", [overlay], [Linked(chart, "one", "e1", 0.25)]), tmp_path / "pictures.json")
    return json.loads(path.read_text(), parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))


def test_rotations_have_no_jumps_to_interpolate_over(tmp_path):
    track = written(tmp_path, Overlay("e1", turning()))["motions"][0]["after"]["link"]
    q = np.array(track["quaternion_wxyz"]).reshape(-1, 4)
    assert len(q) == FRAMES
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    assert (
        steps.max() < 0.5 * 4.0 * np.pi / (FRAMES - 1) * 1.5
    )  # half the turn between two frames, and rounding of nodes


def test_a_motion_that_was_lost_ends_where_it_was_lost(tmp_path):
    motion = written(tmp_path, Overlay("e1", turning(lost_from=500)))["motions"][0]
    assert motion["time_s"][-1] == pytest.approx(0.499)
    assert len(motion["after"]["link"]["position_m"]) == 3 * len(motion["time_s"])


def test_the_drawing_may_be_lost_before_the_twin_and_then_stays(tmp_path):
    motion = written(tmp_path, Overlay("e1", turning(), before=turning(lost_from=500)))["motions"][0]
    before = np.array(motion["before"]["link"]["position_m"]).reshape(-1, 3)
    assert len(before) == len(motion["time_s"])
    np.testing.assert_allclose(before[-1], [np.cos(TURN[499]), np.sin(TURN[499]), 0.0], atol=1e-7)  # written to 1e-7 m


def test_what_was_not_seen_is_null_and_charts_keep_their_clock(tmp_path):
    seen = np.array([[0.1, 0.0, 0.0], [np.nan, 0.0, 0.0], [0.3, 0.0, 0.0]])
    told = written(tmp_path, Overlay("e1", turning(), seen_time_s=np.arange(3.0), seen_m={"tip": seen}))
    assert told["motions"][0]["seen"]["markers"]["tip"] == [[0.1, 0.0, 0.0], None, [0.3, 0.0, 0.0]]
    assert (told["charts"][0]["run"], told["charts"][0]["offset_s"]) == ("e1", 0.25)
