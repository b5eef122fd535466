"""How many times one number is another, as one says it."""

from __future__ import annotations


def times(ratio: float, digits: int = 3) -> str:
    """So many digits that count, and no power of ten below a thousand million.

    >>> times(0.0123), times(12.34), times(1443.2), times(14_432.0), times(2.5e6), times(3e12)
    ('0.0123', '12.3', '1440', '14 400', '2.5 million', '3e+12')
    """
    short = float(f"{ratio:.{digits}g}")
    if 1e6 <= short < 1e9:
        return f"{short / 1e6:g} million"
    if 1e3 <= short < 1e6:
        return f"{short:.0f}" if short < 1e4 else f"{short:,.0f}".replace(",", " ")
    return f"{short:g}"
