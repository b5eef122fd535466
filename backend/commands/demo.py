"""Draw, film, track and fit a four-bar."""

from __future__ import annotations

from pathlib import Path

from backend.commands.terminal import AsJson, Out, answering, progress


def demo(out: Out = None, as_json: AsJson = False) -> None:
    """Draw, film, track and fit a four-bar, then predict a load it never saw: one page tells it all."""
    with answering(as_json) as answer:
        from backend.report.fit_summary import fit_text

        script = Path(__file__).resolve().parents[2] / "samples" / "fourbar" / "design.py"
        with progress("loading") as advance:
            from backend.demo.story import run_demo

            page, result = run_demo(script, out or Path("out") / "demo", advance)
        answer(
            {"page": str(page), "fit": result.report.model_dump(mode="json")},
            f"{fit_text(result.report)}\nopen      {page}",
        )
