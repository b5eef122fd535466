"""What a fit says of the time it still takes."""

import pytest

from backend.fit.pace import Pace


@pytest.fixture
def paced():
    """A pace with a clock that is set by hand, and what it told."""
    now, told = [0.0], []
    return Pace(lambda share, words: told.append((share, words)), 20.0, lambda: now[0]), now, told


def search(pace, now):
    """A piece of ten, of which five steps of a second are done."""
    pace.enter(10.0)
    for _ in range(5):
        now[0] += 1.0
        pace.step("searching")


def test_work_that_costs_what_it_usually_does_is_foretold(paced):
    pace, now, told = paced
    for _ in range(2):
        search(pace, now)
    # A step took a second; five steps of a piece of ten tell 5/9 of it, which leaves 4.4 of 20.
    assert pace.left_s() == pytest.approx(40 / 9)
    assert told[-1] == (pytest.approx(15.56 / 20, abs=1e-3), "searching, about 5 s left")


def test_compiling_before_the_first_step_is_not_taken_for_slow_work(paced):
    pace, now, _ = paced
    pace.enter(10.0, "starting")
    now[0] = 100.0
    pace.step("searching")
    assert pace.left_s() is None
    now[0] = 103.0
    pace.step("searching")
    assert pace.left_s() == pytest.approx(3.0 * (20.0 - 10.0 / 3.0))  # two steps tell a third of a piece of ten


def test_the_share_never_falls_though_more_work_comes_than_planned(paced):
    pace, _, told = paced
    for _ in range(6):
        pace.enter(10.0)
        for _ in range(4):
            pace.step("searching")
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert shares[-1] <= 1.0


def test_work_that_turns_out_to_lie_ahead_makes_the_rest_longer(paced):
    pace, now, _ = paced
    search(pace, now)
    before = pace.left_s()
    pace.expect(12.0)
    assert pace.left_s() == pytest.approx(before + 12.0)


def test_a_piece_that_tells_its_parts_counts_as_far_as_it_came(paced):
    pace, now, told = paced
    search(pace, now)
    pace.enter(6.0, "slopes")
    now[0] += 12.0
    pace.tell(0.5, "slopes")
    # Four steps and half of a piece of six in 16 s; three of that piece and four that are planned behind it remain.
    assert pace.left_s() == pytest.approx(16.0 / 7.0 * 7.0)
    assert told[-1] == (pytest.approx(13.0 / 20.0), "slopes, about 15 s left")
