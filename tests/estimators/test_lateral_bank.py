"""The Bayesian bank of lateral filters on drives simulated in NumPy with the filter's own noise."""

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

from tests.oracles import two_track_numpy as paper
from wheelhop.estimators.failure_modes import level_table, mode_names
from wheelhop.estimators.lateral import LateralSample
from wheelhop.estimators.lateral_bank import (
    CHANGE,
    bank_prior,
    bind_drive,
    lateral_bank,
    lateral_params,
    readings_and_inputs,
)
from wheelhop.estimators.lateral_model import (
    LATERAL_NOISE,
    LATERAL_PRIOR,
    LATERAL_WALK,
    LateralBelief,
    LateralTuning,
    lateral_model,
)
from wheelhop.filtering import dense, drive, extended, run_batch
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE, ArctangentTire
from wheelhop.vehicle.two_track import SOLMAZ_CAR, Wheels

DT, SAMPLES, SPEED = 0.02, 240, 80 / 3.6
NAMES = mode_names()
MODE = NAMES.index
TIRES = paper.combinations()
BANK = lateral_bank()

# amplitudes of the steer [rad] that give 2 m/s^2; of the sixteen, those stable at this speed
STEERS = {"none": 0.014, "FL": 0.02, "FR": 0.02, "FL+RR": 0.015, "RL": 0.0075, "RR": 0.008}


class Drive(NamedTuple):
    """Records [runs, time] and the states [runs, time, 7] behind them."""

    record: LateralSample
    state: np.ndarray


def motion(x, steer, tires, a_y):
    """Rates of side slip and yaw rate, and a_y, under the loads of that a_y; x is [7, runs]."""
    friction, heavier = np.exp(x[2]), np.exp(x[3])
    car = paper.CAR | {"m": paper.CAR["m"] * heavier, "J": paper.CAR["J"] * heavier}
    slips = paper.slip_angles(x[0], x[1], steer, SPEED, False, car) / friction[:, None]
    for _ in range(6):
        force = friction[:, None] * paper.forces(slips, paper.loads(a_y, car), tires)
        a_y = paper.lateral_acceleration(force, car)
    return np.stack([a_y / SPEED - x[1], paper.yaw_acceleration(force, car)]), a_y


def simulate(names, start, walk, seed):
    """A double lane change by Runge & Kutta's rule, every state walking as `walk` says."""
    rng = np.random.default_rng(seed)
    x, runs = np.array(start, float), len(names)
    tires = TIRES[[MODE(name) for name in names]]
    amplitude = np.array([STEERS[name] for name in names])
    a_y, states, seen = np.zeros(runs), [], []

    def steer(t):
        return amplitude * paper.double_lane_change(np.asarray(t), 1.0, 0.4, 2.0, 0.3)

    for t in DT * np.arange(SAMPLES):
        total = np.zeros((2, runs))
        slope = np.zeros((2, runs))
        for reach, share in ((0.0, 1), (0.5, 2), (0.5, 2), (1.0, 1)):
            at = np.concatenate([x[:2] + reach * DT * slope, x[2:]])
            slope, a_y = motion(at, steer(t + reach * DT), tires, a_y)
            total += share / 6 * slope
        x = x + np.sqrt(DT) * np.array(walk)[:, None] * rng.normal(size=x.shape)
        x[:2] += DT * total
        _, a_y = motion(x, steer(t + DT), tires, a_y)
        noise = np.array(LATERAL_NOISE)[:, None] * rng.normal(size=(2, runs))
        seen.append([steer(t + DT) + x[6], a_y + x[4] + noise[0], x[1] + x[5] + noise[1]])
        states.append(x)
    delta, acceleration, rate = np.moveaxis(np.array(seen), 0, -1)
    record = LateralSample(delta, np.full(delta.shape, SPEED), acceleration, rate)
    return Drive(record, np.array(states).transpose(2, 0, 1))


def truth(**components):
    """A state that drives straight ahead on the road and with the sensors of these components."""
    return list(LateralBelief(*[0.0] * 7)._replace(**components))


STRAIGHT = truth()
CASES = {
    **{name: (name, STRAIGHT) for name in ("none", "FL", "FR", "FL+RR", "RL", "RR")},
    "slippery": ("none", truth(ln_friction=np.log(0.5))),
    "heavy": ("none", truth(ln_mass=np.log(1.2))),
    "offsets": ("FL", truth(acceleration_bias=0.15, yaw_rate_bias=-0.008, steer_bias=0.002)),
}
MIRRORED, GAPS = len(CASES), len(CASES) + 1


def params(levels=(SOFT_TIRE, NOMINAL_TIRE), **options):
    return lateral_params(SOLMAZ_CAR, levels, DT, change=0.0, **options)


def keep(state, info):
    return state.log_probabilities, state.members, state.combined, info.flags


class Found(NamedTuple):
    """Of the bank: probabilities, mean and covariance of members and mixture; flags."""

    drive: Drive
    log_probabilities: np.ndarray
    members: tuple[Any, Any]
    combined: tuple[Any, Any]
    flags: Any


@cache
def bank():
    """Every case, then FL's record mirrored, then with gaps: one compiled batch."""
    names = [name for name, _ in CASES.values()]
    driven = simulate(names, np.array([start for _, start in CASES.values()]).T, [0.0] * 7, 0)
    assert np.all(np.abs(SPEED * driven.state[:, :, 1]).max(axis=1) < 2.9)
    fl = jax.tree.map(lambda a: a[list(CASES).index("FL")], driven.record)
    mirrored = fl._replace(
        steer=-fl.steer, lateral_acceleration=-fl.lateral_acceleration, yaw_rate=-fl.yaw_rate
    )
    gaps = jax.tree.map(np.copy, fl)
    for entry, begin, end in zip(gaps, (140, 145, 60, 85), (145, 200, 95, 100), strict=True):
        entry[begin:end] = np.nan
    record = jax.tree.map(
        lambda a, b, c: jnp.asarray(np.concatenate([a, [b], [c]])), driven.record, mirrored, gaps
    )
    y, u = readings_and_inputs(record)
    p = params()
    start = BANK.init(bank_prior(p), p)
    log, members, combined, flags = run_batch(
        BANK, start, y, p, inputs=u, bind=bind_drive, keep=keep
    )
    found = (tuple(map(np.asarray, dense(belief))) for belief in (members, combined))
    return Found(driven, np.asarray(log), *found, flags)


@pytest.mark.parametrize("case", CASES)
def test_the_true_combination_is_told(case):
    """At 2 m/s^2, whatever the road's friction, the load and the sensors' offsets."""
    p = np.exp(bank().log_probabilities[list(CASES).index(case)])
    assert NAMES[int(np.argmax(p[-1]))] == CASES[case][0]
    assert p[-1].max() > 0.9
    assert p[20].max() < 0.6  # before the first corner: the prior


@pytest.mark.parametrize(
    ("case", "component", "sharp"),
    [
        ("slippery", "ln_friction", 0.1),
        ("heavy", "ln_mass", 0.01),
        ("offsets", "acceleration_bias", 0.05),
        ("offsets", "yaw_rate_bias", 0.002),
        ("offsets", "steer_bias", 0.0005),
    ],
)
def test_road_load_and_offsets_are_found_within_their_stated_deviation(case, component, sharp):
    """By the mixture, and sharper than the prior."""
    found, run = bank(), list(CASES).index(case)
    k = LateralBelief._fields.index(component)
    error = found.combined[0][run, -1, k] - found.drive.state[run, -1, k]
    deviation = np.sqrt(found.combined[1][run, -1, k, k])
    assert deviation < sharp <= 0.5 * LATERAL_PRIOR[k]
    assert abs(error) < 3.0 * deviation
    assert abs(found.drive.state[run, -1, k]) > 4.0 * deviation


def test_the_mirrored_record_has_the_mirrored_hypotheses():
    order = [MODE(mirror_of(name)) for name in NAMES]
    found, run = bank(), list(CASES).index("FL")
    assert NAMES[int(np.argmax(found.log_probabilities[MIRRORED, -1]))] == "FR"
    np.testing.assert_allclose(
        found.log_probabilities[MIRRORED][:, order], found.log_probabilities[run], atol=1e-6
    )
    sign = np.array([-1.0, -1.0, 1.0, 1.0, -1.0, -1.0, -1.0])
    np.testing.assert_allclose(
        found.combined[0][MIRRORED], sign * found.combined[0][run], atol=1e-9
    )


def mirror_of(name):
    """FL+RR of FR+RL."""
    if name == "none":
        return name
    turned = [corner[0] + {"L": "R", "R": "L"}[corner[1]] for corner in name.split("+")]
    return "+".join(sorted(turned))


def test_gaps_are_bridged_and_told():
    found, run = bank(), GAPS
    expected = np.zeros(SAMPLES)
    expected[60:95] += 1
    expected[85:100] += 1
    expected[140:200] = 2  # without steer or speed a sample measures nothing
    np.testing.assert_array_equal(found.flags.missing[run], expected)
    assert not np.any(found.flags.nonfinite)
    assert not np.any(found.flags.lost_members)
    log = found.log_probabilities[run]
    np.testing.assert_allclose(log[85:95], log[[84] * 10], atol=1e-12)  # nothing was seen
    assert NAMES[int(np.argmax(log[-1]))] == "FL"


def consistency(walk, filter_walk, seed, runs=48):
    """NEES of side slip and yaw rate [runs, time] of the filter that knows the soft tyres."""
    prior = LATERAL_PRIOR._replace(side_slip=1e-3, yaw_rate=2e-3)
    rng = np.random.default_rng(seed)
    names = rng.choice(list(STEERS), runs)
    start = np.array(prior)[:, None] * rng.normal(size=(7, runs))
    driven = simulate(names, start, walk, seed)
    p = params(tuning=LateralTuning(prior=prior, walk=filter_walk))
    of_run = jnp.asarray([MODE(name) for name in names])
    members = jax.tree.map(lambda leaf: leaf[of_run], p.members)
    y, u = readings_and_inputs(jax.tree.map(jnp.asarray, driven.record))
    belief = run_batch(
        member(), bank_prior(p), y, members, inputs=u, bind=bind, keep=keep_state,
        in_axes=(None, 0, 0, 0),
    )  # fmt: skip
    mean, cov = map(np.asarray, dense(belief))
    error = (mean - driven.state)[..., :2]
    return np.einsum("rti,rtij,rtj->rt", error, np.linalg.inv(cov[..., :2, :2]), error)


@cache
def member():
    return extended(lateral_model())


def bind(p, u):
    return replace(p, drive=u)


def keep_state(state, info):
    del info
    return state


TIMES = np.arange(39, SAMPLES, 40)
LOUD = LATERAL_WALK._replace(side_slip=1e-3, yaw_rate=3e-3)


def test_nees_of_side_slip_and_yaw_rate_is_chi_square_with_the_vehicles_own_noise():
    """Truth and filter walk alike and truths come from the prior: 2 degrees of freedom a run, in
    the band that a chi-square sum of all runs leaves once in 5000 times."""
    nees = consistency(LOUD, LOUD, 0)
    runs = len(nees)
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], 2 * runs) / runs
    assert np.all((nees[:, TIMES].mean(axis=0) > low) & (nees[:, TIMES].mean(axis=0) < high))


def test_a_filter_with_more_noise_than_the_vehicle_is_on_the_safe_side():
    """A third of the noise: the mean lies below two, significantly, at every time."""
    quiet = jax.tree.map(lambda walk: walk / 3.0, LOUD)
    nees = consistency(quiet, LOUD, 1)
    runs = len(nees)
    assert np.all(nees[:, TIMES].mean(axis=0) < chi2.ppf(0.05, 2 * runs) / runs)


def test_by_default_a_vehicle_that_is_the_model_is_stated_too_well_by_at_most_two():
    """The default noise is small beside what offsets and the delay of the loads do."""
    nees = consistency(LATERAL_WALK, LATERAL_WALK, 2)
    assert np.all(nees[:, TIMES].mean(axis=0) < 4.0)


def test_three_levels_of_every_tyre_hold_the_two():
    """3^4 hypotheses: between those without the middle level, the odds of the sixteen."""
    middle = ArctangentTire(1.0, 5075.0, 13.5)
    table = level_table(3)
    kept = np.flatnonzero((table != 1).all(axis=1))
    prior = np.full(81, 1.0 / 81)
    prior[kept] = np.sum(prior[kept]) * np.asarray(params().prior)
    p = params((SOFT_TIRE, middle, NOMINAL_TIRE), prior=jnp.asarray(prior))
    assert jax.tree.leaves(p.members)[0].shape == (81,)
    samples = 60
    one = jax.tree.map(lambda a: jnp.asarray(a[0, :samples]), bank().drive.record)
    y, u = readings_and_inputs(one)
    log = jax.jit(
        lambda y, u: drive.run(
            BANK, BANK.init(bank_prior(p), p), y, p, inputs=u, bind=bind_drive, keep=keep
        )[0]
    )(y, u)
    assert log.shape == (samples, 81)
    np.testing.assert_allclose(np.exp(log).sum(axis=1), 1.0, atol=1e-12)
    odds = log[:, kept] - log[:, kept[-1:]]
    sixteen = bank().log_probabilities[0, :samples]
    np.testing.assert_allclose(odds, sixteen - sixteen[:, -1:], atol=1e-7)
    assert np.ptp(odds[-1]) > 1.0


def test_params_say_what_was_given():
    """Half the prior for the sound vehicle; the rate of changes per sample; all members alike."""
    p = lateral_params(SOLMAZ_CAR, (SOFT_TIRE, NOMINAL_TIRE), 0.01, temper=0.5)
    np.testing.assert_allclose(p.prior, [1 / 30] * 15 + [0.5], rtol=1e-12)
    assert p.change == pytest.approx(0.01 * CHANGE)
    assert p.temper == 0.5
    np.testing.assert_array_equal(p.members.car.mass, np.full(16, 1300.0))
    np.testing.assert_array_equal(p.members.tires.front_left.k2, [4500.0] * 8 + [5650.0] * 8)
    np.testing.assert_array_equal(p.members.tuning.noise.yaw_rate, np.full(16, 0.002))


def test_each_wheel_may_have_tyres_of_its_own():
    other = (ArctangentTire(1.0, 4000.0, 11.0), ArctangentTire(1.0, 6000.0, 16.0))
    ours = (SOFT_TIRE, NOMINAL_TIRE)
    p = lateral_params(SOLMAZ_CAR, Wheels(other, other, ours, ours), DT)
    assert set(np.asarray(p.members.tires.front_right.k2)) == {4000.0, 6000.0}
    assert set(np.asarray(p.members.tires.rear_right.k2)) == {4500.0, 5650.0}


def test_belief_before_the_first_sample_takes_the_roads_friction():
    start = bank_prior(params(), 0.5)
    mean, cov = dense(start)
    np.testing.assert_allclose(mean, truth(ln_friction=np.log(0.5)), atol=1e-15)
    np.testing.assert_allclose(cov, np.diag(np.square(LATERAL_PRIOR)), atol=1e-15)


def test_inputs_hold_what_is_missing_and_loads_come_one_sample_late():
    nan = np.nan
    sample = LateralSample(
        steer=np.array([[nan, 1.0, nan, nan, 2.0], [3.0, 4.0, 5.0, 6.0, nan]]),
        speed=np.array([[20.0, nan, 21.0, np.inf, 22.0], [nan, nan, nan, nan, 9.0]]),
        lateral_acceleration=np.array([[nan, 0.1, nan, 0.3, 0.4], [0.5, 0.6, 0.7, 0.8, 0.9]]),
        yaw_rate=np.array([[nan, 0.0, 0.1, nan, 0.2], [0.0, 0.1, 0.2, 0.3, 0.4]]),
    )
    y, u = readings_and_inputs(jax.tree.map(jnp.asarray, sample))
    known = np.isfinite(sample.steer) & np.isfinite(sample.speed)
    np.testing.assert_array_equal(known.sum(axis=1), [1, 0])
    for got, measured in zip(y, (sample.lateral_acceleration, sample.yaw_rate), strict=True):
        np.testing.assert_array_equal(got, np.where(known, measured, nan))
    np.testing.assert_array_equal(u.steer, [[1, 1, 1, 1, 2], [3, 4, 5, 6, 6]])
    np.testing.assert_array_equal(u.steer_before, [[1, 1, 1, 1, 1], [3, 3, 4, 5, 6]])
    np.testing.assert_array_equal(u.speed, [[20, 20, 21, 21, 22], [9, 9, 9, 9, 9]])
    expected = [[0.1, 0.1, 0.1, 0.1, 0.3], [0.5, 0.5, 0.6, 0.7, 0.8]]
    np.testing.assert_array_equal(u.load_acceleration, expected)


def test_inputs_of_one_interval_reach_every_member():
    p = params()
    _, u = readings_and_inputs(LateralSample(*(jnp.asarray([x]) for x in (0.01, 20.0, 1.0, 0.1))))
    bound = bind_drive(p, jax.tree.map(lambda a: a[0], u))
    np.testing.assert_array_equal(bound.members.drive.speed, np.full(16, 20.0))
    np.testing.assert_array_equal(bound.members.drive.load_acceleration, np.ones(16))
    assert bound.prior is p.prior
