"""The report of a gap: its page and its screenful say what gap.json says, in words and units of the bench."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

from backend.cli import app
from backend.diagnose.library import families
from backend.mechanism.gap_report import Amount, CauseEffect, Detectable, GapReport, NextExperiment
from backend.mechanism.read import parse_mechanism
from backend.report.evidence import Channel, GapEvidence, Missing, Motion
from backend.report.gap_page import write_gap_page
from backend.report.gap_summary import gap_text
from backend.report.gap_words import (
    MEANING,
    alike,
    amount,
    effect_name,
    least,
    next_sentence,
    parameter_name,
    percent,
    worst_first,
)
from backend.report.quantity import prefixed, shown

TURN = [0.7071067811865476, 0.7071067811865476, 0.0, 0.0]
STILL = {"position_m": [0.0, 0.0, 0.0], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]}
PIN = {"position_m": [0.0, 0.0, 0.0], "quaternion_wxyz": TURN}
MASS, CENTRE, INERTIA = 0.05, 0.1, 2e-4  # kg, m, kg m² about the centre of mass
FRICTION, SIGMA = 1.5e-3, 2e-3  # N m, rad
LIBRARY = ("coulomb_friction", "viscous_friction", "mass_error")
DRAWING = {
    "schema_version": "1.0",
    "name": "bar <on> a pin",
    "bodies": [
        {"id": "ground", "fixed": True, "pose": STILL},
        {
            "id": "bar",
            "pose": STILL,
            "inertial": {
                "mass_kg": MASS,
                "center_of_mass_m": [CENTRE, 0.0, 0.0],
                "inertia_kg_m2": {"xx": 1e-6, "yy": INERTIA, "zz": INERTIA, "xy": 0.0, "xz": 0.0, "yz": 0.0},
            },
        },
    ],
    "joints": [{"id": "pin", "type": "revolute", "body_a": "ground", "body_b": "bar", "frame_a": PIN, "frame_b": PIN}],
    "markers": [{"id": "tip", "body": "bar", "position_m": [0.2, 0.0, 0.0]}],
}


class Page(HTMLParser):
    """Its text, all that it would fetch, and whether every tag is closed."""

    def __init__(self, html: str):
        super().__init__()
        self.html, self.text, self.open, self.fetched = html, "", [], []
        self.feed(html)
        assert self.open == []
        self.text = re.sub(r"\s+", " ", self.text)

    def handle_starttag(self, tag, attrs):
        self.fetched += [value for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "input", "img", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] not in (["style"], ["script"]):
            self.text += data + " "


def pendulum(start: float, rng: np.random.Generator) -> Iterator[str]:
    """Encoder of a bar with dry friction, let go from `start` [rad] above the level; gravity along -z, 9.80665 m/s²."""
    time = np.arange(0.0, 1.2, 0.01)

    def rates(t, y):
        # The pin's axis is -y: a positive angle lifts the bar.
        torque = -MASS * 9.80665 * CENTRE * np.cos(y[0]) - FRICTION * np.tanh(y[1] / 1e-3)
        return [y[1], torque / (INERTIA + MASS * CENTRE**2)]

    path = solve_ivp(rates, (0.0, time[-1]), [start, 0.0], "LSODA", time, rtol=1e-8, atol=1e-10).y[0]
    angles = np.concatenate([np.full(20, start), path])
    times = np.concatenate([np.arange(-20, 0) * 0.01, time])
    yield "time_s,joint,q,sigma"
    for t, q in zip(times + 0.2, angles + SIGMA * rng.standard_normal(times.size), strict=True):
        yield f"{t:.6f},pin,{q:.9f},{SIGMA}"


@dataclass(frozen=True)
class Told:
    """What the command said and wrote."""

    said: str
    report: GapReport
    page: Page


@pytest.fixture(scope="module")
def told(tmp_path_factory) -> Told:
    """Three releases of a real bar that rubs, diagnosed with a library of three kinds."""
    folder = tmp_path_factory.mktemp("rubbing")
    rng = np.random.default_rng(5)
    experiments = []
    for i, (start, use) in enumerate([(0.2, "fit"), (-0.5, "fit"), (-0.1, "held_out")]):
        (folder / f"e{i}.csv").write_text("\n".join(pendulum(start, rng)) + "\n")
        experiments.append({"id": f"e{i}", "use": use, "joint_positions": f"e{i}.csv", "release": {"time_s": 0.2}})
    (folder / "mechanism.json").write_text(json.dumps(DRAWING))
    study = {"schema_version": "1.0", "mechanism": "mechanism.json", "experiments": experiments}
    (folder / "study.json").write_text(json.dumps(study))
    out = [kind for kinds in families().values() for kind in kinds if kind not in LIBRARY]
    asked = ["diagnose", str(folder / "study.json"), "--out", str(folder / "told"), "--without", ",".join(out)]
    done = CliRunner().invoke(app, asked, catch_exceptions=False)
    assert done.exit_code == 0, done.stderr
    report = GapReport.model_validate_json((folder / "told" / "gap.json").read_text())
    return Told(done.stdout, report, Page((folder / "told" / "gap.html").read_text(encoding="utf-8")))


def test_the_command_finds_the_friction_that_the_drawing_lacks(told):
    found = {e.kind: e for e in told.report.causes[0].effects}
    assert told.report.verdict in ("identified", "ambiguous")
    friction = found["coulomb_friction"].parameters["friction_torque_n_m"]
    # Three standard deviations are 0.5%; the step of a diagnosis, as coarse as the noise allows, is worth 1%.
    assert abs(friction.value - FRICTION) < 0.03 * FRICTION
    assert told.report.shrink.unit == "rad"


def test_the_screenful_and_the_page_say_the_verdict_and_the_value_of_gap_json(told):
    value = next(e for e in told.report.causes[0].effects if e.kind == "coulomb_friction").parameters[
        "friction_torque_n_m"
    ]
    for text in (told.said, told.page.text):
        assert told.report.sentence in text
        assert f"friction torque {amount(value)}" in text
    assert "mN m" in amount(value)
    assert MEANING[told.report.verdict][0] in told.page.text


def test_the_page_is_whole_fetches_nothing_and_is_small(told):
    assert told.page.fetched == []
    assert "url(" not in told.page.html
    assert len(told.page.html) < 200_000  # a mail attachment; 62 kB measured
    assert "bar <on> a pin" in told.page.text


def test_the_page_shows_one_panel_of_missing_torque_for_each_fitted_run(told):
    for experiment in ("e0", "e1"):
        assert told.page.html.count(f'aria-label="{experiment}: torque missing at joint pin"') == 1
    assert "missing torque [mN m]" in told.page.text


def test_the_page_overlays_the_held_out_run_and_shows_the_error_shrink_in_milliradians(told):
    assert "Experiment e2, held out" in told.page.text
    held = told.report.shrink.held_out
    assert f"{shown(1e3 * held.before_rms_m)} mrad" in told.page.text
    assert held.after_rms_m < 0.1 * held.before_rms_m


# Pages of reports made by hand


def report(**changed) -> GapReport:
    friction = {
        "effects": [{"kind": "coulomb_friction", "on": ["pin"],
                     "parameters": {"friction_torque_n_m": {"value": 4e-4, "sd": 1e-5, "unit": "N m"}}}],
        "probability": 0.6, "log_evidence": -10.0, "indistinguishable_from": [["effort_offset", "pin"]],
    }  # fmt: skip
    tilt = {
        "effects": [{"kind": "camera_rotation", "on": ["camera"],
                     "parameters": {"rad": {"value": 3e-3, "sd": 1e-4, "unit": "rad"}}}],
        "probability": 0.39, "log_evidence": -10.4,
    }  # fmt: skip
    given = {
        "verdict": "ambiguous", "sentence": "The gap is friction, or the camera.",
        "where": {"locations": [{"at": "joint:pin", "probability": 0.6}, {"at": "camera", "probability": 0.4}],
                  "phases": [{"experiment": "e0", "at": "joint:pin", "start_s": 0.2, "end_s": 0.6, "missing": -4e-4,
                              "sd": 1e-5, "unit": "N m"}]},
        "causes": [friction, tilt], "probability_none": 0.0, "probability_unknown": 0.01, "p_value": 1e-5,
        "shrink": {"held_out": {"before_rms_m": 4e-3, "after_rms_m": 5e-4, "noise_rms_m": 4.5e-4,
                                "explained_fraction": 0.98, "explained_fraction_ci95": [0.96, 0.99]}},
        "detectable": [{"kind": "mass_error", "on": ["bar"], "parameter": "relative", "minimum": 0.013, "unit": "1"}],
    }  # fmt: skip
    return GapReport.model_validate(given | changed)


def evidence(**changed) -> GapEvidence:
    t = np.linspace(0.0, 1.0, 101)
    pose = Motion(np.zeros(1), {"bar": np.zeros((1, 3))}, {"bar": np.array([[1.0, 0.0, 0.0, 0.0]])})
    measured = 0.2 * np.sin(6 * t)
    seen = Channel("e1", "held_out", "marker:tip", "z", "m", t, measured, 1.02 * measured, measured + 1e-4, 1e-4, 0.1)
    missing = Missing("e0", t, -4e-4 * np.sin(6 * t), np.full(101, 2e-5))
    return GapEvidence(
        parse_mechanism(DRAWING), report(**changed), pose, (missing,), "joint:pin", "N m", channels=(seen,)
    )


def test_a_base_that_moves_is_told_in_millimetres_along_its_axis(tmp_path):
    t = np.linspace(0.0, 1.0, 101)
    moved = Missing("e0", t, 4e-3 * np.sin(20 * t), np.full(101, 1e-4))
    where = {"locations": [{"at": "world", "probability": 1.0}], "model_free": [{"at": "world", "probability": 1.0}],
             "phases": [{"experiment": "e0", "at": "world", "start_s": 0.2, "end_s": 0.3, "missing": 3e-3, "sd": 1e-4,
                         "unit": "m"}]}  # fmt: skip
    shown_ = replace(
        evidence(verdict="unknown", where=where),
        missing=(moved,),
        missing_at="world",
        missing_unit="m",
        missing_along="x",
    )
    page = page_of(shown_, tmp_path)
    assert "What is missing at the world around it, against time" in page.text
    assert page.html.count('aria-label="e0: motion along x missing at the world around it"') == 1
    assert "missing motion along x [mm]" in page.text
    assert "not noise" in page.html


def page_of(made: GapEvidence, folder: Path) -> Page:
    return Page(write_gap_page(made, folder / "gap.html").read_text(encoding="utf-8"))


@pytest.mark.parametrize("verdict", ["none", "identified", "ambiguous", "approximate", "unknown"])
def test_every_verdict_stands_first_with_its_own_badge(verdict, tmp_path):
    page = page_of(evidence(verdict=verdict), tmp_path)
    assert f'class="badge {verdict}"' in page.html
    assert page.html.index("The gap is friction") < page.html.index("<h2>")


def test_a_place_is_as_orange_as_it_is_probable_and_the_camera_is_told_beside(tmp_path):
    page = page_of(evidence(), tmp_path)
    assert 'class="suspect" style="fill-opacity:0.60"' in page.html
    assert "joint pin: 60%" in page.text
    assert "outside the mechanism, the camera: 40%" in page.text


def test_a_stretch_of_missing_torque_is_shaded_where_it_begins_and_ends(tmp_path):
    page = page_of(evidence(), tmp_path)
    chart = page.html[page.html.index('aria-label="e0: torque missing at joint pin"') :]
    left, right = (float(x) for x in re.search(r'data-range="([^,]*),([^,]*)', chart).groups())
    x, width = (float(v) for v in re.search(r'class="stretch" x="([\d.]*)" y="12" width="([\d.]*)"', chart).groups())
    columns = 520 - 66 - 10  # px between the margins
    assert x == pytest.approx(66 + 0.2 / (right - left) * columns, abs=0.1)  # coordinates keep one decimal
    assert width == pytest.approx(0.4 / (right - left) * columns, abs=0.1)


def test_a_page_owns_that_unknown_forces_alone_would_lie_elsewhere_than_the_cause(tmp_path):
    where = {
        "locations": [{"at": "joint:pin", "probability": 1.0}],
        "model_free": [{"at": "camera", "probability": 1.0}],
    }
    page = page_of(evidence(where=where), tmp_path)
    assert "The library's explanation acts here." in page.text
    assert "would rather lie at the camera (> 99%)" in page.text
    where["model_free"] = [{"at": "joint:pin", "probability": 0.9}, {"at": "camera", "probability": 0.1}]
    assert "the gap lies here with 90%." in page_of(evidence(where=where), tmp_path).text


def test_causes_come_with_their_probability_amount_and_aliases(tmp_path):
    page = page_of(evidence(), tmp_path)
    assert page.text.index("coulomb friction at pin 60%") < page.text.index("camera rotation 39%")
    assert "400 ± 20 µN m" in page.text
    assert "cannot tell it from effort offset at pin" in page.text
    assert "something unknown 1%" in page.text


def test_errors_stand_in_millimetres_beside_the_noise(tmp_path):
    page = page_of(evidence(), tmp_path)
    for words in ("4.00 mm", "0.500 mm", "noise 0.450 mm", "explains 98.0% of the gap's power (95%: 96.0 to 99.0%)"):
        assert words in page.text
    widths = [
        float(w) for w in re.findall(r'class="share (?:before|after)" x="118" y="[\d.]*" width="([\d.]*)"', page.html)
    ]
    assert widths[1] / widths[0] == pytest.approx(0.5 / 4.0, abs=1e-3)  # bars in proportion, to a tenth of a pixel


def test_no_gap_has_neither_places_nor_a_corrected_motion(tmp_path):
    made = evidence(verdict="none", where={}, causes=[], probability_none=0.99, sentence="No gap.")
    page = page_of(GapEvidence(made.mechanism, made.report, made.pose, channels=made.channels), tmp_path)
    assert "How probably it lies there" not in page.text
    assert "where the gap may lie" not in page.text
    assert "nothing: the drawing is right 99%" in page.text
    assert "with the best cause" not in page.text
    assert "torque missing" not in page.html


def test_warnings_and_names_are_text_not_markup(tmp_path):
    page = page_of(evidence(warnings=["Only <one> run."]), tmp_path)
    assert "&lt;one&gt;" in page.html
    assert "1 warning at the end of this page" in page.text
    assert "<on>" not in page.html


def test_the_screenful_names_causes_places_and_errors():
    text = gap_text(report(next_experiment={"separates": [["a", "b"]], "do": "release it higher"}))
    for words in ("AMBIGUOUS", "60% coulomb friction at pin: friction torque 400 ± 20 µN m", "40% the camera",
                  "rms 4.00 mm as drawn, 0.500 with the best cause, noise 0.450", "release it higher"):  # fmt: skip
        assert words in text


def test_the_screenful_of_no_gap_names_no_corrected_error():
    assert "rms 4.00 mm as drawn, noise 0.450" in gap_text(report(verdict="none"))


# Words


def test_amounts_carry_the_prefix_of_their_size():
    assert amount(Amount(value=-0.0503, sd=0.0026, unit="rad")) == "−50.3 ± 5.1 mrad"
    assert amount(Amount(value=0.0132, sd=0.0027, unit="1")) == "1.32 ± 0.53 %"
    assert amount(Amount(value=2.0, unit="N s/m")) == "2.00 N s/m"
    seen = Detectable(kind="rotor_inertia", on=["j"], parameter="kg_m2", minimum=2.8e-7, unit="kg m^2")
    assert least(seen) == "280 µg m²"


@pytest.mark.parametrize("unit", ["m", "s", "rad", "N", "N m", "N m s/rad", "m/s", "N/m"])
@pytest.mark.parametrize("size", [3e-10, 4.2e-7, 0.9999e-3, 1e-3, 0.5, 17.0, 2.5e4])
def test_a_prefix_never_changes_the_quantity(size, unit):
    written, factor = prefixed(size, unit)
    assert written.endswith(unit)
    power = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3}[written.removesuffix(unit)]
    assert factor * power == pytest.approx(1.0, rel=1e-12)  # powers of ten


def test_kilograms_become_grams_powers_keep_their_form_and_ratios_become_percent():
    assert prefixed(2.8e-7, "kg m^2") == ("µg m²", pytest.approx(1e9))
    assert prefixed(0.2, "kg") == ("g", pytest.approx(1e3))
    assert prefixed(0.02, "m^2") == ("m²", 1.0)
    assert prefixed(1e-3, "1/m^2") == ("1/m²", 1.0)
    assert prefixed(0.03, "1") == ("%", 100.0)


def test_percentages_never_claim_certainty():
    assert [percent(p) for p in (1.0, 0.994, 0.99, 0.5, 0.01, 0.0)] == ["> 99%", "> 99%", "99%", "50%", "1%", "< 1%"]


def test_a_next_experiment_says_what_it_tells_apart_or_that_no_release_would():
    pair = [["coulomb_friction", "viscous_friction"]]
    told = next_sentence(NextExperiment(separates=pair, do="release it higher", expected_d2=400.0))
    assert told == (
        "Release it higher. This is to tell coulomb friction from viscous friction: their predictions would then lie "
        "20 sd apart."
    )
    other = next_sentence(NextExperiment(separates=pair, do="weigh the parts", expected_d2=0.25))
    assert "at best 0.50 sd apart" in other
    assert next_sentence(None) == ""


def test_aliases_are_told_kind_by_kind():
    pairs = [["inertia_error", "rod"], ["effort_offset", "pin"], ["inertia_error", "all"]]
    cause = report().causes[0].model_copy(update={"indistinguishable_from": pairs})
    assert alike(cause) == ["inertia error at rod or all at once", "effort offset at pin"]


def test_names_of_parameters_lose_their_units():
    assert parameter_name("static_torque_n_m") == "static torque"
    assert parameter_name("amplitude_m[2]") == "amplitude z"
    assert parameter_name("rad") == ""


def test_the_worst_explained_experiment_is_shown_with_what_the_drawing_misses_first():
    t = np.linspace(0.0, 1.0, 11)

    def channel(experiment, at, before, after):
        return Channel(experiment, "held_out", at, "z", "m", t, 0 * t, 0 * t + before, 0 * t + after, 1e-3)

    good = [channel("good", "marker:a", 0.5, 1e-3)]
    bad = [channel("bad", "marker:a", 0.1, 2e-3), channel("bad", "marker:b", 0.2, 2e-3)]
    assert [(c.experiment, c.at) for c in worst_first([good, bad])] == [("bad", "marker:b"), ("bad", "marker:a")]
    assert worst_first([]) == ()


@pytest.mark.parametrize(
    ("kind", "on", "words"),
    [
        ("rotor_inertia", ("j1",), "rotor inertia at j1"),
        ("camera_tilt", ("camera",), "camera tilt"),
        ("frame_rate_error", ("camera",), "frame rate error of the camera"),
        ("gravity_tilt", ("world",), "gravity tilt"),
    ],
)
def test_an_effect_is_named_as_one_says_it(kind, on, words):
    assert effect_name(CauseEffect(kind=kind, on=on, parameters={})) == words
