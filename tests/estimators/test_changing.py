"""The IMM of RML filters: its modes, its reduction to one filter, what it follows and reports."""

from dataclasses import replace
from functools import lru_cache

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import wheelhop.filtering as wf
from wheelhop.errors import DivergenceError, InputError
from wheelhop.estimators import estimate, stiffness
from wheelhop.estimators.changing import (
    EXACT_CLASSES,
    ChangeTuning,
    bind_speed,
    changing_filter,
    changing_modes,
    changing_params,
    changing_prior,
    check_classes,
    validate_changes,
)
from wheelhop.estimators.estimate import estimate_pressure
from wheelhop.estimators.pressure_estimate import Kept
from wheelhop.estimators.stiffness import (
    CornerTheta,
    StiffnessTuning,
    read_theta,
    stiffness_filter,
    stiffness_params,
    stiffness_prior,
)
from wheelhop.filtering import drive
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import Tire

DT, SPEED, K_T = 0.002, 16.0, 220e3
STEPS, JUMP, AFTER = 600, 300, 250
CAR = QuarterCar(466.7, 61.14, Suspension(33.6e3, 0.0, 2400.0, 0.0), Tire(K_T, 250e3, 0.7))
ISO = dict(zip("ABCD", 1e-6 * 4.0 ** np.arange(4), strict=True))
"""Gd(1 rad/m) of ISO 8608: class A at 1e-6 m^3, four times as much from class to class."""
EVEN = np.full(STEPS, SPEED)
SURE = np.array([0.03, 1.6])
"""Prior sd of ln k_t and ln G once the filter has driven for a while."""


def simulate(seed, levels):
    """Accelerations of the linear car, exactly, on a road of level [time]."""
    m_s, m_u, s = 466.7, 61.14, CAR.suspension
    force = np.array([s.stiffness, 0.0, s.damping, -s.damping])
    tyre = np.array([0.0, K_T, 0.0, 0.0])
    a = np.array([[0, 0, 1, -1], [0, 0, 0, 1], -force / m_s, (force - tyre) / m_u])
    noise = np.zeros((4, 4))
    noise[1, 1] = np.pi * SPEED
    top = scipy.linalg.expm(DT * np.block([[-a, noise], [np.zeros((4, 4)), a.T]]))
    f = top[4:, 4:].T
    root = np.linalg.cholesky(f @ top[:4, 4:] + 1e-30 * np.eye(4))
    rng, x, ys = np.random.default_rng(seed), np.zeros(4), np.empty((len(levels), 2))
    for t, level in enumerate(levels):
        x = f @ x + np.sqrt(level) * root @ rng.normal(size=4)
        ys[t] = a[2:] @ x + 0.5 * rng.normal(size=2)
    return Accelerations(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


@lru_cache
def runner(filter):
    bind = bind_speed if filter is changing_filter(DT) else stiffness.bind_speed

    @jax.jit
    def run(ys, params, prior, speed):
        def keep(state, info):
            modes = getattr(state, "log_probabilities", jnp.zeros(1))
            return read_theta(state), jnp.exp(modes), info.log_likelihood, info.flags

        state = filter.init(prior, params)
        return drive.run(filter, state, ys, params, inputs=speed, bind=bind, keep=keep)

    return run


def certain(prior, sd=SURE):
    """The prior with another Gaussian of theta, about the true stiffness."""
    mean = CornerTheta(jnp.log(K_T), jnp.zeros(()))
    return prior._replace(theta=wf.independent(mean, CornerTheta(*map(jnp.asarray, sd))))


def padded(params):
    """With a mode more that nothing leads to, so that one compilation serves all tests."""
    members = jax.tree.map(lambda a: jnp.concatenate([a, a[:1]]), params.members)
    transition = np.eye(4)
    transition[:3, :3] = params.transition
    initial = np.append(params.initial, 0.0)
    return wf.InteractingParams(members, jnp.asarray(transition), jnp.asarray(initial))


def run(ys, changes=ChangeTuning(), classes=(), tuning=StiffnessTuning()):
    params = changing_params(CAR, SPEED, DT, tuning, changes, classes)
    prior = changing_prior(params, tuning, changes, classes)
    sd = [SURE[0], float(wf.standard_deviation(prior.theta).ln_level)]
    return runner(changing_filter(DT))(
        ys, params if classes else padded(params), certain(prior, sd), EVEN
    )


def run_single(ys, tuning=StiffnessTuning()):
    params = stiffness_params(CAR, SPEED, DT, tuning)
    prior = certain(stiffness_prior(params, tuning))
    return runner(stiffness_filter(DT))(ys, params, prior, EVEN)


@pytest.mark.parametrize("classes", ["", "B", "AD", "ABCD"])
@pytest.mark.parametrize("changes", [ChangeTuning(), EXACT_CLASSES], ids=["default", "exact"])
def test_modes_are_probabilities_with_the_mean_times_that_were_asked_for(classes, changes):
    modes = changing_modes(DT, StiffnessTuning(), changes, classes)
    n = len(modes.names)
    assert n == (2 * len(classes) or 3)
    assert {len(a) for a in modes[1:]} == {n}
    assert modes.transition.shape == (n, n)
    assert np.all(modes.transition >= 0)
    np.testing.assert_allclose(modes.transition.sum(1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(modes.initial.sum(), 1.0, rtol=1e-14)
    changing = np.array(["tyre changes" in name for name in modes.names])
    # mean time in a state that is left with probability p per step is dt / p
    into_tyre = modes.transition[:, changing].sum(1)
    np.testing.assert_allclose(DT / into_tyre[0], changes.tyre_every)
    np.testing.assert_allclose(DT / (1 - into_tyre[changing]), changes.tyre_lasts)
    np.testing.assert_array_equal(modes.stiffness_walks[changing], changes.tyre_walk)
    np.testing.assert_array_equal(modes.stiffness_walks[~changing], 0.005)
    if not classes:
        np.testing.assert_allclose(DT / modes.transition[0, 1], changes.road_every)
        np.testing.assert_allclose(DT / modes.transition[1, 0], changes.road_lasts)
        np.testing.assert_array_equal(modes.level_walks, [0.0, changes.road_walk, 0.0])
    else:
        np.testing.assert_allclose(modes.levels, np.repeat([ISO[c] for c in classes], 2))
        np.testing.assert_array_equal(modes.level_walks, 0.0)
        np.testing.assert_allclose(modes.initial.reshape(-1, 2).sum(1), 1 / len(classes))
        stays = modes.transition[0, :2].sum()
        expected = changes.road_every if len(classes) > 1 else np.inf
        with np.errstate(divide="ignore"):
            np.testing.assert_allclose(np.divide(DT, 1 - stays), expected, rtol=1e-9)


def test_parameters_hold_what_the_modes_say():
    tuning = StiffnessTuning(level_walk=0.02)
    params = changing_params(CAR, SPEED, DT, tuning)
    modes = changing_modes(DT, tuning)
    np.testing.assert_allclose(params.members.walk.ln_k_t, modes.stiffness_walks**2 * DT)
    np.testing.assert_allclose(params.members.walk.ln_level, modes.level_walks**2 * DT)
    np.testing.assert_array_equal(params.members.inner.speed, SPEED)
    faster = bind_speed(params, jnp.asarray(30.0))
    np.testing.assert_array_equal(faster.members.inner.speed, np.full(3, 30.0))
    chex.assert_trees_all_equal(faster.members.walk, params.members.walk)
    lanes = bind_speed(params, jnp.array([20.0, 25.0]))
    np.testing.assert_array_equal(lanes.members.inner.speed, np.tile([20.0, 25.0], (3, 1)))
    exact = changing_params(CAR, SPEED, DT, tuning, ChangeTuning(), "AC")
    np.testing.assert_allclose(exact.members.inner.level, [1e-6, 1e-6, 16e-6, 16e-6])
    prior = changing_prior(exact, tuning, ChangeTuning(), "AC")
    assert float(wf.standard_deviation(prior.theta).ln_level) == pytest.approx(0.02)


def test_modes_that_are_alike_are_one_filter():
    """A road and a tyre that change no faster than they wander anyway."""
    ys = simulate(0, np.full(STEPS, 4e-6))
    theta, _, log_likelihood, flags = run(ys, ChangeTuning(road_walk=0.0, tyre_walk=0.005))
    expected, _, expected_likelihood, _ = run_single(ys)
    chex.assert_trees_all_close(theta, expected, atol=1e-9)
    np.testing.assert_allclose(log_likelihood, expected_likelihood, atol=1e-8)
    assert not np.any(flags.nonfinite)


def test_the_modes_of_one_class_and_a_lasting_tyre_are_alike():
    tuning = StiffnessTuning(prior_level=ISO["B"])
    one = ChangeTuning(tyre_walk=tuning.stiffness_walk, class_sigma=1.6)
    params = changing_params(CAR, SPEED, DT, StiffnessTuning(), one, "B")
    single = stiffness_params(CAR, SPEED, DT, tuning)
    for k in range(2):
        member = jax.tree.map(lambda a, k=k: a[k], params.members)
        chex.assert_trees_all_close(member, single, rtol=1e-15)
    prior = changing_prior(params, StiffnessTuning(), one, "B")
    chex.assert_trees_all_close(prior, stiffness_prior(single, tuning), rtol=1e-15)


def test_a_jump_of_the_road_moves_its_level_and_not_the_tyre():
    """18 dB up and down within half a second, where a single filter is left behind."""
    levels = np.where(np.arange(STEPS) < JUMP, 1e-6, 64e-6)
    for course in (levels, levels[::-1]):
        ys = simulate(1, course)
        theta, probabilities, _, flags = run(ys)
        assert not np.any(flags.nonfinite)
        mean, cov = map(np.asarray, wf.dense(theta))
        ln_level = mean[:, 1] + np.log(StiffnessTuning().prior_level)
        sd = np.sqrt(cov[:, 1, 1])
        for t in (JUMP - 1, JUMP + AFTER):
            assert abs(ln_level[t] - np.log(course[t])) < 3.0 * sd[t] < 1.5
        assert np.max(np.asarray(probabilities)[JUMP : JUMP + 50, 1]) > 0.9
        assert np.max(np.abs(mean[JUMP:, 0] - mean[JUMP - 1, 0])) < 2.0 * SURE[0]
        np.testing.assert_allclose(np.sum(probabilities, 1), 1.0, atol=1e-12)

        alone, stated = (np.asarray(a)[JUMP + AFTER] for a in wf.dense(run_single(ys)[0]))
        behind = alone[1] + np.log(StiffnessTuning().prior_level) - np.log(course[JUMP + AFTER])
        assert abs(behind) > 3.0 * np.sqrt(stated[1, 1])


def test_exact_classes_are_told_apart():
    """Class A, then C: half a second after the start and after the change they are known."""
    levels = np.where(np.arange(STEPS) < JUMP, ISO["A"], ISO["C"])
    theta, probabilities, _, flags = run(simulate(2, levels), EXACT_CLASSES, "AC")
    of_class = np.asarray(probabilities).reshape(STEPS, 2, 2).sum(2)
    assert of_class[JUMP - 1, 0] > 0.95
    assert of_class[JUMP + AFTER, 1] > 0.95
    error = np.asarray(theta.mean.ln_k_t)[[JUMP - 1, JUMP + AFTER]] - np.log(K_T)
    assert np.all(np.abs(error) < 3.0 * np.sqrt(np.asarray(theta.cov[0][0])[[JUMP - 1, -1]]))
    assert not np.any(flags.nonfinite)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("road_every", 0.0),
        ("road_lasts", 1e-3),
        ("road_walk", -1.0),
        ("tyre_every", np.nan),
        ("tyre_lasts", 1e4),
        ("tyre_walk", 11.0),
        ("class_sigma", -0.1),
    ],
)
def test_changes_out_of_range_are_named(field, value):
    with pytest.raises(InputError) as caught:
        changing_params(CAR, SPEED, DT, changes=replace(ChangeTuning(), **{field: value}))
    assert caught.value.field == f"changes.{field}"
    assert validate_changes(EXACT_CLASSES) is EXACT_CLASSES


def test_classes_are_checked():
    assert check_classes("AD") == ("A", "D")
    with pytest.raises(InputError, match="Give each class once"):
        check_classes("AA")
    with pytest.raises(InputError):
        check_classes(("A", "Z"))


def test_a_sampling_interval_too_long_for_the_changes_is_refused():
    """At 50 Hz a road change of 10 ms would leave with probability 2."""
    for changes, field in (
        (ChangeTuning(road_lasts=0.01), "changes.road_lasts"),
        (ChangeTuning(tyre_lasts=0.01), "changes.tyre_lasts"),
    ):
        for classes in ("", "B"):
            if classes and field == "changes.road_lasts":
                continue  # a class has no time of its own to change in
            with pytest.raises(InputError) as caught:
                changing_modes(0.02, StiffnessTuning(), changes, classes)
            assert caught.value.field == field


@pytest.fixture(scope="module")
def record():
    """600 samples with a gap across the boundary of two chunks of 500; the speed varies."""
    ys = simulate(3, np.full(STEPS, 4e-6))
    a_u = np.array(ys.a_u)
    a_u[495:505] = np.nan
    t = DT * np.arange(1, STEPS + 1)
    return CornerRecord(t, np.array(ys.a_s), a_u, np.linspace(SPEED - 1.0, SPEED + 1.0, STEPS))


def test_an_estimate_is_the_filter_through_gaps_and_chunks(record):
    done = []
    found = estimate_pressure(record, CAR, on_progress=lambda *a: done.append(a))
    assert done == [(500, STEPS), (STEPS, STEPS)]
    params = changing_params(CAR, float(record.v[0]), DT)
    ys = Accelerations(jnp.asarray(record.a_s), jnp.asarray(record.a_u))
    theta, probabilities, _, flags = runner(changing_filter(DT))(
        ys, padded(params), changing_prior(params), jnp.asarray(record.v)
    )
    mean, cov = map(np.asarray, wf.dense(theta))
    np.testing.assert_array_equal(found.t, record.t)
    np.testing.assert_allclose(np.log(found.stiffness), mean[:, 0], atol=1e-8)
    sigma = found.stiffness * np.sqrt(cov[:, 0, 0])
    np.testing.assert_allclose(found.stiffness_sigma, sigma, rtol=1e-7)
    np.testing.assert_allclose(found.level, 8e-6 * np.exp(mean[:, 1]), rtol=1e-7)
    np.testing.assert_allclose(found.level_sigma, np.sqrt(cov[:, 1, 1]), rtol=1e-7)
    np.testing.assert_allclose(found.mode_probabilities, probabilities[:, :3], atol=1e-8)
    np.testing.assert_array_equal(found.missing, flags.missing)
    assert found.missing[495:505].sum() == found.missing.sum() == 10
    # k_t = 220 kN/m (1 + 0.7 (p - 250 kPa) / 250 kPa)
    pressure = 250e3 * (1.0 + (found.stiffness / K_T - 1.0) / 0.7)
    np.testing.assert_allclose(found.pressure, pressure, rtol=1e-12)
    np.testing.assert_allclose(found.pressure_sigma, 250e3 / (0.7 * K_T) * sigma, rtol=1e-7)


def test_leaving_the_finite_numbers_says_when(record):
    """An absurd sample of a log that nobody checked, in the second chunk."""
    a_u = record.a_u.copy()
    a_u[549] = 1e200
    with pytest.raises(DivergenceError, match=r"at t = 1\.1 s; check the log there"):
        estimate_pressure(replace(record, a_u=a_u), CAR)


def test_with_exact_classes_the_level_is_that_of_the_mixture(record, monkeypatch):
    """Mean and variance over modes A, A, C, C; the filter itself gives way to a made-up result."""
    every = np.ones(STEPS)
    kept = Kept(
        ln_k_t=12.0 * every,
        variance=0.01 * every,
        log_probabilities=np.log([0.2, 0.1, 0.6, 0.1]) * every[:, None],
        nis=every,
        missing=every,
        guarded=every,
        lost_members=every,
        nonfinite=every,
        ln_level=0.03 * every,
        level_variance=0.0004 * every,
    )
    monkeypatch.setattr(estimate, "filter_record", lambda *a, **k: kept)
    found = estimate_pressure(record, CAR, classes=("A", "C"))
    assert found.modes == ("A", "A, tyre changes", "C", "C, tyre changes")
    np.testing.assert_allclose(found.level, 1e-6 * 16.0**0.7 * np.exp(0.03), rtol=1e-12)
    sigma = np.sqrt(0.0004 + 0.3 * 0.7 * np.log(16.0) ** 2)
    np.testing.assert_allclose(found.level_sigma, sigma, rtol=1e-12)
