"""What to measure next so that the explanations that are left come apart."""

from __future__ import annotations

import numpy as np

from backend.diagnose.belief import APART, Belief
from backend.diagnose.candidate import Candidate
from backend.diagnose.cause import Cause
from backend.diagnose.probe import Probe
from backend.diagnose.subject import Subject
from backend.fit.remedy import pose_words
from backend.mechanism.gap_report import NextExperiment

WATCH = {
    "joint": "watch that joint alone: hold the others, move it by hand or by a weight, and record its place beside the "
    "force",
    "body": "film that part alone, hung from one point, then with a known mass added to it",
    "marker": "stick a second marker to the same part and the first one on anew, and repeat",
    "camera": "film a scale bar that is moved across the picture and a clock beside it, as long as before",
    "world": "clamp the base to something heavy and repeat, or film a marker on the base and one on the floor with the "
    "mechanism",
}
"""What shows more of something unknown, by the kind of place where it lies."""
REACHES = (-0.6, -0.3, 0.3, 0.6)  # rad, or mechanism lengths, from a release that was made
MOST = 3  # explanations to tell apart


def next_experiment(subject: Subject, belief: Belief, scale: float, unknown_at: str = "") -> NextExperiment | None:
    """The release, among some that can be made, that sets the leading explanations furthest apart.

    Where none does, another measurement is named instead. unknown_at: the likeliest place of what no effect of the
    library explains: then what would show more of that.
    """
    if (watched := WATCH.get(unknown_at.partition(":")[0])) is not None:
        return NextExperiment(separates=[], do=watched)
    rivals = [belief.causes[i] for i in belief.reported[:MOST]] or list(belief.causes[:2])
    if len(rivals) < 2:
        rivals = list(belief.causes[:2])
    if len(rivals) < 2:
        return None
    a, b = rivals[0], rivals[1]
    pair = [_label(a), _label(b)]
    found = [(d2, words) for release in _releases(subject) for d2, words in [_apart(subject, a, b, *release, scale)]]
    d2, words = max(found, key=lambda f: f[0], default=(0.0, ""))
    if d2 < APART:
        return NextExperiment(separates=[pair], do=_measure(a, b), expected_d2=float(d2))
    return NextExperiment(separates=[pair], do=words, expected_d2=float(d2))


def _label(cause: Cause) -> str:
    return " + ".join(sorted({c.kind for c in cause.candidates}))


def _releases(subject: Subject):
    if subject.told.issuperset(subject.joints):  # a drive says how it begins, or no joint's coordinate can
        return
    probe = subject.fit[0]
    for direction in range(probe.mobility):
        for reach in REACHES:
            yield probe, direction, reach


def _apart(subject: Subject, a: Cause, b: Cause, probe: Probe, direction: int, reach: float, scale: float):
    """(d², what to do) of one release: squared distance of the two predictions in noise sds, starts projected out."""
    own = probe.start.copy()
    own[direction] += reach
    seen, slopes = [], np.zeros(0)
    white = subject.noise.whitening(probe.data, 0, 1.0, scale)
    for cause in (a, b):
        value, slope = cause.fitted.whole[0].predict(cause.fitted.values, own)
        seen.append(value)
        slopes = slope[:, cause.fitted.count :]
    if not all(np.all(np.isfinite(s)) for s in seen):
        return 0.0, ""
    apart = white(seen[0] - seen[1])
    Q, _ = np.linalg.qr(white(slopes))
    left = apart - Q @ (Q.T @ apart)
    return float(left @ left), f"release {_pose_words(subject, probe, own)}"


def _pose_words(subject: Subject, probe: Probe, own: np.ndarray) -> str:
    rest = "from rest" if not probe.moving else "with the speed of the first experiment"
    pose = pose_words(probe.setting, own[: probe.mobility], subject.joints)
    return f"with {pose} {rest}, as long a record as before"


def _measure(a: Cause, b: Cause) -> str:
    """Another measurement, for explanations that no release of this mechanism sets apart."""
    places = {at for cause in (a, b) for c in cause.candidates for at in c.places}
    units = {p.unit for cause in (a, b) for c in cause.candidates for p in c.parameters}
    asks = []
    if "camera" in places and "s" not in units:
        asks.append("film a plumb line and a scale bar in the plane of motion")
    if any(_clock(c) for cause in (a, b) for c in cause.candidates):
        asks.append("film a clock or a blinking light of known rate")
    if any(at.startswith("body:") for at in places):
        asks.append("weigh and measure the parts, or repeat with a known mass added")
    if any(at.startswith("marker:") for at in places):
        asks.append("film a calibration pose and measure where the markers sit")
    if "world" in places:
        asks.append("check the base with a level")
    return "; ".join(asks or ["repeat with a known mass added, so that loads change while speeds stay"])


def _clock(candidate: Candidate) -> bool:
    return any(p.unit == "s" for p in candidate.parameters) or "rate" in candidate.kind
