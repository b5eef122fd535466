"""How many times one number is another, in a sentence."""

import pytest

from backend.mechanism.ratios import times


@pytest.mark.parametrize(
    ("ratio", "said"),
    [(12.34, "12.3"), (999.6, "1000"), (1443.2, "1440"), (14432.0, "14 400"), (2.5e6, "2.5 million")],
)
def test_a_ratio_is_written_without_a_power_of_ten(ratio, said):
    assert times(ratio) == said


def test_a_ratio_beyond_all_words_keeps_its_power():
    assert times(3e12) == "3e+12"
    assert times(3.14159, 2) == "3.1"
