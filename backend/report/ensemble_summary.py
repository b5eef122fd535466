"""An ensemble in a screenful."""

from __future__ import annotations

from backend.mechanism.ensemble_report import EnsembleReport, Throughput
from backend.report.ensemble_page import ranked
from backend.report.quantity import shown


def ensemble_text(report: EnsembleReport) -> str:
    """Probability, shares, what was lost, and how fast it went."""
    lines = [report.sentence]
    lines.append(f"samples     {report.samples}, {report.independent} of them count, {report.lost} lost")
    for k in ranked(report):
        one = report.parameters[k]
        if one.total and one.first_order:
            low, high = (shown(edge, 2) for edge in one.total.ci95)
            alone = shown(one.first_order.value, 2)
            lines.append(f"share       {shown(one.total.value, 2)} ({low} to {high}), alone {alone}: {one.name}")
    if report.index_rows:
        matrices = len(report.parameters) + 2
        lines.append(
            f"            from {report.index_rows} rows of {matrices} matrices: n (d + 2) <= samples, n a power of two"
        )
    lines.append(f"speed       {_speed(report.throughput)}")
    return "\n".join([*lines, *(f"caution     {said}" for said in report.warnings)])


def _speed(speed: Throughput) -> str:
    if not speed.chunks:
        return "every chunk was done before"
    rate = (
        f"{shown(speed.samples_per_s)} samples/s" if speed.samples_per_s else "one chunk: no rate apart from compiling"
    )
    return (
        f"{rate} by {speed.processes}; first chunk of {speed.chunk} after {shown(speed.first_chunk_s)} s (compiling), "
        f"all after {shown(speed.wall_s)} s"
    )
