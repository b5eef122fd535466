"""XML that engineers read: numbers in full, one element a line, a preface that says what is missing."""

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Comment, Element, indent, tostring

import numpy as np

ZERO = 1e-15  # of the largest component: rounding, written as zero


@dataclass(frozen=True)
class Written:
    """A document, and a sentence for each thing of the twin that it does not hold."""

    text: str
    left_out: tuple[str, ...]


def numbers(values: float | Sequence[float] | np.ndarray) -> str:
    """Numbers with every digit, rounding beside them cleared away."""
    given = np.atleast_1d(np.asarray(values, float))
    given = np.where(np.abs(given) > ZERO * np.abs(given).max(initial=0.0), given, 0.0)
    return " ".join(repr(float(x) + 0.0).removesuffix(".0") for x in given)


def quaternion(R: np.ndarray) -> np.ndarray:
    """Unit quaternion wxyz of a rotation matrix, from its largest component (Shepperd 1978)."""
    K = np.array(
        [
            [np.trace(R), R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [0.0, R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [0.0, 0.0, R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1]],
            [0.0, 0.0, 0.0, R[2, 2] - R[0, 0] - R[1, 1]],
        ]
    )
    row = (np.triu(K) + np.triu(K, 1).T)[int(np.argmax(np.diag(K)))].copy()
    row[int(np.argmax(np.diag(K)))] += 1.0
    return row / np.linalg.norm(row) * (1.0 if row[0] >= 0.0 else -1.0)


def document(root: Element, title: str, left_out: Sequence[str]) -> str:
    """The document as text; what it does not hold stands first, for those who see the file alone."""
    lines = [title, *(["Not in this file:", *(f"- {sentence}" for sentence in left_out)] if left_out else [])]
    # Two hyphens would end an XML comment; ids may hold them.
    root.insert(0, Comment("\n    " + "\n    ".join(lines).replace("--", "- -") + "\n  "))
    indent(root, "  ")
    return '<?xml version="1.0" encoding="utf-8"?>\n' + tostring(root, encoding="unicode") + "\n"
