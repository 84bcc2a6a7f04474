"""Linear corners of the vehicles against their struts' own forces and their weight."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.vehicle.corner_suspension import (
    CornerSuspension,
    corner_suspensions,
    static_load,
    validate,
)
from wheelhop.vehicle.full_vehicle_parameters import VEHICLES
from wheelhop.vehicle.strut import anti_roll_force, damper_force, spring_force

GRAVITY = 9.80665


@pytest.fixture(params=VEHICLES)
def vehicle(request):
    return VEHICLES[request.param]()


def strut_force(vehicle, force, at):
    return np.asarray(force(jnp.full(4, at), vehicle.strut))


def test_slopes_are_those_of_the_struts_at_the_design_place(vehicle):
    corners = corner_suspensions(vehicle)
    for force, slope, step in (
        (spring_force, corners.stiffness, 1e-5),
        (damper_force, corners.damping, 1e-5),
    ):
        up, down = (strut_force(vehicle, force, x) for x in (step, -step))
        np.testing.assert_allclose(slope, (up - down) / (2 * step), rtol=1e-3)
        assert np.all(np.asarray(slope) > 0)
    np.testing.assert_allclose(corners.preload, strut_force(vehicle, spring_force, 0.0), rtol=1e-12)
    np.testing.assert_array_equal(strut_force(vehicle, damper_force, 0.0), 0.0)


def test_a_linear_corner_is_its_strut_at_small_deflections():
    vehicle = VEHICLES["commonroad-2"]()
    corners = corner_suspensions(vehicle)
    q, w = 0.01, 0.3
    expected = strut_force(vehicle, spring_force, q) + strut_force(vehicle, damper_force, w)
    found = corners.preload + corners.stiffness * q + corners.damping * w
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_static_loads_are_the_weight_where_it_acts(vehicle):
    """In sum, in moment about an axle, and alike on both sides."""
    corners, chassis = corner_suspensions(vehicle), vehicle.chassis
    load = np.asarray(static_load(corners))
    wheels = np.asarray(chassis.wheel_mass)
    body = float(chassis.body_mass)
    assert load.sum() == pytest.approx((body + wheels.sum()) * GRAVITY, rel=1e-9)
    front, rear = float(chassis.front_arm), float(chassis.rear_arm)
    share = body * rear / (front + rear)
    assert load[:2].sum() == pytest.approx((share + wheels[:2].sum()) * GRAVITY, rel=1e-9)
    np.testing.assert_allclose(load[::2], load[1::2], rtol=1e-9)
    np.testing.assert_array_equal(corners.unsprung_mass, wheels)
    assert np.asarray(corners.sprung_mass).sum() == pytest.approx(body, rel=1e-9)


def test_preload_carries_the_body_at_the_design_place(vehicle):
    """So that a deflection of zero means rest on level ground."""
    corners = corner_suspensions(vehicle)
    np.testing.assert_allclose(
        corners.preload, np.asarray(corners.sprung_mass) * GRAVITY, rtol=1e-6
    )
    assert float(static_load(corners, 2 * GRAVITY)[0]) == pytest.approx(
        2 * float(static_load(corners)[0])
    )


def test_bars_are_those_of_the_axles(vehicle):
    """Force of the corner's bar times the difference to the other side."""
    corners = corner_suspensions(vehicle)
    q = np.array([0.01, -0.02, 0.005, 0.03])
    expected = anti_roll_force(jnp.asarray(q), vehicle.anti_roll)
    found = np.asarray(corners.anti_roll) * (q - q[[1, 0, 3, 2]])
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert corners.anti_roll.shape == (4,)


def test_stiffness_follows_the_vehicle_under_a_gradient():
    """Pure in the vehicle: the spring's stiffness enters with slope one."""
    vehicle = VEHICLES["suv"]()

    def total(k):
        strut = replace(vehicle.strut, stiffness=k)
        return jnp.sum(corner_suspensions(replace(vehicle, strut=strut)).stiffness)

    start = jnp.full(4, 3e4)
    np.testing.assert_allclose(jax.grad(total)(start), np.ones(4), rtol=1e-9)


def test_validation(vehicle):
    corners = corner_suspensions(vehicle)
    assert validate(corners) is corners


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("sprung_mass", 0.0),
        ("unsprung_mass", -1.0),
        ("stiffness", 10.0),
        ("damping", -1.0),
        ("preload", float("nan")),
        ("anti_roll", -5.0),
    ],
)
def test_refusals_name_the_field(field, value):
    corner = CornerSuspension(460.0, 61.0, 33.6e3, 2800.0, 4511.0)
    validate(corner)
    with pytest.raises(InputError) as refusal:
        validate(replace(corner, **{field: value}))
    assert refusal.value.field == f"corner.{field}"
