"""Switched two-track models against the paper's equations, integrated and simulated in NumPy."""

from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import solve_continuous_lyapunov

from tests.oracles import two_track_numpy as paper
from wheelhop.errors import InputError
from wheelhop.estimators.failure_modes import level_table, mode_names, stacked_tires
from wheelhop.estimators.lateral import (
    LateralSample,
    SwitchedParams,
    SwitchTuning,
    switched,
    validate_tuning,
)
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE, ArctangentTire
from wheelhop.vehicle.two_track import SOLMAZ_CAR

DT, SAMPLES, ONSET = 0.01, 1500, 5.0
SPEED = 120 / 3.6
TIMES = DT * np.arange(1, SAMPLES + 1)
BANK = stacked_tires((SOFT_TIRE, NOMINAL_TIRE))
FL, NONE = 7, 15


class Run(NamedTuple):
    """After every sample."""

    state: Any
    info: Any


@cache
def bank(slip="observer", printed=False):
    """(record, params) -> trajectory, compiled once per number of models."""
    f = switched(slip, printed)

    @jax.jit
    def run(ys, params):
        def step(state, y):
            state, info = f.step(state, y, params)
            return state, (state, info)

        return Run(*jax.lax.scan(step, f.init(params), ys)[1])

    return run


def params_of(tires=BANK, dt=DT, car=SOLMAZ_CAR, **tuning):
    return SwitchedParams(car, tires, dt, SwitchTuning(**tuning))


@cache
def lane_change(mode=FL, printed=False, speed=SPEED, amplitude=0.02, onset=ONSET):
    """The paper's drive with the tyres of a mode, free of noise: record, true side slip."""
    straight = round(onset / DT)
    t = DT * np.arange(SAMPLES - straight + 1)
    steer = partial(paper.double_lane_change, amplitude=amplitude, begin=0.0)
    k = paper.combinations()[mode : mode + 1]
    beta, rate, a_y = paper.simulate(t, steer, speed, k, printed)
    late = lambda x: np.concatenate([np.zeros(straight), x[1:]])  # noqa: E731
    ys = LateralSample(late(steer(t)), np.full(SAMPLES, speed), late(a_y[0]), late(rate[0]))
    return ys, late(beta[0])


def turned(ys):
    """The mirrored record."""
    return LateralSample(-ys.steer, ys.speed, -ys.lateral_acceleration, -ys.yaw_rate)


def mirrored_modes():
    left_is_right = str.maketrans("LR", "RL")
    names = ["+".join(sorted(n.split("+"))) for n in mode_names()]

    def other(name):
        if name == "none":
            return name
        return "+".join(sorted(p[0] + p[1].translate(left_is_right) for p in name.split("+")))

    return [names.index(other(name)) for name in names]


def sizes(info, ys, a_scale=1.0, r_scale=1.0):
    """Norms of Eq. 12 [time, models]."""
    e_a = (ys.lateral_acceleration[:, None] - np.asarray(info.lateral_acceleration)) / a_scale
    e_r = (ys.yaw_rate[:, None] - np.asarray(info.yaw_rate)) / r_scale
    return np.hypot(e_a, e_r)


@pytest.mark.parametrize("printed", [False, True], ids=["mirrored", "printed"])
def test_integrated_slip_is_eq_5_10_and_11(printed):
    """Against cumulative integrals of the record; halving dt leaves a quarter of the rest."""
    rest = []
    for dt in (0.01, 0.005):
        t = dt * np.arange(SAMPLES + 1)
        delta, v = 0.03 * np.sin(1.3 * t) * np.sin(0.4 * t), 25.0 + 3.0 * np.sin(0.5 * t)
        a_y, rate = 2.0 * np.sin(1.2 * t) ** 3, 0.08 * np.sin(1.1 * t) ** 3
        found = bank("integrated", printed)(
            LateralSample(delta[1:], v[1:], a_y[1:], rate[1:]), params_of(dt=dt)
        )
        beta, rates, accelerations = paper.integrated_bank(
            t, delta, v, a_y, rate, paper.combinations(), printed
        )
        wide = np.broadcast_to(beta[1:, None], (SAMPLES, 16))
        np.testing.assert_allclose(found.state.side_slip, wide, atol=1e-13)
        np.testing.assert_allclose(found.info.lateral_acceleration, accelerations[1:], atol=1e-10)
        within = round(SAMPLES / 2 * 0.01 / dt)
        rest.append(abs(found.info.yaw_rate - rates[1:])[:within].max())
    assert rest[0] < 1e-4 * abs(rates).max()
    assert rest[1] < 0.3 * rest[0]


def test_the_observer_is_its_differential_equation():
    """Vehicle and observers integrated together by SciPy; the sensors are read every dt."""
    modes, gains = [FL, 10, NONE], (0.5, 1.0)
    k = paper.combinations()[[FL, *modes]]
    steer = lambda t: 0.015 * np.sin(2.5 * t)  # noqa: E731

    def sensed(t, x):
        force = paper.balanced_forces(paper.slip_angles(*x, steer(t), SPEED, False), k[0])
        return force, (steer(t), SPEED, paper.lateral_acceleration(force), x[1])

    def slope(t, x):
        beta, rate = x.reshape(2, 4)
        force, measured = sensed(t, (beta[0], rate[0]))
        true = measured[2] / SPEED - rate[0], paper.yaw_acceleration(force)
        led = paper.observer_slope(beta[1:], rate[1:], measured, k[1:], gains)
        return np.concatenate([[true[0]], led[0], [true[1]], led[1]])

    end = 6.0
    dense = solve_ivp(slope, (0.0, end), np.zeros(8), "DOP853", dense_output=True, rtol=1e-8).sol
    errors = []
    for dt in (0.01, 0.005):
        t = np.minimum(dt * np.arange(1, SAMPLES + 1), end)
        x = dense(t)
        _, (_, _, a_y, rate) = sensed(t, (x[0], x[4]))
        ys = LateralSample(steer(t), np.full(SAMPLES, SPEED), a_y, rate)
        found = bank()(ys, params_of(dt=dt)).state
        both = np.stack([found.side_slip, found.yaw_rate])[:, :, modes]
        error = abs(both - x.reshape(2, 4, -1)[:, 1:].transpose(0, 2, 1))
        errors.append(error[:, : round(end / dt)].max())
    assert errors[0] < 2e-4
    assert errors[1] < 0.3 * errors[0]


def test_cost_is_eq_13_by_quadrature():
    """Led by nothing and steering nothing the models stand still: the errors are the record."""
    a_y = lambda t: np.sin(1.7 * t) * np.exp(-0.1 * t)  # noqa: E731
    rate = lambda t: 0.3 * t * np.exp(-0.4 * t)  # noqa: E731
    zero = np.zeros(SAMPLES)
    ys = LateralSample(zero, zero + SPEED, a_y(TIMES), rate(TIMES))
    weights, scales = (0.7, 1.9, 0.35), (0.5, 0.2)
    params = params_of(
        **dict(zip(("instantaneous", "cumulative", "forgetting"), weights, strict=True)),
        **dict(zip(("acceleration_scale", "yaw_rate_scale"), scales, strict=True)),
        side_slip_gain=0.0,
        yaw_rate_gain=0.0,
    )
    info = bank()(ys, params).info
    assert abs(info.lateral_acceleration).max() == abs(info.yaw_rate).max() == 0.0
    size = lambda t: np.hypot(a_y(t) / scales[0], rate(t) / scales[1])  # noqa: E731
    for n in (1, 400, SAMPLES):
        end = TIMES[n - 1]
        integral = quad(lambda s: np.exp(-weights[2] * (end - s)) * size(s), 0, end, limit=200)[0]  # noqa: B023
        expected = weights[0] * size(end) + weights[1] * integral
        np.testing.assert_allclose(info.cost[n - 1], expected, rtol=1e-4)


def test_the_recursion_loses_nothing_of_the_integral():
    """Against the whole record summed anew, for every model, over time constants of forgetting."""
    ys, _ = lane_change()
    for forgetting in (0.0, 2.0):
        info = bank()(ys, params_of(forgetting=forgetting)).info
        size, t = sizes(info, ys), np.concatenate([[0.0], TIMES])
        size = np.concatenate([np.zeros((1, 16)), size])
        for n in (510, 900, SAMPLES):
            expected = paper.cost(t[: n + 1], size[: n + 1], 1.0, 1.0, forgetting)
            np.testing.assert_allclose(info.cost[n - 1], expected, rtol=1e-11)


def test_cornering_stiffness_is_eq_15_of_the_model_selected():
    ys, _ = lane_change()
    found = bank()(ys, params_of())
    state, info = found
    for n in (520, 600, 800, 1100):
        chosen = int(info.selected[n])
        x = (np.asarray(state.side_slip)[n, chosen], np.asarray(state.yaw_rate)[n, chosen])
        alpha = paper.slip_angles(*x, ys.steer[n], SPEED, False)
        load = paper.loads(ys.lateral_acceleration[n])
        expected = paper.forces(alpha, load, paper.combinations()[chosen]) / alpha
        np.testing.assert_allclose([c[n] for c in info.cornering_stiffness], expected, rtol=1e-9)
    # straight: the slope of the force at no slip, under the loads at rest
    k, rest = np.array([paper.NOMINAL] * 4), paper.loads(0.0)
    slope = (k[:, 0] - rest / k[:, 1]) * rest * k[:, 2]
    np.testing.assert_allclose([c[100] for c in info.cornering_stiffness], slope, rtol=1e-6)


def linear_observer(gains, car=paper.CAR, softening=1.0):
    """A and B of the observer's error (side slip, yaw rate) under biases (a_y, yaw rate), by hand:
    Eq. 1 with forces -C (beta + l_v r / v) and -C (beta - l_h r / v), sound tyres at rest."""
    k, rest, v = np.array([paper.NOMINAL] * 4), paper.loads(0.0, car), SPEED
    each = (k[:, 0] - rest / k[:, 1]) * rest * k[:, 2] * softening
    front, rear = each[:2].sum(), each[2:].sum()
    arms = car["lh"] * rear - car["lv"] * front
    damping = car["lv"] ** 2 * front + car["lh"] ** 2 * rear
    force = np.array([-(front + rear), arms / v]) / (car["m"] * v)
    a = np.array(
        [
            (1.0 - gains[0]) * force - [0.0, 1.0],
            np.array([arms, -damping / v]) / car["J"] - [0.0, gains[1]],
        ]
    )
    return a, np.array([[gains[0] / v, 0.0], [0.0, gains[1]]])


@pytest.mark.parametrize("gains", [(0.5, 1.0), (0.9, 1.0), (0.5, 20.0), (0.0, 1.0)])
def test_biased_sensors_move_the_observer_to_a_standing_error(gains):
    """Straight on, for a minute: -A^-1 B bias; for a neutral car and a biased accelerometer
    that is gain / (1 - gain) bias m / C."""
    zero = np.zeros(SAMPLES)
    neutral = paper.CAR | {"lv": 1.25, "lh": 1.25}
    for car, bias in ((paper.CAR, (0.01, 0.0004)), (neutral, (0.01, 0.0))):
        ours = replace(SOLMAZ_CAR, front_arm=car["lv"], rear_arm=car["lh"])
        ys = LateralSample(zero, zero + SPEED, zero + bias[0], zero + bias[1])
        params = params_of(dt=0.04, car=ours, side_slip_gain=gains[0], yaw_rate_gain=gains[1])
        state = bank()(ys, params).state
        a, b = linear_observer(gains, car)
        by_hand = -np.linalg.solve(a, b @ bias)
        found = np.array([state.side_slip[-1, NONE], state.yaw_rate[-1, NONE]])
        np.testing.assert_allclose(found, by_hand, rtol=2e-3, atol=1e-9)
        if car is neutral:
            stiffness = 4 * (1 - 1300 * paper.G / 4 / 5650) * 1300 * paper.G / 4 * 15
            standing = gains[0] / (1 - gains[0]) * bias[0] * 1300 / stiffness
            assert by_hand[0] == pytest.approx(standing, rel=1e-12)


def test_the_integral_drifts_with_the_bias():
    """beta - b t / v of the accelerometer and - b t of the gyroscope, whatever the drive."""
    ys, true = lane_change()
    biased = ys._replace(
        lateral_acceleration=ys.lateral_acceleration + 0.1, yaw_rate=ys.yaw_rate - 0.001
    )
    found = bank("integrated")(biased, params_of()).state.side_slip[:, FL]
    np.testing.assert_allclose(found - true, (0.1 / SPEED + 0.001) * TIMES, atol=3e-5)


def test_the_observer_stays_with_the_truth_where_the_integral_leaves_it():
    """Bound of the right model's error: biases through the linear error's impulse response, of
    tyres as soft as at the largest slip, and five sigma of the noise through its covariance."""
    ys, true = lane_change()
    bias, noise = np.array([0.1, -0.003]), np.array([0.05, 0.002])
    drawn = noise[:, None] * np.random.default_rng(0).standard_normal((2, SAMPLES))
    sensed = ys._replace(
        lateral_acceleration=ys.lateral_acceleration + bias[0] + drawn[0],
        yaw_rate=ys.yaw_rate + bias[1] + drawn[1],
    )
    worst_slip = abs(paper.slip_angles(true, ys.yaw_rate, ys.steer, SPEED, False)).max()
    a, b = linear_observer((0.5, 1.0), softening=1 / (1 + (15 * worst_slip) ** 2))
    t = np.linspace(0.0, 8.0, 4001)
    values, vectors = np.linalg.eig(a)
    assert values.real.max() < -1.0
    modal = vectors[0] * np.linalg.solve(vectors, b).T
    response = (modal[:, :, None] * np.exp(values[:, None] * t)).sum(1).real
    by_bias = np.trapezoid(abs(response), t, axis=-1) @ abs(bias)
    q = b @ np.diag(noise**2 * DT) @ b.T
    by_noise = 5.0 * np.sqrt(solve_continuous_lyapunov(a, -q)[0, 0])
    observer = abs(np.asarray(bank()(sensed, params_of()).state.side_slip)[:, FL] - true)
    assert 0.1 * (by_bias + by_noise) < observer.max() < by_bias + by_noise
    integral = abs(
        np.asarray(bank("integrated")(sensed, params_of()).state.side_slip)[:, FL] - true
    )
    assert integral[-1] > 20.0 * observer.max()
    assert integral[-1] > 5.0 * (by_bias + by_noise)


@pytest.mark.parametrize(
    ("plant_printed", "slip", "printed"),
    [(True, "integrated", True), (False, "integrated", False), (False, "observer", False)],
    ids=["as printed", "integrated", "observer"],
)
def test_the_papers_drive_selects_model_8_within_a_second(plant_printed, slip, printed):
    """Solmaz, Fig. 7: 120 km/h, front left soft, steering from 5 s; to the end of the drive."""
    ys, true = lane_change(printed=plant_printed)
    assert 1.0 < abs(ys.lateral_acceleration).max() < 4.0
    found = bank(slip, printed)(ys, params_of())
    selected = np.asarray(found.info.selected)
    assert (selected[TIMES <= ONSET] == NONE).all()
    assert (selected[TIMES > ONSET + 1.0] == FL).all()
    assert abs(found.state.side_slip[:, FL] - true).max() < 2e-4
    cost = np.asarray(found.info.cost)[-1]
    assert cost[FL] < 0.01 * np.delete(cost, FL).min()
    assert mode_names()[FL] == "FL"


def test_every_combination_of_soft_tires_is_told():
    """At 40 km/h: at 120 the models with soft rear tyres are above their critical speed."""
    t = DT * np.arange(SAMPLES + 1)
    steer = partial(paper.double_lane_change, amplitude=0.05, begin=2.0)
    speed = 40 / 3.6
    _, rate, a_y = paper.simulate(t, steer, speed, paper.combinations())
    told = []
    for mode in range(16):
        ys = LateralSample(steer(t)[1:], np.full(SAMPLES, speed), a_y[mode][1:], rate[mode][1:])
        info = bank()(ys, params_of()).info
        told.append(int(info.selected[-1]))
        assert int(info.selected[round(3.0 / DT)]) == mode
    assert told == list(range(16))


def test_sixteen_models_at_once_are_sixteen_alone():
    ys, _ = lane_change()
    together = bank()(ys, params_of())
    for mode in range(16):
        own = jax.tree.map(lambda leaf, m=mode: leaf[m : m + 1], BANK)
        alone = bank()(ys, params_of(own))
        for name in ("cost", "lateral_acceleration", "yaw_rate"):
            found, expected = getattr(alone.info, name)[:, 0], getattr(together.info, name)[:, mode]
            np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)
        assert (alone.info.selected == 0).all()


@pytest.mark.parametrize("levels", [3, 4])
def test_more_levels_hold_the_sixteen(levels):
    """The same costs where all tyres are softest or sound, and the same tyre is told."""
    between = [ArctangentTire(1.0, 4900.0, 13.0), ArctangentTire(1.0, 5300.0, 14.0)]
    tires = stacked_tires([SOFT_TIRE, *between[: levels - 2], NOMINAL_TIRE])
    ys, _ = lane_change()
    turning = slice(450, 700)  # straight before, where all models stand still
    two, more = (
        bank()(jax.tree.map(lambda leaf: leaf[turning], ys), params_of(each)).info
        for each in (BANK, tires)
    )
    table = level_table(levels)
    kept = np.flatnonzero(np.isin(table, (0, levels - 1)).all(axis=1))
    assert more.cost.shape == (250, levels**4)
    np.testing.assert_allclose(more.cost[:, kept], two.cost, rtol=1e-10, atol=1e-12)
    told = mode_names(levels)[int(more.selected[-1])]
    assert told == "FL0"
    assert int(two.selected[-1]) == FL


@pytest.mark.parametrize("slip", ["observer", "integrated"])
def test_a_mirrored_record_selects_the_mirrored_model(slip):
    ys, _ = lane_change()
    one, other = (bank(slip)(y, params_of()).info for y in (ys, turned(ys)))
    swap = mirrored_modes()
    assert (mode_names()[FL], mode_names()[swap[FL]]) == ("FL", "FR")
    np.testing.assert_allclose(np.asarray(other.cost)[:, swap], one.cost, rtol=1e-9, atol=1e-12)
    turning = TIMES > ONSET + 0.5
    np.testing.assert_array_equal(np.asarray(swap)[one.selected][turning], other.selected[turning])


def test_the_printed_equations_cost_left_and_right_turns_differently():
    ys, _ = lane_change()
    cost = [
        np.asarray(bank("integrated", True)(y, params_of()).info.cost)[-1] for y in (ys, turned(ys))
    ]
    right = cost[1][mirrored_modes()]
    assert abs(right[FL] - cost[0][FL]) > 0.1 * cost[0][FL]


def noisy(ys, seed=1):
    rng = np.random.default_rng(seed)
    return ys._replace(
        lateral_acceleration=ys.lateral_acceleration + 0.05 * rng.standard_normal(SAMPLES),
        yaw_rate=ys.yaw_rate + 0.002 * rng.standard_normal(SAMPLES),
    )


def test_a_model_is_left_only_for_one_cheaper_by_the_hysteresis():
    ys = noisy(lane_change()[0])
    switches = []
    for share in (0.0, 0.2, 0.6):
        info = bank()(ys, params_of(hysteresis=share)).info
        cost, selected = np.asarray(info.cost), np.asarray(info.selected)
        held = np.concatenate([[NONE], selected[:-1]])
        cheaper = cost.min(axis=1) < (1.0 - share) * cost[np.arange(SAMPLES), held]
        np.testing.assert_array_equal(selected, np.where(cheaper, cost.argmin(axis=1), held))
        switches.append(int((selected != held).sum()))
    assert switches[0] > 3 * switches[1] > 0
    assert selected[-1] == FL


@pytest.mark.parametrize("name", LateralSample._fields)
def test_a_missing_sensor_costs_nothing_and_leaks_nothing(name):
    """Gaps straight, in the turns, of one sample and of half a second; at the first sample too."""
    ys, _ = lane_change()
    gone = np.zeros(SAMPLES, bool)
    for start, stop in ((0, 3), (200, 260), (520, 521), (600, 650), (900, 910)):
        gone[start:stop] = True
    broken = getattr(ys, name).copy()
    broken[gone] = [(np.nan, np.inf, -np.inf)[i % 3] for i in range(gone.sum())]
    found = bank()(ys._replace(**{name: broken}), params_of(forgetting=0.3))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
    info = found.info
    np.testing.assert_array_equal(info.missing, gone.astype(int))
    size = np.where(gone[:, None], 0.0, sizes(info, ys))
    t, size = np.concatenate([[0.0], TIMES]), np.concatenate([np.zeros((1, 16)), size])
    for n in (521, 625, 1000):
        expected = paper.cost(t[: n + 1], size[: n + 1], 1.0, 1.0, 0.3)
        np.testing.assert_allclose(info.cost[n - 1], expected, rtol=1e-10, atol=1e-13)
    selected = np.asarray(info.selected)
    held = np.concatenate([[NONE], selected[:-1]])
    np.testing.assert_array_equal(selected[gone], held[gone])
    assert selected[-1] == FL


def test_several_missing_sensors_are_counted():
    ys = [np.full(SAMPLES, np.nan)] * 4
    info = bank()(LateralSample(*ys), params_of()).info
    assert (info.missing == 4).all()
    assert (info.cost == 0.0).all()
    assert (info.selected == NONE).all()


@pytest.mark.parametrize("slip", ["observer", "integrated"])
def test_a_record_whose_speed_comes_late_is_not_integrated_before(slip):
    """The side slip there is what no speed can tell."""
    zero = np.zeros(SAMPLES)
    speed = np.where(np.arange(SAMPLES) < 20, np.nan, 30.0)
    ys = LateralSample(zero, speed, zero + 2.0, zero + 2.0 / 30.0)
    state = bank(slip)(ys, params_of()).state
    assert abs(state.side_slip[19]).max() < 0.01


@pytest.mark.parametrize("slip", ["observer", "integrated"])
def test_a_car_that_stands_leaves_the_models_finite(slip):
    ys, _ = lane_change()
    speed = np.where(TIMES < 2.0, 0.0, SPEED)
    found = bank(slip)(ys._replace(speed=speed), params_of())
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
    assert int(found.info.selected[-1]) == FL


def test_overloaded_tires_of_the_selected_model_are_counted():
    """Straight on, a_y of a wall of wind: beyond 3.8 m/s^2 a soft front tyre, then the others."""
    zero = np.zeros(SAMPLES)
    a_y = np.linspace(0.0, 12.0, SAMPLES)
    ys = LateralSample(zero, zero + SPEED, a_y, zero)
    own = jax.tree.map(lambda leaf: leaf[FL : FL + 1], BANK)
    info = bank()(ys, params_of(own)).info
    load, k = paper.loads(a_y), paper.combinations()[FL]
    expected = ((load < 0.0) | (load > k[:, 0] * k[:, 1])).sum(axis=-1)
    assert set(expected) >= {0, 1, 2}
    np.testing.assert_array_equal(info.overloaded, expected)


def test_a_rolling_body_that_is_known_changes_nothing():
    """An accelerometer that shows 6 % more, told to all: the same states, cost per its scale."""
    ys, _ = lane_change()
    shown = ys._replace(lateral_acceleration=1.06 * ys.lateral_acceleration)
    one = bank()(ys, params_of())
    other = bank()(
        shown, params_of(car=replace(SOLMAZ_CAR, roll_gain=0.06), acceleration_scale=1.06)
    )
    np.testing.assert_allclose(other.state.side_slip, one.state.side_slip, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(other.info.cost, one.info.cost, rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(
        other.info.lateral_acceleration, 1.06 * one.info.lateral_acceleration, atol=1e-11
    )


def test_float32_selects_the_same(float32):
    with jax.enable_x64(True):
        exact = bank()(lane_change()[0], params_of()).info
    ys, params = jax.tree.map(
        lambda leaf: jnp.asarray(leaf, jnp.float32), (lane_change()[0], params_of())
    )
    found = bank()(ys, params).info
    assert found.cost.dtype == jnp.float32
    turning = TIMES > ONSET + 0.5
    np.testing.assert_array_equal(found.selected[turning], exact.selected[turning])
    np.testing.assert_allclose(found.cost, exact.cost, rtol=1e-3, atol=2e-3)


def test_costs_have_finite_gradients_in_the_tires():
    """Straight and without an error, too, where the norm of Eq. 12 has a corner; and in a gap."""
    f, ys = switched(), lane_change()[0]
    states = bank()(ys, params_of()).state

    @jax.jit
    @jax.grad
    def slopes(tires, state, y):
        return f.step(state, y, params_of(tires))[1].cost.sum()

    for n, gone in ((0, False), (100, False), (560, False), (560, True)):
        state, y = (jax.tree.map(lambda leaf, n=n: leaf[n], tree) for tree in (states, ys))
        found = slopes(BANK, state, y._replace(steer=np.nan) if gone else y)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))
        moved = max(abs(leaf).max() for leaf in jax.tree.leaves(found))
        assert (moved > 0.0) == (n == 560 and not gone)


def test_an_unknown_side_slip_is_refused():
    with pytest.raises(InputError, match="slip: 'guess' is unknown"):
        switched("guess")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("instantaneous", -1.0),
        ("cumulative", np.nan),
        ("forgetting", -0.1),
        ("hysteresis", 1.0),
        ("side_slip_gain", 1.1),
        ("yaw_rate_gain", -1.0),
        ("acceleration_scale", 0.0),
        ("yaw_rate_scale", np.inf),
    ],
)
def test_a_bad_tuning_is_named(name, value):
    assert validate_tuning(SwitchTuning()) == SwitchTuning()
    with pytest.raises(InputError, match=rf"tuning\.{name}"):
        validate_tuning(SwitchTuning(**{name: value}))


def test_a_cost_of_nothing_is_refused():
    with pytest.raises(InputError, match="both weights"):
        validate_tuning(SwitchTuning(instantaneous=0.0, cumulative=0.0))
