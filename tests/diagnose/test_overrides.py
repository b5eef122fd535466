"""Experiments that set a drawn number otherwise: one layout for all, each with its own number."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.diagnose.test_diagnosis import COARSE_S, drawing, study

__all__ = ["drawing"]  # a fixture

COIL = "coil", "stiffness_n_m_per_rad"
SOFT, STIFF, OTHER = 0.3, 0.9, 0.5  # N m/rad: as drawn, of one experiment, as it may be instead of drawn


@pytest.fixture(scope="module")
def subject(drawing):
    from backend.diagnose.library import SMOOTH, library
    from backend.diagnose.subject import prepare
    from backend.effects.catalogue import catalogue
    from backend.mechanism.effect import Effect

    spring = Effect(id=COIL[0], kind="torsion_spring", on=("j1",), parameters={COIL[1]: SOFT, "rest_rad": 0.1})
    sprung = drawing.model_copy(update={"effects": (spring,)})
    told = study(sprung, 1, frames=24)
    first, second, held = told.experiments
    second = replace(second, overrides={COIL[0]: {COIL[1]: STIFF}})
    told = replace(told, experiments=(first, second, held))
    others = frozenset(catalogue()) - {"torsion_spring", "viscous_friction"}
    return prepare(told, library(sprung, SMOOTH, told.tolerances, others), COARSE_S)


def stiffness(probe, x):
    """Of the drawn spring in the model that an experiment is simulated with."""
    from backend.fit.prediction import with_values

    model = with_values(probe.setting.model, probe.addresses, x[: len(probe.addresses)], probe.setting.overrides)
    (springs,) = (placed for placed in model.effects if COIL[0] in placed.ids)
    return getattr(springs.effect, COIL[1])[springs.ids.index(COIL[0])]


def test_all_share_one_compiled_program(subject):
    import jax

    probes = [*subject.fit, *subject.held_out]
    assert {p.addresses for p in probes} == {probes[0].addresses}
    assert COIL in {address for group in probes[0].addresses for address in group}
    assert len({jax.tree.structure(p.setting) for p in probes}) == 1
    assert len({str([jax.typeof(leaf) for leaf in jax.tree.leaves(p.setting)]) for p in probes}) == 1


def test_what_an_experiment_sets_holds_whatever_is_free(subject):
    import jax
    import jax.numpy as jnp

    plain, stiff = subject.fit
    (place,) = (i for i, group in enumerate(plain.addresses) if COIL in group)
    drawn = jnp.asarray(subject.neutral)
    other = drawn.at[place].set(OTHER)
    assert [float(stiffness(plain, x)) for x in (drawn, other)] == [SOFT, OTHER]
    assert [float(stiffness(stiff, x)) for x in (drawn, other)] == [STIFF, STIFF]
    assert jax.grad(lambda x: stiffness(plain, x))(drawn)[place] == 1.0
    assert not np.any(jax.grad(lambda x: stiffness(stiff, x))(drawn))


def test_the_same_holds_in_other_steps(subject):
    stiff = subject.fit[1]
    longer = stiff.in_steps(2 * COARSE_S)
    assert float(stiffness(longer, np.asarray(subject.neutral))) == STIFF


def test_nothing_is_laid_out_where_no_experiment_sets_what_is_free():
    from backend.diagnose.overrides import laid_out, set_somewhere

    model: Any = None  # is not looked at
    known = set_somewhere({("load", "force_n")}, ((COIL,),))
    assert known == []
    assert laid_out(model, (), known) is None


def test_components_are_set_as_the_whole_is():
    import jax.numpy as jnp

    from backend.diagnose.overrides import laid_out, set_somewhere

    offset = "wrong", "offset_m"
    first, second = (("wrong", f"offset_m[{i}]") for i in range(2))
    known = set_somewhere({offset, COIL}, ((COIL,), (first,), (second, COIL)))
    assert [i for i, _ in known] == [0, 1, 2, 2]
    values = {COIL: 0.7, first: 1.0, second: 2.0}
    model: Any = SimpleNamespace(parameters={a: SimpleNamespace(value=v) for a, v in values.items()})
    free = jnp.array([5.0, 6.0, 7.0])
    for given, counts in (
        ({offset}, [5.0, 1.0, 2.0, 7.0]),
        ({COIL}, [0.7, 6.0, 7.0, 0.7]),
        (set(), [5.0, 6.0, 7.0, 7.0]),
    ):
        made = laid_out(model, given, known)
        assert made is not None
        np.testing.assert_array_equal(made.among(free), counts)
