"""Pages: they stand alone, say what the numbers say, and refuse evidence that does not fit together."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from backend.mechanism.fit_report import FitReport
from backend.mechanism.read import parse_mechanism
from backend.report.demo_page import write_demo_page
from backend.report.evidence import Channel, DemoEvidence, FitEvidence, Motion, Overlay, SimulationEvidence
from backend.report.fit_page import pooled, write_fit_page
from backend.report.simulation_page import write_simulation_page
from backend.report.skeleton import best_view, rotated, skeleton_of

ABOUT_Y = [0.7071067811865476, 0.7071067811865476, 0.0, 0.0]
PENDULUM = parse_mechanism(
    {
        "schema_version": "1.0",
        "name": "pendulum <of> test",
        "bodies": [
            {"id": "ground", "fixed": True, "pose": {"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]}},
            {
                "id": "bar",
                "pose": {"position_m": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]},
                "inertial": {
                    "mass_kg": 0.05,
                    "center_of_mass_m": [0.1, 0, 0],
                    "inertia_kg_m2": {"xx": 1e-6, "yy": 1e-4, "zz": 1e-4, "xy": 0, "xz": 0, "yz": 0},
                },
            },
        ],
        "joints": [
            {
                "id": "pin",
                "type": "revolute",
                "body_a": "ground",
                "body_b": "bar",
                "frame_a": {"position_m": [0, 0, 0], "quaternion_wxyz": ABOUT_Y},
                "frame_b": {"position_m": [0, 0, 0], "quaternion_wxyz": ABOUT_Y},
            }
        ],
        "markers": [{"id": "tip", "body": "bar", "position_m": [0.2, 0, 0]}],
    }
)
TIME = np.linspace(0.0, 1.0, 201)
ANGLE = 0.5 * np.cos(8.0 * TIME)
NAME = "coulomb_friction:pin.friction_torque_n_m"


def motion() -> Motion:
    """The bar turned about -y by ANGLE, so that its tip is at 0.2 (cos, 0, sin)."""
    quaternion = np.stack([np.cos(ANGLE / 2), 0 * ANGLE, -np.sin(ANGLE / 2), 0 * ANGLE], axis=1)
    return Motion(TIME, {"bar": np.zeros((201, 3))}, {"bar": quaternion})


def channel(use="fit", experiment="e1") -> Channel:
    after = 0.2 * np.sin(ANGLE)
    noise = 1e-4 * np.random.default_rng(1).standard_normal(201)
    return Channel(experiment, use, "marker:tip", "z", "m", TIME, after + noise, 1.1 * after, after, 1e-4, 0.1)


def report(**changed) -> FitReport:
    given = {
        "parameters": [
            {
                "name": NAME,
                "kind": "coulomb_friction",
                "on": ["pin"],
                "parameter": "friction_torque_n_m",
                "value": 0.011,
                "sd": 0.0004,
                "ci95": [0.0102, 0.0118],
                "unit": "N m",
            }
        ],
        "correlation": [[1.0]],
        "residuals": [
            {
                "experiment": "e1",
                "at": "marker:tip",
                "rms": 1e-4,
                "before": 9e-3,
                "noise": 1e-4,
                "unit": "m",
                "count": 200,
            }
        ],
        "held_out": [
            {
                "experiment": "e2",
                "use": "held_out",
                "at": "marker:tip",
                "rms": 2e-4,
                "before": 8e-3,
                "unit": "m",
                "count": 200,
            }
        ],
        "history": [
            {
                "iteration": i,
                "objective": 100.0 / 4**i,
                "gradient_norm": 10.0 / 9**i,
                "parameters": {NAME: 0.011 - 0.01 / 3**i},
            }
            for i in range(4)
        ],
        "converged": True,
        "wall_s": 1.5,
    }
    return FitReport.model_validate(given | changed)


def fit_evidence(**changed) -> FitEvidence:
    overlay = Overlay("e1", motion(), seen_time_s=TIME, seen_m={"tip": np.zeros((201, 3))})
    evidence = FitEvidence(
        "pendulum", PENDULUM, report(), (channel(), channel("held_out", "e2")), (overlay,), {NAME: 0.0115}
    )
    return replace(evidence, **changed)


class Links(HTMLParser):
    """Everything a page would fetch, and every tag that was opened and not closed."""

    def __init__(self, page: str):
        super().__init__()
        self.fetched: list[str] = []
        self.open: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.fetched += [value for name, value in attrs if name in ("src", "href") and not value.startswith("data:")]
        if tag not in ("meta", "input", "img", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture
def fit_page(tmp_path) -> str:
    return write_fit_page(fit_evidence(), tmp_path / "deep" / "fit.html").read_text(encoding="utf-8")


def test_a_page_is_whole_and_fetches_nothing(fit_page):
    links = Links(fit_page)
    assert links.open == []
    assert links.fetched == []
    assert "@import" not in fit_page
    assert "url(" not in fit_page
    assert len(fit_page) < 1_000_000  # a mail attachment


def test_the_fit_page_says_value_interval_truth_and_errors_in_millimetres(fit_page):
    assert re.search(r"<b>0\.01100</b>", fit_page)
    assert "0.01020 … 0.01180" in fit_page
    assert ", inside" in fit_page
    assert "<b>0.100 mm</b>" in fit_page
    assert "<b>8.00 mm</b>" in fit_page


def test_a_truth_outside_its_interval_is_called_so(tmp_path):
    page = write_fit_page(fit_evidence(truth={NAME: 0.02}), tmp_path / "fit.html").read_text(encoding="utf-8")
    assert ", outside" in page
    assert ", inside" not in page


def test_an_unconverged_fit_says_so_before_any_value(tmp_path):
    evidence = fit_evidence(report=report(converged=False, warnings=["The step limit was reached."]))
    page = write_fit_page(evidence, tmp_path / "fit.html").read_text(encoding="utf-8")
    assert page.index("NOT converged") < page.index("0.01100")
    assert page.index("The step limit was reached.") < page.index("0.01100")


def test_names_in_a_drawing_are_text_not_markup(tmp_path):
    evidence = SimulationEvidence(
        PENDULUM, motion(), {"pin": ANGLE}, np.ones(201), -np.ones(201), np.full(201, 1e-12), 0.005, "done"
    )
    page = write_simulation_page(evidence, tmp_path / "simulation.html").read_text(encoding="utf-8")
    assert "pendulum &lt;of&gt; test" in page
    assert "<of>" not in page
    Links(page)


def test_a_simulation_that_broke_off_warns_at_the_top(tmp_path):
    sentence = "the step at 0.3 s could not be solved; try a smaller step"
    evidence = SimulationEvidence(
        PENDULUM, motion(), {"pin": ANGLE}, np.ones(201), -np.ones(201), np.zeros(201), 0.005, sentence
    )
    page = write_simulation_page(evidence, tmp_path / "simulation.html").read_text(encoding="utf-8")
    assert page.index(sentence) < page.index("The motion")


def test_the_demonstration_compares_drawing_and_twin_on_the_unseen_load(tmp_path):
    unseen = channel("held_out", "heavy")
    evidence = DemoEvidence(
        fit=fit_evidence(),
        reality="The real pin had friction.",
        frames=240,
        frames_per_s=240.0,
        stills=((0.5, b"\x89PNG"),),
        prediction=(unseen,),
        unseen="A load twice as heavy.",
    )
    page = write_demo_page(evidence, tmp_path / "demo.html").read_text(encoding="utf-8")
    Links(page)
    assert "1 of 1" in page  # the truth 0.0115 lies in 0.0102 to 0.0118
    assert "<b>8.00 mm</b>" in page  # held out, as drawn
    assert "<b>0.200 mm</b>" in page
    assert "40 times closer" in page


def test_series_of_different_lengths_are_refused_by_name():
    with pytest.raises(ValueError, match=r"e1, marker:tip z: after has shape \(3,\)"):
        Channel("e1", "fit", "marker:tip", "z", "m", TIME, np.zeros(201), None, np.zeros(3))


def test_pooled_error_weighs_experiments_by_their_samples():
    rows = [report().residuals[0], report().residuals[0].model_copy(update={"rms": 3e-4, "count": 600})]
    assert pooled(rows) == pytest.approx(np.sqrt((200 * 1e-8 + 600 * 9e-8) / 800), rel=1e-12)  # exact arithmetic


def test_the_skeleton_follows_the_bodies():
    placed = skeleton_of(PENDULUM).placed(motion())["bar"]
    tip = placed[:, 1]  # the pin, then the marker
    expected = 0.2 * np.stack([np.cos(ANGLE), 0 * ANGLE, np.sin(ANGLE)], axis=1)
    np.testing.assert_allclose(tip, expected, atol=1e-15)  # rounding of products of order 0.1
    assert best_view({"bar": placed}).name == "x–z plane"


def test_turning_points_keeps_their_distance_from_the_origin():
    rng = np.random.default_rng(3)
    q = rng.standard_normal((20, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    p = rng.standard_normal((5, 3))
    lengths = np.linalg.norm(rotated(q, p), axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(np.linalg.norm(p, axis=1), (20, 5)), rtol=1e-12)  # rounding


def test_the_playback_carries_the_motion_in_millimetres(fit_page):
    stored = re.search(r'<script type="application/json">(.*?)</script>', fit_page).group(1)
    played = json.loads(stored)
    assert len(played["time_s"]) == 201
    first_tip = played["after"][0][0][1]
    assert first_tip == pytest.approx([200 * np.cos(0.5), 200 * np.sin(0.5)], abs=0.05)  # rounded to 0.1 mm
