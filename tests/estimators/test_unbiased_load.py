"""The unbiased filter of the load: matrices, exactness, Monte Carlo, and behind its low-pass."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim
from scipy.stats import chi2

from tests.oracles import quarter_car_lti as lti
from wheelhop.errors import InputError
from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.unbiased_load import (
    USUAL_LOAD,
    Stroke,
    ThreeSignals,
    corner_system,
    unbiased,
    unbiased_params,
)
from wheelhop.estimators.wheel_load import LoadSample, WheelLoad
from wheelhop.estimators.youla_load import unknown_before
from wheelhop.filtering import run_batch
from wheelhop.filtering.decoupling import decoupled
from wheelhop.filtering.drive import run
from wheelhop.filtering.gaussian import gaussian
from wheelhop.filtering.unknown_input import unknown_input
from wheelhop.vehicle.corner_suspension import CornerSuspension

DT, SAMPLES, BANDWIDTH, RUNS, STEPS = 1e-3, 300, 30.0, 640, 120
CAR = lti.Car()
WEIGHT = (CAR.m_s + CAR.m_u) * lti.GRAVITY
PROPER = unknown_input(ThreeSignals, WheelLoad)
OBSERVER = unbiased()
NOISE, WALK = ThreeSignals(0.1, 1e-3, 1e-2), 0.05
PRIOR = np.diag([0.03**2, 0.3**2])
HZ, NORMAL, TRANSFER = np.array([1.3, 4.0]), np.array([500.0, 200.0]), np.array([300.0, 100.0])


def corner_of(car, dtype=float):
    return CornerSuspension(*(jnp.asarray(x, dtype) for x in car))


def system_of(car, noise=NOISE, walk=WALK):
    return corner_system(corner_of(car), DT, jnp.asarray(walk), noise)


def params(car=CAR, **sensors):
    return unbiased_params(corner_of(car), DT, BANDWIDTH, LoadSensors(**sensors))


def rough(runs, samples=SAMPLES, seed=0):
    """Loads that no model of a load foretells, constant from sample to sample [runs, time, 2]."""
    rng = np.random.default_rng(seed)
    jumps = rng.normal(scale=300.0, size=(runs, samples, 2))
    return np.array([WEIGHT, 0.0]) + jumps + 1500 * rng.choice([-1, 1], size=(runs, samples, 2))


def keep_proper(state, info):
    return state.belief, state.input, info.nis


def keep(state, info):
    return OBSERVER.load(state), info.flags.missing


def observe(y, p):
    return run(OBSERVER.filter, OBSERVER.filter.init(unknown_before(), p), y, p, keep=keep)


compiled = jax.jit(observe)


def estimate(y, p):
    """(F, dF) [time, 2] of the sampling intervals before."""
    found, _ = compiled(LoadSample(*jnp.asarray(y[:, :2]).T), p)
    return np.stack([np.asarray(x) for x in found.mean], 1)


def test_matrices_are_those_of_the_equations_of_motion():
    """Inputs that are held, on the three states with momenta: the same outputs, sample by sample;
    and SciPy's zero-order hold of the two states that are left."""
    car = CAR._replace(preload=1000.0)
    u = rough(1, 50)[0]
    full = np.c_[u, np.ones(50)]
    expected = lti.held(lti.corner(car), full, DT)
    m = system_of(car)
    x, ys = np.zeros(2), []
    for now in u:
        ys.append(m.observation @ x + m.feedthrough @ now + m.observation_offset)
        x = m.transition @ x + m.input_matrix @ now + m.state_offset
    np.testing.assert_allclose(ys, expected, rtol=1e-9, atol=1e-9)
    ease = 1 / car.m_s + 1 / car.m_u
    a = np.array([[0.0, 1.0], [-car.k * ease, -car.b * ease]])
    b = np.array([[0, 0, 0], [1 / car.m_u, 1 / car.m_s, -car.preload * ease]])
    f, g, *_ = cont2discrete((a, b, np.eye(2), np.zeros((2, 3))), DT, method="zoh")
    np.testing.assert_allclose(m.transition, f, rtol=1e-10, atol=1e-13)
    ours = np.c_[m.input_matrix, m.state_offset]
    np.testing.assert_allclose(ours, g, rtol=1e-9, atol=1e-15)


def filtered(ys, systems):
    """What the filter proper finds in three signals [RUNS, time, 3], each run with its matrices."""
    p = decoupled(system_of(CAR), USUAL_LOAD**2 * np.eye(2))
    state = PROPER.init(gaussian(Stroke(0.0, 0.0), jnp.asarray(PRIOR)), p)
    none = jax.tree.map(lambda _: None, p)
    by_run = replace(none, model=jax.tree.map(lambda _: 0, p.model))
    signals = ThreeSignals(*(jnp.asarray(ys[..., i]) for i in range(3)))
    found = run_batch(
        PROPER,
        state,
        signals,
        replace(p, model=systems),
        keep=keep_proper,
        in_axes=(None, 0, by_run, None),
    )
    return jax.tree.map(np.asarray, found)


@pytest.fixture(scope="module")
def monte_carlo():
    """Runs on the matrices themselves: (states, loads, what the filter found)."""
    runs = RUNS
    rng = np.random.default_rng(1)
    size = 1 + 0.3 * rng.uniform(-1, 1, (6, runs))
    cars = lti.Car(*(np.asarray(CAR)[:, None] * size))
    systems = jax.vmap(
        lambda c: corner_system(c, DT, jnp.asarray(WALK), ThreeSignals(*map(jnp.asarray, NOISE)))
    )(corner_of(cars))
    f, g, c, h = (
        np.asarray(m)
        for m in (systems.transition, systems.input_matrix, systems.observation,
                  systems.feedthrough)
    )  # fmt: skip
    loads = rough(runs, STEPS + 1)
    x = np.einsum("ij,rj->ri", np.sqrt(PRIOR), rng.normal(size=(runs, 2)))
    xs, ys = [], []
    for k in range(1, STEPS + 1):
        x = np.einsum("rij,rj->ri", f, x) + np.einsum("rij,rj->ri", g, loads[:, k - 1])
        x = x + systems.state_offset + rng.normal(size=(runs, 1)) * [0.0, WALK * np.sqrt(DT)]
        y = np.einsum("rij,rj->ri", c, x) + np.einsum("rij,rj->ri", h, loads[:, k])
        xs.append(x)
        ys.append(y + systems.observation_offset + rng.normal(size=(runs, 3)) * NOISE)
    ys = np.stack(ys, 1)
    return np.stack(xs, 1), loads, filtered(ys, systems)


def errors(belief, truth):
    """Errors [2, runs, time] and covariances [2, 2, runs, time]."""
    off = np.stack([m - truth[..., i] for i, m in enumerate(belief.mean)])
    cov = belief.cov
    return off, np.array([[cov[0][0], cov[1][0]], [cov[1][0], cov[1][1]]])


def normalised(off, cov):
    inverse = np.linalg.inv(cov.transpose(2, 3, 0, 1))
    return np.einsum("irt,rtij,jrt->rt", off, inverse, off)


def test_load_and_state_are_unbiased(monte_carlo):
    """Mean error of the runs within its own standard error, at three times and on average, though
    the loads jump by thousands of newtons from sample to sample."""
    xs, loads, (belief, load, _) = monte_carlo
    for off, cov in (errors(belief, xs), errors(load, loads[:, :-1])):
        z = off / np.sqrt(np.stack([cov[0, 0], cov[1, 1]]))
        runs = z.shape[1]
        for k in (5, 60, 119):
            assert abs(z[:, :, k].mean(1)).max() * np.sqrt(runs) < 3.9
        # within a run errors hang together: runs are the samples
        means = z[:, :, 5:].mean(2)
        assert np.all(abs(means.mean(1)) < 3.9 * means.std(1) / np.sqrt(runs))


def test_errors_have_the_stated_covariance(monte_carlo):
    """Chi-square over the runs: the state (2), the load (2), the rest of the innovation (1)."""
    xs, loads, (belief, load, nis) = monte_carlo
    of_state, of_load = (
        normalised(*errors(b, t)) for b, t in ((belief, xs), (load, loads[:, :-1]))
    )
    runs = len(nis)
    for k in (5, 20, 60, 119):
        for found, freedom in ((of_state, 2), (of_load, 2), (nis, 1)):
            band = chi2.ppf([0.0001, 0.9999], freedom * runs)
            assert band[0] < found[:, k].sum() < band[1]
    # its rests are white: the average over the record is that much narrower
    band = chi2.ppf([0.0001, 0.9999], runs * (STEPS - 5))
    assert band[0] < nis[:, 5:].sum() < band[1]


def test_matched_data_without_noise_give_the_load_exactly():
    """Three true signals of the momentum form; loads jump at will."""
    loads = rough(1, STEPS + 1, seed=3)[0]
    y = lti.held(lti.corner(CAR), np.c_[loads, np.ones(STEPS + 1)], DT)[1:]
    quiet = system_of(CAR, ThreeSignals(1e-6, 1e-8, 1e-7), 1e-9)
    repeated = jax.tree.map(lambda a: jnp.stack([a] * RUNS), quiet)
    _, load, _ = filtered(np.stack([y] * RUNS), repeated)
    found = np.stack([x[0] for x in load.mean], 1)
    np.testing.assert_allclose(found[2:], loads[2:-1], atol=0.01)


def smooth(t):
    angle = 2 * np.pi * HZ * t[:, None]
    return np.c_[WEIGHT + np.sin(angle) @ NORMAL, np.cos(angle) @ TRANSFER]


def shaped(t):
    """The loads behind 1 / (1 + s / w_d)^2, in the steady state."""
    passed = 1 / (1 + 1j * HZ / BANDWIDTH) ** 2
    turning = np.exp(2j * np.pi * HZ * t[:, None])
    return np.c_[WEIGHT + (turning @ (passed * NORMAL)).imag, (turning @ (passed * TRANSFER)).real]


@pytest.fixture(scope="module")
def drive():
    return lti.driven(lti.corner(CAR), (WEIGHT, 0.0), smooth, DT, SAMPLES)


def test_loads_are_found_behind_the_low_pass(drive):
    """F, which only the next sample shows, in the middle of the interval before; dF, which the
    accelerometer shows at once, at its begin; and so the true ones within the low-pass's error."""
    t, true, y = drive
    found = estimate(y, params())[200:]
    normal, transfer = shaped(t[200:] - 0.5 * DT)[:, 0], shaped(t[200:] - DT)[:, 1]
    np.testing.assert_allclose(found, np.stack([normal, transfer], 1), atol=0.5)
    away = abs(1 - 1 / (1 + 1j * HZ / BANDWIDTH) ** 2) + 2 * np.pi * HZ * DT / 2
    bound = np.array([away @ NORMAL, away @ TRANSFER]) + 0.5
    error = abs(found - true[199:-1]).max(0)
    assert np.all(error < bound)
    assert np.all(error > 0.2 * bound)


def test_converges_uninitialised_in_a_tenth_of_a_second():
    """From the spring's free length, 0.13 m off."""
    car = CAR._replace(preload=0.0)
    t, _, y = lti.driven(lti.corner(car), (WEIGHT, 0.0), smooth, DT, SAMPLES)
    error = abs(estimate(y, params(car)) - shaped(t - 0.5 * DT))
    assert error[2:10].max() > 1000
    assert error[100:].max() < 5


@pytest.mark.parametrize("preload", [CAR.preload, 0.0])
def test_rest_gives_the_weight(preload):
    car = CAR._replace(preload=preload)
    q = np.full(SAMPLES, (CAR.m_s * lti.GRAVITY - preload) / CAR.k)
    found = estimate(np.stack([0 * q, q], 1), params(car))
    np.testing.assert_allclose(found[-1], [WEIGHT, 0.0], atol=1e-3)


def test_the_differentiators_noise_is_that_of_scipys(drive):
    """Standard deviations of white noise behind the low-pass and behind its derivative."""
    p = params(acceleration_noise=0.2, deflection_noise=4e-4)
    w = 2 * np.pi * BANDWIDTH
    pulse = np.zeros(2000)
    pulse[0] = 1.0
    spread = []
    for numerator in ([1.0], [1.0, 0.0]):
        discrete = cont2discrete((numerator, [1 / w**2, 2 / w, 1]), DT, method="bilinear")
        spread.append(np.sqrt((dlsim(discrete, pulse)[1] ** 2).sum()))
    expected = np.square([0.2 * spread[0], 4e-4 * spread[0], 4e-4 * spread[1]])
    found = np.diag(np.asarray(p.system.model.observation_cov))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_lost_sample_is_flagged_and_held(drive):
    y = drive[2].copy()
    lost = y.copy()
    lost[250, 1], y[250, 1] = np.nan, y[249, 1]
    _, missing = compiled(LoadSample(*jnp.asarray(lost[:, :2]).T), params())
    np.testing.assert_array_equal(np.flatnonzero(missing), [250])
    np.testing.assert_allclose(estimate(lost, params()), estimate(y, params()), rtol=1e-12)


def test_runs_with_other_corners_equal_single_runs(drive):
    """Without new parameters for each: the matrices are pure functions of the corner."""
    ks = np.array([25e3, 33.6e3, 60e3])
    p = params()
    noise = ThreeSignals(*jnp.sqrt(jnp.diag(p.system.model.observation_cov)))
    models = jax.vmap(
        lambda k: corner_system(replace(corner_of(CAR), stiffness=k), DT, jnp.asarray(1e-3), noise)
    )(jnp.asarray(ks))
    none = jax.tree.map(lambda _: None, p)
    by_run = replace(
        none, system=replace(none.system, model=jax.tree.map(lambda _: 0, p.system.model))
    )
    ys = LoadSample(*(jnp.asarray(np.stack([drive[2][:, i]] * 3)) for i in (0, 1)))
    found, _ = run_batch(
        OBSERVER.filter,
        OBSERVER.filter.init(unknown_before(), p),
        ys,
        replace(p, system=replace(p.system, model=models)),
        keep=keep,
        in_axes=(None, 0, by_run, None),
    )
    for r, k in enumerate(ks):
        single = estimate(drive[2], params(CAR._replace(k=k)))
        mean = np.stack([np.asarray(x[r]) for x in found.mean], 1)
        np.testing.assert_allclose(mean[2:], single[2:], rtol=1e-6, atol=1e-3)


def test_the_stated_covariance_is_the_spread_that_the_sensors_noise_makes():
    """Two white sensors through one low-pass, 256 runs: not that of three white signals."""
    rng = np.random.default_rng(4)
    p = params(acceleration_noise=0.08, deflection_noise=3e-4)
    ys = LoadSample(*(jnp.asarray(s * rng.normal(size=(256, SAMPLES))) for s in (0.08, 3e-4)))
    found, _ = run_batch(
        OBSERVER.filter, OBSERVER.filter.init(unknown_before(), p), ys, p, keep=keep
    )
    loads = np.stack([np.asarray(x)[:, 200:] for x in found.mean])
    spread = np.cov(loads.reshape(2, -1))
    ((first,), (side, second)) = (tuple(c[0, -1] for c in row) for row in found.cov)
    stated = np.array([[first, side], [side, second]])
    # 256 runs of some 30 independent stretches each
    np.testing.assert_allclose(spread, stated, rtol=0.06)


def test_single_precision(drive, float32):
    p = unbiased_params(corner_of(CAR, jnp.float32), DT, BANDWIDTH)
    y = LoadSample(*(jnp.asarray(drive[2][:, i], jnp.float32) for i in (0, 1)))
    found, _ = jax.jit(observe)(y, p)
    assert {x.dtype for x in jax.tree.leaves(found)} == {jnp.dtype("float32")}
    expected = shaped(drive[0] - 0.5 * DT)[200:, 0]
    np.testing.assert_allclose(found.mean.normal[200:], expected, atol=10.0)


def test_refusals_name_the_field():
    for field, changes in (
        ("dt", {"dt": 0.0}),
        ("bandwidth", {"bandwidth": 501.0}),
        ("walk", {"walk": -1.0}),
        ("sensors.deflection_noise", {"sensors": LoadSensors(deflection_noise=2.0)}),
    ):
        with pytest.raises(InputError) as refusal:
            unbiased_params(**({"corner": corner_of(CAR), "dt": DT} | changes))
        assert refusal.value.field == field


def test_lost_samples_widen_the_stated_sigma(drive):
    """Held deflections are doubted more and more, and trusted again behind the low-pass."""
    y = drive[2][:, :2].copy()
    y[150:200, 1] = np.nan
    p = params()
    ys = LoadSample(*(jnp.asarray(column) for column in y.T))
    found, missing = compiled(ys, p)
    sigma = np.sqrt(np.asarray(found.cov[0][0]))
    usual = float(p.load_cov[0, 0]) ** 0.5
    np.testing.assert_allclose(sigma[[140, -1]], usual, rtol=1e-2)
    assert sigma[199:203].max() > 3.0 * usual
    assert missing.sum() == 50


def test_perfect_sensors_make_no_noise():
    p = params(acceleration_noise=0.0, deflection_noise=0.0)
    assert not np.asarray(p.load_cov).any()
    one = params(acceleration_noise=0.0, deflection_noise=5e-4)
    assert 100.0 < float(one.load_cov[0, 0]) ** 0.5 < 3000.0
