"""The natural size of a parameter follows from its unit."""

import jax.numpy as jnp
import pytest

from backend.effects.catalogue import catalogue
from backend.model.scale import Scale

MASS, LENGTH, G = 0.2, 0.5, 9.0
SCALE = Scale(jnp.asarray(MASS), jnp.asarray(LENGTH), jnp.asarray(G))
UNITS = sorted({d.unit for effect in catalogue().values() for d in effect.declarations().values()})
WEIGHT, TIME = MASS * G, (LENGTH / G) ** 0.5


@pytest.mark.parametrize("unit", UNITS)
def test_every_declared_unit_has_a_size(unit):
    assert SCALE.of(unit) > 0


@pytest.mark.parametrize(
    ("unit", "size"),
    [
        ("1", 1.0),
        ("rad", 1.0),
        ("m", LENGTH),
        ("s", TIME),
        ("N", WEIGHT),
        ("N m", WEIGHT * LENGTH),
        ("N/m", WEIGHT / LENGTH),
        ("N s/m", WEIGHT * TIME / LENGTH),
        ("N m s/rad", WEIGHT * LENGTH * TIME),
        ("m^2", LENGTH**2),
        ("m/s^2", G),
        ("kg m^2", MASS * LENGTH**2),
        ("rad or m", 1.0),
    ],
)
def test_sizes_are_products_of_mass_length_and_gravity(unit, size):
    assert SCALE.of(unit) == pytest.approx(size, rel=1e-12)
