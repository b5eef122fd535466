"""Elements of SVG and HTML: attributes and text are escaped here, once."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from markupsafe import Markup, escape


def element(name: str, *children: str, **attributes: str | float | None) -> Markup:
    """One element. Markup children stand as they are, other text is escaped; None leaves an attribute out.

    `class_` is written `class`, other underscores become hyphens, numbers keep one decimal.

    >>> element("text", "a < b", x=1.25, class_="label", text_anchor="end")
    Markup('<text x="1.2" class="label" text-anchor="end">a &lt; b</text>')
    """
    given = {key.rstrip("_").replace("_", "-"): value for key, value in attributes.items() if value is not None}
    written = "".join(f' {key}="{_attribute(value)}"' for key, value in given.items())
    return Markup(f"<{name}{written}>{joined(*children)}</{name}>")


def joined(*children: str) -> Markup:
    """Children one after the other."""
    return Markup("").join(children)


def path(px: Float[np.ndarray, "n"], py: Float[np.ndarray, "n"]) -> str:
    """Path data through points [px], lifted where a coordinate is not finite."""
    pen, steps = "M", []
    for x, y in zip(px, py, strict=True):
        if not (math.isfinite(x) and math.isfinite(y)):
            pen = "M"
            continue
        steps.append(f"{pen}{x:.1f} {y:.1f}")
        pen = "L"
    return "".join(steps)


def _attribute(value: str | float) -> Markup:
    return escape(value if isinstance(value, str) else f"{value:.1f}".removesuffix(".0"))
