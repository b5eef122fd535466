"""What a fit prints."""

from backend.mechanism.fit_report import FitReport, Residual
from backend.report.fit_summary import fit_text


def missed(at, rms, unit="rad"):
    return Residual(experiment="e1", at=at, rms=rms, before=10 * rms, unit=unit, count=100)


def lines(*residuals):
    return fit_text(FitReport(parameters=(), residuals=residuals, converged=True, wall_s=1.0)).splitlines()


def test_joints_that_share_a_unit_are_told_one_by_one():
    told = lines(missed("joint:hip", 0.003), missed("joint:knee", 0.004), missed("marker:tip", 0.001, "m"))
    assert "fitted    rms 0.00354 rad, 0.0354 as drawn" in told
    assert "  joint:hip   0.00300 rad, 0.0300 as drawn" in told
    assert "  joint:knee  0.00400 rad, 0.0400 as drawn" in told
    assert not any(line.startswith("  marker") for line in told)


def test_a_joint_alone_is_told_once():
    assert not any(line.startswith("  joint") for line in lines(missed("joint:hip", 0.003)))
