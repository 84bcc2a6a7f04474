"""Four corners with one roughness against four corners on their own."""

from dataclasses import replace
from functools import lru_cache

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import wheelhop.filtering as wf
from wheelhop.errors import InputError
from wheelhop.estimators.changing import changing_modes
from wheelhop.estimators.four_corners import (
    VEHICLE_TUNING,
    VehicleTheta,
    bind_speed,
    changing_four_corner_params,
    changing_four_corner_prior,
    four_corner_filter,
    four_corner_params,
    four_corner_prior,
)
from wheelhop.estimators.stiffness import (
    read_theta,
    stiffness_filter,
    stiffness_params,
    stiffness_prior,
)
from wheelhop.filtering import drive
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import Tire

DT, SPEED, LEVEL, STEPS = 0.002, 16.0, 1e-5, 1000
FIGURES = np.array(
    [  # m_s, m_u, k_s, c_s
        [466.7, 61.14, 33.6e3, 2400.0],
        [480.0, 61.14, 33.6e3, 2300.0],
        [420.0, 52.75, 30.0e3, 2100.0],
        [430.0, 52.75, 30.0e3, 2200.0],
    ]
)
LAWS = (Tire(264.7e3, 250e3, 0.7), Tire(264.7e3, 250e3, 0.7), Tire(240e3, 240e3, 0.8)) * 2
CARS = [
    QuarterCar(m_s, m_u, Suspension(k_s, 0.0, c_s, 0.0), law)
    for (m_s, m_u, k_s, c_s), law in zip(FIGURES, LAWS, strict=False)
]
TUNING = replace(VEHICLE_TUNING, prior_level=LEVEL)


def stiffness(law, pressure):
    return law.stiffness * (1.0 + law.pressure_coefficient * (pressure / law.nominal_pressure - 1))


def simulate(seed, pressures):
    """Accelerations of the linear corners, exactly, on roads of their own, [time, wheel, 2]."""
    rng, ys = np.random.default_rng(seed), np.empty((STEPS, 4, 2))
    for k, (m_s, m_u, k_s, c_s) in enumerate(FIGURES):
        force = np.array([k_s, 0.0, c_s, -c_s])
        tyre = np.array([0.0, stiffness(CARS[k].tire, pressures[k]), 0.0, 0.0])
        a = np.array([[0, 0, 1, -1], [0, 0, 0, 1], -force / m_s, (force - tyre) / m_u])
        noise = np.zeros((4, 4))
        noise[1, 1] = np.pi * LEVEL * SPEED
        top = scipy.linalg.expm(DT * np.block([[-a, noise], [np.zeros((4, 4)), a.T]]))
        f = top[4:, 4:].T
        root = np.linalg.cholesky(f @ top[:4, 4:] + 1e-30 * np.eye(4))
        x = np.zeros(4)
        for t in range(STEPS):
            x = f @ x + root @ rng.normal(size=4)
            ys[t, k] = a[2:] @ x + 0.5 * rng.normal(size=2)
    return ys


def measured(ys):
    return Accelerations(jnp.asarray(ys[..., 0]), jnp.asarray(ys[..., 1]))


@lru_cache
def runner(filter):
    @jax.jit
    def run(ys, params, prior):
        def keep(state, info):
            return read_theta(state), info

        return drive.run(filter, filter.init(prior, params), ys, params, keep=keep)

    return run


def vehicle(ys, tuning=TUNING):
    params = four_corner_params(CARS, SPEED, DT, tuning)
    return runner(four_corner_filter(DT))(measured(ys), params, four_corner_prior(params, tuning))


SOFT = np.array([230e3, 130e3, 230e3, 230e3])


@pytest.fixture(scope="module")
def record():
    return simulate(0, SOFT)


def test_on_a_known_road_it_is_four_corners_on_their_own(record):
    """With a prior in which no step of theta meets the limit on its length."""
    ys = record.copy()
    ys[5, 2], ys[9, 1, 0] = np.nan, np.nan
    tuning = replace(TUNING, prior_level_sigma=0.0, prior_pressure_sigma=15e3)
    theta, info = vehicle(ys, tuning)
    mean, cov = map(np.asarray, wf.dense(theta))
    log_likelihood = np.zeros(STEPS)
    for k, car in enumerate(CARS):
        params = stiffness_params(car, SPEED, DT, tuning)
        prior = stiffness_prior(params, tuning)
        own, own_info = runner(stiffness_filter(DT))(measured(ys[:, k]), params, prior)
        np.testing.assert_allclose(mean[:, k], own.mean.ln_k_t, rtol=0, atol=1e-9)
        np.testing.assert_allclose(cov[:, k, k], own.cov[0][0], rtol=1e-8)
        np.testing.assert_allclose(
            np.stack(info.innovation, -1)[:, 2 * k : 2 * k + 2],
            np.stack(own_info.innovation, -1),
            atol=1e-7,
        )
        log_likelihood += own_info.log_likelihood
    np.testing.assert_allclose(info.log_likelihood, log_likelihood, atol=1e-7)
    np.testing.assert_array_equal(mean[:, 4], 0.0)
    np.testing.assert_array_equal(cov[:, :4, :4] * (1 - np.eye(4)), 0.0)
    np.testing.assert_array_equal(info.flags.missing, np.isnan(ys).sum((1, 2)))


def test_a_soft_tyre_is_told_from_three_sound_ones(record):
    """On a road of unknown level; the contrast of wheels is known better than any wheel."""
    theta, info = vehicle(record)
    assert not np.any(info.flags.nonfinite)
    mean, cov = (np.asarray(a)[-1] for a in wf.dense(theta))
    truth = np.array([*(np.log(stiffness(c.tire, p)) for c, p in zip(CARS, SOFT, strict=True)), 0])
    error = mean - truth
    assert error @ np.linalg.solve(cov, error) < 20.5  # chi-square of 5, 99.9 %
    sound = np.log([stiffness(car.tire, 230e3) for car in CARS])
    contrast = np.array([1 / 3, -1.0, 1 / 3, 1 / 3])
    off, sd = contrast @ (mean[:4] - sound), np.sqrt(contrast @ cov[:4, :4] @ contrast)
    assert off > 0.25
    assert off > 5.0 * sd
    assert sd < 0.6 * np.sqrt(cov[1, 1])
    others = np.array([1.0, 0.0, -0.5, -0.5])
    assert abs(others @ (mean[:4] - sound)) < 3.0 * np.sqrt(others @ cov[:4, :4] @ others)
    # errors that are common to all wheels come from the level: k_t^2 G is known best
    correlation = cov / np.sqrt(np.outer(np.diag(cov), np.diag(cov)))
    assert np.all(correlation[:4, :4] > 0)
    assert np.all(correlation[4, :4] < 0)


def test_the_prior_is_that_of_every_tyre():
    params = four_corner_params(CARS, SPEED, DT, TUNING)
    prior = four_corner_prior(params, TUNING)
    mean, cov = map(np.asarray, wf.dense(prior.theta))
    np.testing.assert_allclose(
        mean, [*(np.log(stiffness(car.tire, 190e3)) for car in CARS), 0.0], rtol=1e-14
    )
    slope = [
        car.tire.stiffness * car.tire.pressure_coefficient / car.tire.nominal_pressure
        for car in CARS
    ]
    sd = [s * 40e3 / stiffness(car.tire, 190e3) for s, car in zip(slope, CARS, strict=True)]
    np.testing.assert_allclose(cov, np.diag(np.square([*sd, 1.6])), rtol=1e-13)
    np.testing.assert_allclose(tuple(params.walk), [0.008**2 * DT] * 4 + [0.0], rtol=1e-14)
    for k, car in enumerate(CARS):
        one = stiffness_prior(stiffness_params(car, SPEED, DT, TUNING), TUNING)
        own = jax.tree.map(lambda a, k=k: a[k], prior.state)
        chex.assert_trees_all_close(own, one.state, rtol=1e-14)


def test_the_imm_has_the_modes_of_one_corner_for_all():
    params = changing_four_corner_params(CARS, SPEED, DT, TUNING)
    modes = changing_modes(DT, TUNING)
    np.testing.assert_array_equal(params.transition, modes.transition)
    np.testing.assert_array_equal(params.initial, modes.initial)
    assert params.members.walk._fields == VehicleTheta._fields
    for walk in params.members.walk[:4]:
        np.testing.assert_allclose(walk, modes.stiffness_walks**2 * DT, rtol=1e-14)
    np.testing.assert_allclose(params.members.walk.ln_level, modes.level_walks**2 * DT)
    np.testing.assert_array_equal(params.members.inner.car.sprung_mass, [FIGURES[:, 0]] * 3)
    prior = changing_four_corner_prior(params, TUNING)
    expected = four_corner_prior(four_corner_params(CARS, SPEED, DT, TUNING), TUNING)
    chex.assert_trees_all_close(prior, expected, rtol=1e-14)


def test_the_speed_reaches_every_wheel_and_mode():
    one = four_corner_params(CARS, SPEED, DT, TUNING)
    many = changing_four_corner_params(CARS, SPEED, DT, TUNING)
    for params, shape in ((one, (4,)), (many, (3, 4))):
        for speed in (jnp.asarray(30.0), jnp.array([20.0, 25.0])):
            bound = bind_speed(params, speed)
            inner = getattr(bound, "members", bound).inner
            assert inner.speed.shape == (*shape, *speed.shape)
            np.testing.assert_array_equal(inner.speed, np.broadcast_to(speed, inner.speed.shape))
            assert inner.level is getattr(params, "members", params).inner.level


def test_bad_input_is_named():
    for cars in (CARS[:3], [*CARS, CARS[0]], CARS[:1]):
        with pytest.raises(InputError, match="Give four: FL, FR, RL, RR"):
            four_corner_params(cars, SPEED, DT)
    with pytest.raises(InputError) as caught:
        four_corner_filter(DT, "cubature")
    assert caught.value.field == "inner"
    with pytest.raises(InputError) as caught:
        changing_four_corner_params(CARS, SPEED, DT, replace(TUNING, noise_a_u=0.0))
    assert caught.value.field == "tuning.noise_a_u"
