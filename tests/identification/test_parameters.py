"""The search space: names, bounds, free numbers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.identification.parameters import (
    PARAMETERS,
    SUSPENSION,
    search_space,
    value_of,
    with_values,
)
from wheelhop.vehicle.parameters import brancati_suv, validate

CAR = with_values(brancati_suv(), {"tire.damping": 80.0})


def test_free_numbers_and_back_give_the_same_car():
    space = search_space(tuple(PARAMETERS))
    back = space.car(jnp.asarray(space.free(CAR)), CAR)
    for name in PARAMETERS:
        assert float(value_of(back, name)) == pytest.approx(float(value_of(CAR, name)), rel=1e-12)


def test_only_the_fitted_parameters_move():
    space = search_space()
    moved = space.car(jnp.asarray(space.free(CAR)) + 1.0, CAR)
    for name in PARAMETERS:
        same = float(value_of(moved, name)) == float(value_of(CAR, name))
        assert same == (name not in SUSPENSION)


@pytest.mark.parametrize("far", [-1e3, -40.0, 40.0, 1e3])
def test_no_free_number_leaves_the_bounds_or_the_finite_numbers(far):
    space = search_space(tuple(PARAMETERS))
    free = jnp.full((len(PARAMETERS),), far)
    for value, low, high in zip(space.values(free), space.lower, space.upper, strict=True):
        assert low <= float(value) <= high
    assert np.all(np.isfinite(jax.jacobian(space.values)(free)))


def test_what_can_be_fitted_is_what_a_vehicle_file_accepts():
    for side in ("lower", "upper"):
        for name, bounds in PARAMETERS.items():
            car = with_values(CAR, {name: getattr(bounds, side)})
            assert validate(car) == car


def test_a_start_on_a_bound_begins_just_inside():
    space = search_space(("tire.damping",))
    car = space.car(jnp.asarray(space.free(with_values(CAR, {"tire.damping": 0.0}))), CAR)
    assert 0 < float(car.tire.damping) < 0.01 * PARAMETERS["tire.damping"].upper


@pytest.mark.parametrize(
    ("names", "bounds", "said"),
    [
        (("suspension.mass",), None, "'suspension.mass' is unknown"),
        (("sprung_mass", "sprung_mass"), None, "once"),
        ((), None, "once"),
        (("sprung_mass",), {"sprung_mass": (500.0, 400.0)}, "lower < upper"),
        (("sprung_mass",), {"sprung_mass": (5.0, 400.0)}, "within 20 to 20000 kg"),
        (("sprung_mass",), {"sprung_mass": (float("nan"), 400.0)}, "lower < upper"),
        (("sprung_mass",), {"tire.damping": (1.0, 2.0)}, "not fitted"),
    ],
)
def test_refusals_name_the_parameter(names, bounds, said):
    with pytest.raises(InputError, match=said):
        search_space(names, bounds)


def test_a_start_outside_the_bounds_is_refused():
    space = search_space(("sprung_mass",), {"sprung_mass": (500.0, 600.0)})
    with pytest.raises(InputError, match="sprung_mass: the start, 466"):
        space.free(brancati_suv())
