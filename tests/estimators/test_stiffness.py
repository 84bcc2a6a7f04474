"""RML over one corner against a quarter car, its road and a Kalman filter written in NumPy."""

from dataclasses import dataclass, replace
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.stats

import wheelhop.filtering as wf
from wheelhop.errors import InputError
from wheelhop.estimators.stiffness import (
    CornerTheta,
    StiffnessTuning,
    bind_speed,
    bind_theta,
    read_theta,
    stiffness_filter,
    stiffness_params,
    stiffness_prior,
    theta_type,
    validate_tuning,
)
from wheelhop.filtering import SensitivityParams, drive, run_batch
from wheelhop.vehicle.parameters import QuarterCar, brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import Tire

DT, SPEED, LEVEL, NOISE = 0.002, 16.0, 1e-5, 0.5
STEPS = 60
REST = np.diag([0.02, 0.01, 0.3, 1.0]) ** 2
"""Belief over (d, e, v_s, v_u) before the first sample, as the estimator states it."""
FREE = ("ln_sprung_mass", "ln_damping")
TUNING = StiffnessTuning(prior_level=LEVEL)


@dataclass(frozen=True)
class Linear:
    """Quarter car of SI figures; k_t apart from the pressure."""

    m_s: float = 466.7
    m_u: float = 61.14
    k_s: float = 33.6e3
    c_s: float = 2400.0
    k_t: float = 220e3
    level: float = LEVEL
    speed: float = SPEED

    def matrices(self, dt=DT):
        """F, cov(w), H over (d, e, v_s, v_u) and one sampling interval, exactly.

        The road has a one-sided slope spectrum of `level` per rad/m, so its velocity at speed v
        is white of intensity pi level v (two-sided level / 2, times 2 pi, times v).
        """
        body, wheel = 1.0 / self.m_s, 1.0 / self.m_u
        force = np.array([self.k_s, 0.0, self.c_s, -self.c_s])
        tyre = np.array([0.0, self.k_t, 0.0, 0.0])
        rows = [[0, 0, 1, -1], [0, 0, 0, 1], -body * force, wheel * (force - tyre)]
        a = np.array(rows, float)
        noise = np.zeros((4, 4))
        noise[1, 1] = np.pi * self.level * self.speed
        top = scipy.linalg.expm(dt * np.block([[-a, noise], [np.zeros((4, 4)), a.T]]))
        f = top[4:, 4:].T
        q = f @ top[:4, 4:]
        return f, 0.5 * (q + q.T), a[2:]

    def car(self):
        tire = Tire(self.k_t, 250e3, 0.7)
        return QuarterCar(self.m_s, self.m_u, Suspension(self.k_s, 0.0, self.c_s, 0.0), tire)


TRUTH = Linear()


def simulate(rng, cars, steps):
    """Measurements [car, time, 2] on roads of their own, from draws of the estimator's start."""
    f, q, h = (np.stack(a) for a in zip(*(car.matrices() for car in cars), strict=True))
    root = np.linalg.cholesky(q + 1e-30 * np.eye(4))
    x = np.sqrt(np.diag(REST)) * rng.normal(size=(len(cars), 4))
    ys = np.empty((len(cars), steps, 2))
    for t in range(steps):
        x = np.einsum("rij,rj->ri", f, x)
        x += np.einsum("rij,rj->ri", root, rng.normal(size=x.shape))
        ys[:, t] = np.einsum("rij,rj->ri", h, x) + NOISE * rng.normal(size=(len(cars), 2))
    return ys


def kalman(car, ys):
    """Textbook filter from rest: means, covariances, innovations and S of every sample.

    A missing entry has innovation 0 and variance 1.
    """
    f, q, h = car.matrices()
    mean, cov = np.zeros(4), REST
    found = []
    for y in ys:
        mean, cov = f @ mean, f @ cov @ f.T + q
        here = np.isfinite(y)
        s, r = np.eye(2), np.zeros(2)
        s[np.ix_(here, here)] = (h @ cov @ h.T)[np.ix_(here, here)] + NOISE**2 * np.eye(here.sum())
        r[here] = y[here] - (h @ mean)[here]
        gain = (cov @ h.T) @ np.linalg.inv(s) @ np.diag(here)
        mean, cov = mean + gain @ r, cov - gain @ s @ gain.T
        found.append((mean, cov, r, s))
    return [np.array(a) for a in zip(*found, strict=True)]


def log_likelihood(r, s, ys):
    """Sum over the samples, less the constant of every entry that is present."""
    white = np.einsum("ti,tij,tj->", r, np.linalg.inv(s), r)
    return -0.5 * (
        white + np.linalg.slogdet(s)[1].sum() + np.isfinite(ys).sum() * np.log(2 * np.pi)
    )


def moved(car, theta):
    ln_k_t, ln_level, ln_mass, ln_damping = theta
    return replace(
        car,
        k_t=car.k_t * np.exp(ln_k_t),
        level=car.level * np.exp(ln_level),
        m_s=car.m_s * np.exp(ln_mass),
        c_s=car.c_s * np.exp(ln_damping),
    )


@lru_cache
def runner(free=FREE, inner="extended"):
    """One compilation for every record, car and prior."""
    filter = stiffness_filter(DT, free, inner)

    @jax.jit
    def run(ys, params, prior):
        return drive.run(filter, filter.init(prior, params), ys, params)

    return run


def measured(ys):
    return Accelerations(jnp.asarray(ys[..., 0]), jnp.asarray(ys[..., 1]))


def gaps(ys):
    ys = ys.copy()
    ys[7], ys[9, 0], ys[20:25, 1] = np.nan, np.nan, np.nan
    return ys


RECORD = gaps(simulate(np.random.default_rng(0), [TRUTH], STEPS)[0])


def started(params, mean, sd, free=FREE):
    """Belief over theta with the estimator's own over the state."""
    kind = theta_type(free)
    theta = wf.independent(kind(*map(jnp.asarray, mean)), kind(*map(jnp.asarray, sd)))
    return stiffness_prior(params, TUNING, free)._replace(theta=theta)


def still(car, free=FREE):
    """Parameters of a tuning in which theta does not walk."""
    return stiffness_params(car, SPEED, DT, replace(TUNING, stiffness_walk=0.0), free)


def test_score_and_information_are_the_slopes_of_the_likelihood():
    """A variance of 1e-10 holds theta while Sigma times the score still shows."""
    start = [np.log(TRUTH.k_t), 0.0, 0.0, 0.0]
    params = still(TRUTH.car())
    found = runner()(measured(RECORD), params, started(params, start, [1e-5] * 4))
    mean, cov = (np.asarray(a)[-1] for a in wf.dense(found.state.theta))
    score = np.linalg.solve(cov, mean - start)
    info = np.linalg.inv(cov) - 1e10 * np.eye(4)

    h = 1e-4
    sides = [
        [kalman(moved(TRUTH, side * unit), RECORD)[2:] for side in (h, -h)] for unit in np.eye(4)
    ]
    slope = [(np.subtract(*(log_likelihood(*x, RECORD) for x in s))) / (2 * h) for s in sides]
    r_slope = np.array([(a[0] - b[0]) / (2 * h) for a, b in sides])
    s_slope = np.array([(a[1] - b[1]) / (2 * h) for a, b in sides])
    white = np.linalg.inv(kalman(TRUTH, RECORD)[3])
    expected = np.einsum("ita,tab,jtb->ij", r_slope, white, r_slope)
    expected += 0.5 * np.einsum("tab,itbc,tcd,jtda->ij", white, s_slope, white, s_slope)
    np.testing.assert_allclose(score, slope, rtol=1e-4, atol=1e-4)
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(info / size, expected / size, atol=1e-4)
    assert float(found.info.log_likelihood.sum()) == pytest.approx(
        log_likelihood(*kalman(TRUTH, RECORD)[2:], RECORD), abs=1e-4
    )


def test_with_theta_held_it_is_the_kalman_filter():
    """At another theta than the parameters' own, so that what is bound is what is used."""
    theta = np.array([0.1, -0.3, 0.05, -0.1])
    params = still(TRUTH.car())
    start = theta + np.array([np.log(TRUTH.k_t), 0.0, 0.0, 0.0])
    prior = started(params, start, np.zeros(4))
    found = runner()(measured(RECORD), params, prior)
    means, covs, r, s = kalman(moved(TRUTH, theta), RECORD)
    mean, cov = wf.dense(found.state.inner)
    sd = np.sqrt(np.diagonal(covs, axis1=1, axis2=2))
    # Runge-Kutta steps of (wheel hop * dt)^5 / 120 = 4e-7 against the matrix exponential
    assert np.all(np.abs(np.asarray(mean) - means) < 5e-5 * sd)
    assert np.all(np.abs(np.asarray(cov) - covs) < 5e-5 * sd[:, :, None] * sd[:, None, :])
    np.testing.assert_array_equal(found.state.theta.mean.ln_level, theta[1])
    size = np.sqrt(np.diagonal(s, axis1=1, axis2=2))
    assert np.all(np.abs(np.stack(found.info.innovation, -1) - r) < 5e-5 * size)
    np.testing.assert_allclose(found.info.innovation_cov[1][1], s[:, 1, 1], rtol=5e-5)
    np.testing.assert_array_equal(found.info.flags.missing, np.isnan(RECORD).sum(1))


UNITS = {"mass": (7.0, 1.0), "time": (1.0, 5.0), "both": (0.2, 0.3)}


@pytest.mark.parametrize("unit", UNITS)
def test_units_only_shift_ln_k_t(unit):
    """A unit of mass 1/m and of time 1/s as large; the car is mildly nonlinear."""
    m, s = UNITS[unit]
    car = brancati_suv()
    params, tuning = stiffness_params(car, SPEED, DT, TUNING, FREE), TUNING
    prior = stiffness_prior(params, tuning, FREE)
    one = runner()(measured(RECORD), params, prior)

    old = car.suspension
    other = QuarterCar(
        m * car.sprung_mass,
        m * car.unsprung_mass,
        Suspension(
            m / s**2 * old.stiffness,
            m / s**2 * old.cubic_stiffness,
            m / s * old.damping,
            m * old.quadratic_damping,
        ),
        replace(car.tire, stiffness=m / s**2 * car.tire.stiffness),
    )
    scaled = stiffness_params(other, SPEED / s, DT, TUNING, FREE)
    scaled = SensitivityParams(
        replace(
            scaled.inner,
            dt=scaled.inner.dt * s,
            noise_a_s=scaled.inner.noise_a_s / s**2,
            noise_a_u=scaled.inner.noise_a_u / s**2,
        ),
        scaled.walk,
    )
    belief = stiffness_prior(scaled, tuning, FREE)
    rates = [1.0, 1.0, 1.0 / s, 1.0 / s]
    state = wf.Gaussian(
        belief.state.mean,
        tuple(
            tuple(rates[i] * rates[j] * x for j, x in enumerate(row))
            for i, row in enumerate(belief.state.cov)
        ),
    )
    two = runner()(measured(RECORD / s**2), scaled, belief._replace(state=state))
    mean, cov = wf.dense(one.state.theta)
    shift = np.array([np.log(m / s**2), 0.0, 0.0, 0.0])
    np.testing.assert_allclose(wf.dense(two.state.theta)[0], np.asarray(mean) + shift, atol=1e-9)
    np.testing.assert_allclose(wf.dense(two.state.theta)[1], cov, atol=1e-10)
    np.testing.assert_allclose(two.info.nis, one.info.nis, atol=1e-8)
    # a density per (m/s^2)^2 and entry
    present = np.isfinite(RECORD).sum(1)
    likelihood = two.info.log_likelihood - present * 2.0 * np.log(s)
    np.testing.assert_allclose(likelihood, one.info.log_likelihood, atol=1e-8)


RUNS, LONG = 64, 1000
SD = np.array([0.15, 0.5])


def drives(seed, sd):
    """Records of 2 s with ln k_t and ln G drawn from their prior, and the draws."""
    rng = np.random.default_rng(seed)
    theta = sd * rng.normal(size=(RUNS, 2))
    return simulate(rng, [moved(TRUTH, (*t, 0, 0)) for t in theta], LONG), theta


def errors(seed, sd):
    """Error of theta after 2 s and its covariance as stated, [run, 2]."""
    ys, theta = drives(seed, sd)
    filter, params = stiffness_filter(DT), still(TRUTH.car(), ())
    prior = started(params, [np.log(TRUTH.k_t), 0.0], sd, ())
    found = run_batch(
        filter,
        filter.init(prior, params),
        measured(ys),
        params,
        keep=lambda state, info: (read_theta(state), info.flags.nonfinite),
        lanes=RUNS,
    )
    theta_found, bad = jax.tree.map(np.asarray, found)
    assert not bad.any()
    mean, cov = (np.asarray(a)[:, -1] for a in wf.dense(theta_found))
    return mean - [np.log(TRUTH.k_t), 0.0] - theta, cov


def inside(nees, freedom):
    low, high = scipy.stats.chi2.ppf([0.005, 0.995], freedom)
    assert low < nees < high, (low, nees, high)


def test_covariance_is_honest_and_a_known_road_is_worth_more():
    error, cov = errors(1, SD)
    inside(np.einsum("ri,rij,rj->", error, np.linalg.inv(cov), error), 2 * RUNS)
    sd = np.sqrt(cov[:, 0, 0])
    known, known_cov = errors(2, SD * [1.0, 0.0])
    known_sd = np.sqrt(known_cov[:, 0, 0])
    inside(np.sum((known[:, 0] / known_sd) ** 2), RUNS)
    np.testing.assert_array_equal(known[:, 1], 0.0)
    # Whittle bounds of a linear corner after 2 s: 11.5 % and 1.6 to 2.7 %, before the prior
    assert 0.06 < np.sqrt(np.mean(sd**2)) < 0.1
    assert 0.016 < np.sqrt(np.mean(known_sd**2)) < 0.027
    assert np.std(known[:, 0]) < 0.4 * np.std(error[:, 0])


def test_theta_takes_effect_where_it_says():
    car = brancati_suv()
    params = stiffness_params(car, SPEED, DT, TUNING, ("waviness", *FREE)).inner
    kind = theta_type(("waviness", *FREE))
    bound = bind_theta(params, kind(*map(jnp.asarray, (12.0, 0.4, -0.2, 0.1, -0.3))))
    old, new = params.car, bound.car
    assert float(new.tire.stiffness) == pytest.approx(np.exp(12.0))
    # the pressure at which the law gives just that stiffness
    assert float(bound.pressure) == float(new.tire.nominal_pressure)
    assert float(bound.level) == pytest.approx(LEVEL * np.exp(0.4))
    assert float(bound.waviness) == pytest.approx(1.8)
    assert float(new.sprung_mass) == pytest.approx(np.exp(0.1) * old.sprung_mass)
    ratio = np.exp(-0.3)
    assert float(new.suspension.damping) == pytest.approx(ratio * old.suspension.damping)
    quadratic = ratio * old.suspension.quadratic_damping
    assert float(new.suspension.quadratic_damping) == pytest.approx(quadratic)
    assert new.suspension.stiffness is old.suspension.stiffness
    assert new.suspension.cubic_stiffness is old.suspension.cubic_stiffness
    assert float(new.unsprung_mass) == old.unsprung_mass

    plain = bind_theta(params, CornerTheta(jnp.asarray(12.0), jnp.asarray(0.4)))
    assert plain.car.sprung_mass is old.sprung_mass
    assert plain.car.suspension is old.suspension
    assert plain.waviness is params.waviness
    faster = bind_speed(SensitivityParams(params, None), jnp.asarray(30.0)).inner
    assert (float(faster.speed), float(faster.dt)) == (30.0, DT)


def test_the_prior_is_that_of_the_tuning():
    """dp = 40 kPa is d ln k_t = 0.7 dp / (p_0 (1 + 0.7 (p - p_0) / p_0)) at the prior's p."""
    car, free = brancati_suv(), ("ln_damping", "waviness")
    tuning = replace(TUNING, level_walk=0.3, waviness_sigma=0.2, damping_sigma=0.07)
    params = stiffness_params(car, SPEED, DT, tuning, free)
    prior = stiffness_prior(params, tuning, free)
    share = 1.0 + 0.7 * (190e3 - 250e3) / 250e3
    mean, cov = wf.dense(prior.theta)
    np.testing.assert_allclose(mean, [np.log(264.7e3 * share), 0.0, 0.0, 0.0], rtol=1e-14)
    sd = np.array([0.7 * 40e3 / 250e3 / share, 1.6, 0.07, 0.2])
    np.testing.assert_allclose(cov, np.diag(sd**2), rtol=1e-14)
    walk = [0.005**2 * DT, 0.3**2 * DT, 0.0, 0.0]
    np.testing.assert_allclose(tuple(params.walk), walk, rtol=1e-14)
    assert params.walk._fields == ("ln_k_t", "ln_level", "ln_damping", "waviness")
    # shaping states only where the waviness asks for them
    assert len(prior.state.mean) == 6
    assert len(stiffness_prior(params, tuning, free, coloured=False).state.mean) == 4


def test_a_long_sampling_interval_is_integrated_in_pieces():
    assert stiffness_filter(0.01) is stiffness_filter(0.0119)
    assert stiffness_filter(DT) is stiffness_filter(0.004)
    assert stiffness_filter(DT) is not stiffness_filter(0.0041)

    filter, params = stiffness_filter(0.01), stiffness_params(TRUTH.car(), SPEED, 0.01, TUNING)
    x = np.array([0.01, -0.003, 0.1, 0.4])
    prior = started(params, [np.log(TRUTH.k_t), 0.0], [0.1, 1.0], ())
    kind = type(prior.state.mean)
    prior = prior._replace(state=prior.state._replace(mean=kind(*map(jnp.asarray, x))))
    nothing = Accelerations(jnp.asarray(np.nan), jnp.asarray(np.nan))
    state, info = jax.jit(lambda p: filter.step(filter.init(prior, p), nothing, p))(params)
    f, q, _ = TRUTH.matrices(0.01)
    mean, cov = wf.dense(state.inner)
    sd = np.sqrt(np.diag(f @ REST @ f.T + q))
    assert np.all(np.abs(mean - f @ x) < 1e-3 * sd)
    assert np.all(np.abs(cov - (f @ REST @ f.T + q)) < 1e-3 * np.outer(sd, sd))
    assert int(info.flags.missing) == 2
    grown = np.diag([0.1**2 + 0.005**2 * 0.01, 1.0])
    np.testing.assert_allclose(wf.dense(state.theta)[1], grown, rtol=1e-14)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("noise_a_s", 0.0),
        ("noise_a_u", 101.0),
        ("prior_pressure", 190.0),
        ("prior_pressure_sigma", 0.0),
        ("prior_level", 0.0),
        ("prior_level_sigma", -0.1),
        ("stiffness_walk", np.nan),
        ("level_walk", -1.0),
        ("waviness_sigma", 1.1),
        ("sprung_mass_sigma", 2.0),
        ("damping_sigma", np.inf),
    ],
)
def test_tuning_out_of_range_is_named(field, value):
    with pytest.raises(InputError) as caught:
        stiffness_params(brancati_suv(), SPEED, DT, replace(TUNING, **{field: value}))
    assert caught.value.field == f"tuning.{field}"
    assert validate_tuning(TUNING) is TUNING


def test_unknown_filters_and_parameters_are_named():
    with pytest.raises(InputError, match="inner: 'cubature' is unknown"):
        stiffness_filter(DT, inner="cubature")
    for free in (("ln_stiffness",), ("waviness", "waviness")):
        for call in (stiffness_filter, lambda dt, free: theta_type(free)):
            with pytest.raises(InputError, match="Use some of") as caught:
                call(DT, free)
            assert caught.value.field == "free"
