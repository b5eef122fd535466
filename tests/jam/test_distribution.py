"""What scatters, how, and where it ends."""

import numpy as np
import pytest

from backend.jam.distribution import varied
from backend.jam.sensitivity import design, indices
from tests.jam.weak import DRIVE, DRY, weak_bar

SHARES = np.linspace(0.001, 0.999, 9)


def one(spec: str):
    ((found,), _) = varied(weak_bar(), [spec])
    return found


def test_a_distribution_ends_where_its_parameter_does():
    """Friction is not below 0: of normal(0, sd) the upper half remains, whose median is the whole one's 75%."""
    half = one(f"{DRY}=normal(0,0.01)")
    assert half.distribution.within == pytest.approx(0.5)
    assert half.distribution.ppf(np.array(0.5)) == pytest.approx(0.01 * 0.6744897501960817)
    assert (half.distribution.ppf(SHARES) > 0).all()


@pytest.mark.parametrize(
    ("written", "quartiles"),
    [
        ("normal(0.01,0.001)", [0.01 - 0.67448975e-3, 0.01, 0.01 + 0.67448975e-3]),
        ("uniform(-0.02, 0.02)", [-0.01, 0.0, 0.01]),
        ("lognormal(1e-2,2)", [0.01 / 2**0.67448975, 0.01, 0.01 * 2**0.67448975]),
    ],
)
def test_a_drive_without_bounds_scatters_as_it_is_written(written, quartiles):
    found = one(f"{DRIVE}={written}").distribution
    assert found.within == 1.0
    assert found.ppf(np.array([0.25, 0.5, 0.75])) == pytest.approx(quartiles, rel=1e-7, abs=1e-12)


def test_an_effect_that_the_drawing_lacks_is_added():
    (found,), added = varied(weak_bar(), ["viscous_friction:pin=uniform(0,0.1)"])
    assert [effect.id for effect in added] == [address[0] for address in found.parameter.addresses]


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        (DRY, "no distribution is given. Write KIND:ON.PARAMETER=normal"),
        (f"{DRY}=gauss(0.1,0.2)", "'gauss.0.1,0.2.' is no distribution"),
        (f"{DRY}=normal(0.1)", "no distribution that is known"),
        (f"{DRY}=normal(a,b)", "does not hold two numbers"),
        (f"{DRY}=normal(0.1,nan)", "is not finite"),
        (f"{DRY}=normal(0.1,0)", "standard deviation of 0 does not scatter"),
        (f"{DRY}=uniform(0.2,0.1)", "nothing lies between 0.2 and 0.1"),
        (f"{DRY}=lognormal(0.2,0.9)", "a factor above 1"),
        (f"{DRY}=uniform(-2,-1)", "is from 0 to inf N m, where 0% of that distribution is"),
        ("stribeck_friction:pin=normal(1e-2,1e-3)", "Name one of them"),
        ("camera_scale:camera=normal(0,0.1)", "moves no part"),
        (
            "coulomb_friction:knee=normal(0.1,0.1)",
            "--vary coulomb_friction:knee: coulomb_friction does not act at 'knee'",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused_with_the_remedy(spec, words):
    with pytest.raises(ValueError, match=words):
        one(spec)


def test_one_number_varies_once():
    with pytest.raises(ValueError, match="varied twice"):
        varied(weak_bar(), [f"{DRY}=uniform(0,1)", f"{DRY}=normal(1,1)"])
    with pytest.raises(ValueError, match="nothing is varied"):
        varied(weak_bar(), [])


@pytest.fixture(scope="module")
def two():
    return [one(f"{name}=uniform(0.005,0.015)").distribution for name in (DRIVE, DRY)]


def test_every_sample_is_used_and_half_of_each_matrix_row_is_shared(two):
    table = design(two, 1000, seed=3)
    assert (len(table.values), table.rows) == (1000, 128)  # 128 (2 + 2) <= 1000
    a, b, first, second = table.values[:512].reshape(4, 128, 2)
    assert (first == np.stack([b[:, 0], a[:, 1]], 1)).all()
    assert (second == np.stack([a[:, 0], b[:, 1]], 1)).all()
    assert table.independent.sum() == 1000 - 2 * 128
    assert design(two, 50, seed=3).rows == 0  # 12 rows would be a guess


def test_shares_of_a_comparison_are_a_third_alone_and_two_thirds_in_all(two):
    """Y = [X1 < X2], both uniform on the same span: Var E[Y|X2] = 1/12 of Var Y = 1/4, for either by symmetry."""
    table = design(two, 16384, seed=0)
    jammed = table.values[:, 0] < table.values[:, 1]
    found = indices(table, jammed, np.zeros(16384, dtype=bool))
    assert found is not None
    for value, ci95, truth in ((found.first, found.first_ci95, 1 / 3), (found.total, found.total_ci95, 2 / 3)):
        assert ((ci95[:, 0] < truth) & (truth < ci95[:, 1])).all()
        assert value == pytest.approx(truth, abs=0.05)  # 4096 rows: an sd of 0.02


def test_rows_that_lost_a_sample_leave_the_shares_of_the_others(two):
    table = design(two, 16384, seed=0)
    jammed = table.values[:, 0] < table.values[:, 1]
    lost = np.zeros(16384, dtype=bool)
    lost[::40] = True
    wrong = np.where(lost, True, jammed)  # whatever stands where a sample was lost
    found = indices(table, wrong, lost)
    n = table.rows
    a, b, first, second = jammed[: 4 * n].reshape(4, n).astype(float)
    good = ~lost[: 4 * n].reshape(4, n).any(axis=0)
    assert found is not None
    assert found.rows == good.sum()
    spread = np.var([a[good], b[good]])
    by_hand = [0.5 * np.mean((a[good] - mixed[good]) ** 2) / spread for mixed in (first, second)]
    assert found.total == pytest.approx(by_hand, rel=1e-12)  # rounding


def test_ensembles_that_all_come_out_alike_have_no_shares(two):
    table = design(two, 1000, seed=0)
    assert indices(table, np.ones(1000, dtype=bool), np.zeros(1000, dtype=bool)) is None
