"""The verdict in one sentence."""

from backend.mechanism.jam_report import Cause, Margin

MOST_NAMES = 4

REASONS: dict[Cause, str] = {
    "friction_lock": "friction locks it, and no drive up to 100 times frees it",
    "singularity": "the drive has no lever at this pose; a small push off it would set it free",
    "clearance_lock": "it would be free without play",
    "insufficient_drive": "friction holds it, and the drive is too weak",
}


def sentence(
    jammed: bool, cause: Cause, onset_s: float | None, at: tuple[str, ...], margin: Margin, result: str = "done"
) -> str:
    """Whether, when, where, why and by what margin."""
    if result != "done" and cause != "singularity":
        return f"Not told: {result}"
    where = _listed(at)
    when = "from the start" if onset_s == 0.0 else f"since {onset_s:.4g} s" if onset_s is not None else ""
    if cause == "stop":
        against = f"rests {when} against {where}"
        return (
            f"Jammed: it {against}, where no end was declared."
            if jammed
            else f"Not jammed: it {against}, its declared end."
        )
    if not jammed:
        if onset_s is None:
            return "Not jammed: it moves to the end of the run."
        return f"Not jammed: it rests {when}, and a copy without friction and play would rest there too."
    said = f"Jammed {when}{f' at {where}' if where else ''}: {REASONS[cause]}"
    freed = []
    if margin.drive_factor is not None:
        freed.append(f"{margin.drive_factor:.3g} times the drive")
    if margin.friction_factor is not None:
        freed.append(f"friction below {margin.friction_factor:.3g} of what it is")
    return f"{said}; {' or '.join(freed)} frees it." if freed else f"{said}."


def _listed(at: tuple[str, ...]) -> str:
    names = [place.replace(":", " ") for place in at[:MOST_NAMES]]
    rest = len(at) - len(names)
    return ", ".join(names) + (f" and {rest} more" if rest else "")
