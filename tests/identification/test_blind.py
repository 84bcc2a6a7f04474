"""Identification on unknown roads, against a dense joint Gaussian, differences and the truth."""

import math
from dataclasses import replace
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from wheelhop.errors import DivergenceError, InputError, InputWarning
from wheelhop.estimators.road_model import shaping
from wheelhop.identification import search_space
from wheelhop.identification.blind import identify_blind
from wheelhop.identification.likelihood import Fitted, Given, compiled_sums, likelihood_sums
from wheelhop.identification.scoring import Ascent, Point, ascend
from wheelhop.identification.unknown_road import lay
from wheelhop.vehicle.parameters import brancati_suv, with_suspension
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import class_level, displacement_psd
from wheelhop.vehicle.road.shape_filter import CUTOFF
from wheelhop.vehicle.scenario import (
    constant_pressure,
    constant_travel,
    drive,
    road_rise_of_class,
)
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import stiffness_from_pressure

CAR = brancati_suv()
TWO = search_space(("suspension.damping", "suspension.stiffness"))
FOUR = search_space()
LEVEL = class_level("C")
IN_BAND = 1.0 + CUTOFF**2
"""The shape filter's white level at high wavenumbers over that at 1 rad/m."""


def logs(seed=0, duration=6.0, rate=250.0, cases=((11.0, 130e3), (17.0, 180e3), (22.0, 230e3))):
    """Records of the default car over class C."""
    found = []
    for k, (speed, pressure) in enumerate(cases):
        road, sensors = jax.random.split(jax.random.key(100 * seed + k))
        travel = constant_travel(speed, round(duration * rate), rate, 20)
        rise = road_rise_of_class(road, LEVEL, travel)
        found.append(drive(sensors, CAR, rise, constant_pressure(pressure), speed, rate)[0])
    return found


@lru_cache(maxsize=1)
def fitted_logs():
    start = with_suspension(CAR, Suspension(25e3, 1e5, 1500.0, 300.0))
    return identify_blind(logs(), start, space=FOUR, starts=2)


@pytest.mark.parametrize("waviness", [1.5, 1.8, 2.0, 2.3, 2.75])
def test_shaping_states_have_the_spectrum_of_the_waviness(waviness):
    wavenumber = 2 * np.pi * np.geomspace(0.05, 5.0, 300)
    (p1, p2), (r1, r2), gain = jax.tree.map(float, shaping(jnp.asarray(waviness)))
    response = 1 + r1 / (1j * wavenumber + p1) + r2 / (1j * wavenumber + p2)
    found = gain * np.abs(response) ** 2
    expected = wavenumber**2 * np.asarray(displacement_psd(wavenumber, 1.0, waviness))
    assert np.max(np.abs(10 * np.log10(found / expected))) < 0.26
    at_reference = gain * abs(1 + r1 / (1j + p1) + r2 / (1j + p2)) ** 2
    assert at_reference == pytest.approx(1.0, rel=1e-12)


def linear_system(speed, stiffness, waviness):
    """Continuous matrices of the linear car on a coloured road: A, noise input, observation."""
    s, m_s, m_u = CAR.suspension, CAR.sprung_mass, CAR.unsprung_mass
    (p1, p2), (r1, r2), _ = jax.tree.map(float, shaping(jnp.asarray(waviness)))
    body = np.array([-s.stiffness, 0, -s.damping, s.damping, 0, 0]) / m_s
    wheel = np.array([s.stiffness, -stiffness, s.damping, -s.damping, 0, 0]) / m_u
    a = np.zeros((6, 6))
    a[0, 2:4] = 1, -1
    a[1] = [0, 0, 0, 1, -speed * r1, -speed * r2]
    a[2], a[3] = body, wheel
    a[4, 4], a[5, 5] = -speed * p1, -speed * p2
    return a, np.array([0, -1, 0, 0, 1, 1.0]), np.stack([body, wheel])


def dense_log_likelihood(y, a, b, h, intensity, dt, start, noise):
    """log p(y) of all samples at once, from their joint covariance."""
    n, count = len(a), len(y)
    loan = np.block([[-a, intensity * np.outer(b, b)], [np.zeros((n, n)), a.T]]) * dt
    big = expm(loan)
    step = big[n:, n:].T
    cov_w = step @ big[:n, n:]
    cov, covs = start, []
    for _ in range(count):
        cov = step @ cov @ step.T + cov_w
        covs.append(cov)
    joint = np.zeros((2 * count, 2 * count))
    for j in range(count):
        cross = covs[j]
        for i in range(j, count):
            block = h @ cross @ h.T
            joint[2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = block
            joint[2 * j : 2 * j + 2, 2 * i : 2 * i + 2] = block.T
            cross = step @ cross
    joint += noise**2 * np.eye(2 * count)
    root = np.linalg.cholesky(joint)
    white = np.linalg.solve(root, y.ravel())
    return -0.5 * white @ white - np.log(np.diag(root)).sum() - count * math.log(2 * math.pi)


@pytest.fixture(scope="module")
def everything():
    """All kinds of parameters at once, on a coloured road: fitted, free numbers, course, given."""
    fitted = Fitted(TWO, True, True, True, "extended", 1)
    laid = lay(logs(duration=3.0), settling=0.0)
    shared = [*TWO.free(CAR), math.log(1.3 / 0.7), math.log(0.5), math.log(0.4)]
    free = np.array([[*shared, math.log(2e-5 / 16e-6)]] * 3).T[:, :, None]
    given = Given(jax.tree.map(lambda v: jnp.asarray(v, float), CAR), jnp.asarray(2.0), jnp.ones(2))
    return fitted, jnp.asarray(free), laid.course, given


def test_likelihood_is_that_of_the_joint_gaussian_of_all_samples(everything):
    """A linear car on a road of waviness 2.3; the filter's steps are Runge-Kutta's."""
    fitted, free, course, given = everything
    base = replace(CAR, suspension=replace(CAR.suspension, cubic_stiffness=0.0))
    base = replace(base, suspension=replace(base.suspension, quadratic_damping=0.0))
    given = given._replace(base=jax.tree.map(lambda v: jnp.asarray(v, float), base))
    free = free.at[4].set(math.log(0.5))
    found = compiled_sums(fitted)(free, course, given).log_likelihood[:, :, 0]
    for record, speed in enumerate((11.0, 17.0, 22.0)):
        pressure = float(course.pressure[0, 0, record])
        y = np.stack([np.asarray(course.a_s), np.asarray(course.a_u)], -1)[0, :, record]
        waviness = 1.0 + 2.0 * 1.3 / 2.0
        shape = shaping(jnp.asarray(waviness))
        intensity = math.pi * 2e-5 * speed * float(shape.gain)
        stiffness = float(stiffness_from_pressure(pressure, CAR.tire))
        a, b, h = linear_system(speed, stiffness, waviness)
        poles = np.array([float(p) for p in shape.poles])
        start = np.zeros((6, 6))
        start[:4, :4] = np.diag(np.square([0.02, 0.01, 0.3, 1.0]))
        start[4:, 4:] = intensity / speed / np.add.outer(poles, poles)
        dt = float(course.dt[record])
        expected = dense_log_likelihood(y, a, b, h, intensity, dt, start, 0.5)
        assert float(found[0, record]) == pytest.approx(expected, abs=0.05)


def test_score_is_the_gradient_of_the_log_likelihood(everything):
    """Forward-mode derivatives of every kind of parameter against central differences."""
    fitted, free, course, given = everything
    sums = compiled_sums(fitted)
    score = np.asarray(sums(free, course, given).score).sum(0)[:, :, 0]
    for k in range(len(free)):
        above, below = (
            np.asarray(sums(free.at[k].add(h), course, given).log_likelihood).sum(0)[:, 0]
            for h in (1e-4, -1e-4)
        )
        np.testing.assert_allclose(score[k], (above - below) / 2e-4, rtol=2e-5, atol=2e-4)


@pytest.mark.slow
def test_information_is_the_covariance_of_the_score():
    """Blocks' scores at the truth: as large as the information says, chi-square of 5."""
    found = fitted_logs()
    z = found.uncertainty.robust_errors[[0, 2]] / found.uncertainty.standard_errors[[0, 2]]
    assert np.all((z > 0.5) & (z < 2.0))


def test_recovers_car_and_roads_without_the_road():
    found = fitted_logs()
    sigma = found.uncertainty.standard_errors
    truth = [2400.0, 500.0, 33.6e3, 1e5, *[LEVEL * IN_BAND] * 3]
    assert np.all(
        np.abs(found.estimates - truth)[[0, 1, 2, 4, 5, 6]] < 4 * sigma[[0, 1, 2, 4, 5, 6]]
    )
    assert sigma[0] < 0.05 * 2400
    assert sigma[2] < 0.05 * 33.6e3
    assert found.classes == ("C", "C", "C")
    np.testing.assert_allclose(found.nis, 2.0, atol=0.2)
    assert found.log_likelihood > found.start_log_likelihood
    assert found.car.suspension.damping == found.values[0]
    assert np.all(np.diff(found.ascent.history, axis=0) <= 1e-6)


def test_names_what_the_records_do_not_tell():
    """k_snl moves no acceleration that noise of 0.5 m/s^2 would not hide."""
    found = fitted_logs()
    (weak,) = found.uncertainty.weak
    assert abs(weak.weights["suspension.cubic_stiffness"]) > 0.99
    assert any("hardly determine" in p and "cubic" in p for p in found.problems)
    with pytest.warns(InputWarning, match="hardly determine"):
        identify_blind(logs(), CAR, space=FOUR, starts=2, settings=Ascent(iterations=1))


def altered(record, **fields):
    return replace(record, **fields)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        (lambda r: [], "records"),
        (lambda r: [altered(r, pressure=None)], "record 1: pressure"),
        (lambda r: [altered(r, v=np.full_like(r.v, np.nan))], "record 1: v"),
        (lambda r: [r, altered(r, v=0.0 * r.v)], "record 2: v"),
        (lambda r: [cut(r, 300)], "record 1: t"),
        (lambda r: [altered(r, a_u=0.1 * np.sin(9 * r.t))], "record 1: a_u"),
        (lambda r: [altered(r, a_s=0.0 * r.a_s)], "record 1: a_s"),
    ],
)
def test_refuses_records_it_cannot_use(change, field):
    record = logs(duration=3.0)[0]
    with pytest.raises(InputError) as refusal:
        identify_blind(change(record), CAR)
    assert refusal.value.field == field


def cut(record, samples):
    return CornerRecord(
        *(getattr(record, f)[:samples] for f in ("t", "a_s", "a_u", "v", "pressure"))
    )


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"space": search_space(("tire.damping",))}, "parameters"),
        ({"waviness": 4.0}, "waviness"),
        ({"noise": (0.5, 0.0)}, "noise of a_u"),
        ({"starts": 0}, "starts"),
        ({"filter": "particle"}, "filter"),
        ({"settling": -1.0}, "settling"),
        ({"rate": 10.0}, "rate"),
        ({"names": ["a", "b"]}, "names"),
    ],
)
def test_refuses_options(options, field):
    with pytest.raises(InputError) as refusal:
        identify_blind(logs(duration=3.0)[:1], CAR, **options)
    assert refusal.value.field == field


def test_refuses_a_likelihood_that_is_nowhere_finite():
    records = [replace(r, a_s=1e120 * r.a_s) for r in logs()]
    with pytest.raises(DivergenceError, match="none of 2 starts"):
        identify_blind(records, CAR, space=FOUR, starts=2)


def test_one_parameter_of_one_record_is_enough():
    space = search_space(("tire.stiffness",))
    fitted = Fitted(space, False, False, False, "extended", 1)
    laid = lay(logs(duration=3.0)[:1])
    base = jax.tree.map(lambda v: jnp.asarray(v, float), CAR)
    given = Given(base, jnp.asarray(2.0), jnp.full(2, 0.5))
    found = jax.eval_shape(
        lambda free: likelihood_sums(free, laid.course, given, fitted), jnp.zeros((2, 1, 1))
    )
    assert found.information.shape == (6, 2, 2, 1, 1)


def test_thinning_keeps_every_second_sample():
    record = logs(duration=3.0)[0]
    course = lay([record], rate=125.0).course
    flat = np.asarray(course.a_u).reshape(-1)
    expected = record.a_u[::2]
    np.testing.assert_array_equal(flat[: len(expected)], expected)
    assert np.isnan(flat[len(expected) :]).all()
    assert float(course.dt[0]) == pytest.approx(0.008)


def test_scoring_climbs_a_curved_ridge():
    """Rosenbrock's function as residuals, of which the Gauss-Newton matrix is the information."""

    def evaluate(x):
        residual = np.stack([10 * (x[:, 1] - x[:, 0] ** 2), 1 - x[:, 0]], -1)
        zero, one = np.zeros(len(x)), np.ones(len(x))
        slope = np.stack([np.stack([-20 * x[:, 0], 10 * one], -1), np.stack([-one, zero], -1)], 1)
        score = -np.einsum("ski,sk->si", slope, residual)
        return Point(-0.5 * (residual**2).sum(1), score, np.einsum("ski,skj->sij", slope, slope))

    found = ascend(np.array([[-1.2, 1.0], [2.0, -2.0]]), evaluate, Ascent(patience=60))
    assert found.converged.all()
    np.testing.assert_allclose(found.free, 1.0, atol=1e-2)


@pytest.mark.slow
def test_float32_gives_the_same_fit(float32):
    found = identify_blind(logs(), CAR, space=FOUR, starts=2)
    reference = fitted_logs()
    apart = np.abs(found.values - reference.values) / reference.uncertainty.standard_errors[:4]
    assert np.all(apart[:3] < 0.1)


@pytest.mark.slow
def test_standard_errors_are_honest():
    """20 trials: NEES of (c_s, c_snl, k_s, levels) within its 99.9 % band, 2 sigma covers."""
    squares, inside = [], []
    truth = np.array([2400.0, 500.0, 33.6e3, *[LEVEL * IN_BAND] * 3])
    for seed in range(20):
        found = identify_blind(logs(seed + 1), CAR, space=FOUR, starts=2)
        use = [0, 1, 2, 4, 5, 6]
        z = (found.estimates[use] - truth) / found.uncertainty.standard_errors[use]
        cov = found.uncertainty.correlation[np.ix_(use, use)]
        squares.append(z @ np.linalg.solve(cov, z))
        inside.append(np.abs(z) < 2)
    assert 6 * 0.55 < np.mean(squares) < 6 * 1.55
    assert 0.88 < np.mean(inside) <= 1.0


def test_refuses_records_of_one_name():
    """Levels and weights go by the records' names."""
    with pytest.raises(InputError, match="a name of its own"):
        lay(logs(duration=3.0)[:1] * 2, ["a", "a"])
