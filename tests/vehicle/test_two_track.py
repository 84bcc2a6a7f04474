"""The two-track model against the paper's equations in NumPy, its mirror image, and balances."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles import two_track_numpy as paper
from wheelhop.errors import InputError
from wheelhop.vehicle.lateral_tire import MAGIC_FORMULA, ArctangentTire, InflatedTire
from wheelhop.vehicle.magic_formula_parameters import generic_passenger_tire
from wheelhop.vehicle.two_track import (
    SOLMAZ_CAR,
    LateralState,
    Steering,
    Wheels,
    balanced_motion,
    lateral_motion,
    slip_angles,
    validate,
    wheel_angles,
    wheel_loads,
    yaw_gain,
)

COUNT = 200
PRINTED = pytest.mark.parametrize("printed", [False, True], ids=["mirrored", "printed"])
motion = partial(jax.jit, static_argnames=("printed", "law"))(lateral_motion)


def columns(found):
    return np.stack([np.asarray(x) for x in found], axis=-1)


def tires_of(k):
    """`Wheels` of tyres from rows [..., 4, 3]."""
    return Wheels(*(ArctangentTire(*np.moveaxis(k[..., i, :], -1, 0)) for i in range(4)))


def random_cases(seed=0, slip=0.1, rate=0.8, spread=0.2):
    """States, steering and tyres of every kind; turns, states and side slips both ways."""
    rng = np.random.default_rng(seed)
    x = LateralState(rng.uniform(-slip, slip, COUNT), rng.uniform(-rate, rate, COUNT))
    u = Steering(rng.uniform(-slip, slip, COUNT), rng.uniform(8.0, 50.0, COUNT))
    k = paper.combinations()[rng.integers(0, 16, COUNT)]
    k = k * rng.uniform(1.0 - spread, 1.0 + spread, k.shape)
    return x, u, k


def mirrored(x):
    return type(x)(*(-entry for entry in x))


def exchanged(wheels):
    return Wheels(wheels.front_right, wheels.front_left, wheels.rear_right, wheels.rear_left)


def test_solmaz_car_is_the_papers():
    car, oracle = SOLMAZ_CAR, paper.CAR
    assert (car.mass, car.yaw_inertia, car.track, car.height) == (1300.0, 1200.0, 1.5, 0.7)
    assert (car.front_arm, car.rear_arm) == (oracle["lv"], oracle["lh"])


def test_loads_are_eq_7():
    a_y = np.linspace(-20.0, 20.0, 41)
    found = columns(wheel_loads(a_y, SOLMAZ_CAR))
    np.testing.assert_allclose(found, paper.loads(a_y), rtol=1e-12, atol=1e-9)
    assert (found < 0.0).any()


@pytest.mark.parametrize("share", [None, 0.0, 0.35, 1.0])
def test_loads_carry_the_weight_and_balance_the_roll_moment(share):
    """Whatever the shares: sum m g, moment about the track's middle m h a_y, axles keep theirs."""
    car = replace(SOLMAZ_CAR, front_transfer=share)
    a_y = np.linspace(-15.0, 15.0, 13)
    load = wheel_loads(a_y, car)
    weight = 1300.0 * paper.G
    front, rear = load.front_left + load.front_right, load.rear_left + load.rear_right
    np.testing.assert_allclose(front + rear, weight, rtol=1e-13)
    np.testing.assert_allclose(front * 1.2, rear * 1.3, rtol=1e-12)
    moved = load.front_right - load.front_left, load.rear_right - load.rear_left
    np.testing.assert_allclose(0.75 * (moved[0] + moved[1]), 1300.0 * 0.7 * a_y, atol=1e-9)
    expected = 1.3 / 2.5 if share is None else share
    np.testing.assert_allclose(0.75 * moved[0], expected * 1300.0 * 0.7 * a_y, atol=1e-9)


@PRINTED
def test_wheel_angles_are_eq_2(printed):
    delta = np.linspace(-0.5, 0.5, 21)
    inner, outer = paper.steer_angles(delta)
    if not printed:
        inner = np.sign(delta) * paper.steer_angles(abs(delta))[0]
        outer = np.sign(delta) * paper.steer_angles(abs(delta))[1]
    left, right = wheel_angles(delta, SOLMAZ_CAR, printed)
    np.testing.assert_allclose(left, np.where(delta > 0, inner, outer), rtol=1e-13, atol=1e-16)
    np.testing.assert_allclose(right, np.where(delta > 0, outer, inner), rtol=1e-13, atol=1e-16)


@PRINTED
def test_slip_angles_are_eq_8_and_9(printed):
    x, u, _ = random_cases()
    found = columns(slip_angles(x, u, SOLMAZ_CAR, printed))
    expected = paper.slip_angles(*x, *u, printed)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)


@PRINTED
@pytest.mark.parametrize("seed", [1, 2])
def test_motion_is_eq_1_3_7_and_11(printed, seed):
    """Measured accelerations far beyond what the tyres give: lifted and overloaded wheels too."""
    x, u, k = random_cases(seed)
    a_y = np.random.default_rng(seed).uniform(-12.0, 12.0, COUNT)
    found = motion(x, u, wheel_loads(a_y, SOLMAZ_CAR), tires_of(k), SOLMAZ_CAR, printed=printed)
    force = paper.forces(paper.slip_angles(*x, *u, printed), paper.loads(a_y), k)
    assert (force == 0.0).any(axis=-1).sum() > 20
    np.testing.assert_allclose(columns(found.force), force, rtol=1e-11, atol=1e-9)
    acceleration = paper.lateral_acceleration(force)
    np.testing.assert_allclose(found.lateral_acceleration, acceleration, rtol=1e-11, atol=1e-11)
    rate = acceleration / u.speed - x.yaw_rate
    np.testing.assert_allclose(found.side_slip_rate, rate, rtol=1e-11, atol=1e-11)
    turn = paper.yaw_acceleration(force)
    np.testing.assert_allclose(found.yaw_acceleration, turn, rtol=1e-11, atol=1e-10)


def test_motion_balances_forces_and_moments():
    x, u, k = random_cases(3)
    found = motion(x, u, wheel_loads(np.full(COUNT, 1.5), SOLMAZ_CAR), tires_of(k), SOLMAZ_CAR)
    force = columns(found.force)
    np.testing.assert_allclose(1300.0 * found.lateral_acceleration, force.sum(-1), rtol=1e-12)
    along = u.speed * (found.side_slip_rate + x.yaw_rate)
    np.testing.assert_allclose(along, found.lateral_acceleration, rtol=1e-9, atol=1e-12)
    moment = force @ [1.2, 1.2, -1.3, -1.3]
    np.testing.assert_allclose(1200.0 * found.yaw_acceleration, moment, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("law", ["arctangent", "magic"])
def test_a_right_turn_is_the_mirror_image_of_a_left_turn(law):
    """The same numbers with the other sign, on the other side, to rounding."""
    x, u, k = random_cases(4)
    a_y = np.random.default_rng(4).uniform(-9.0, 9.0, COUNT)
    tires, options = tires_of(k), {}
    if law == "magic":
        slip = generic_passenger_tire(ppy1=-0.4)
        tires = Wheels(*(InflatedTire(slip, p) for p in (120e3, 250e3, 180e3, 260e3)))
        options = {"law": MAGIC_FORMULA}
    one = motion(x, u, wheel_loads(a_y, SOLMAZ_CAR), tires, SOLMAZ_CAR, **options)
    other = motion(
        mirrored(x),
        Steering(-u.steer, u.speed),
        wheel_loads(-a_y, SOLMAZ_CAR),
        exchanged(tires),
        SOLMAZ_CAR,
        **options,
    )
    for name in ("side_slip_rate", "yaw_acceleration", "lateral_acceleration"):
        np.testing.assert_allclose(
            getattr(other, name), -getattr(one, name), rtol=1e-12, atol=1e-12
        )
    for name in ("force", "slip_angle"):
        np.testing.assert_allclose(
            columns(exchanged(getattr(other, name))),
            -columns(getattr(one, name)),
            rtol=1e-12,
            atol=1e-9,
        )
    np.testing.assert_array_equal(columns(exchanged(other.load)), columns(one.load))


def test_the_printed_equations_break_the_mirror_by_what_they_misprint():
    """Both fronts steer wrong by delta^2 T / L; each side's arctangent takes the other's speed."""
    x, u, _ = random_cases(5)
    left = Steering(abs(u.steer), u.speed)
    one = columns(slip_angles(x, left, SOLMAZ_CAR, True))
    np.testing.assert_array_equal(one, columns(slip_angles(x, left, SOLMAZ_CAR)))
    right = Steering(-left.steer, u.speed)
    other = -columns(exchanged(slip_angles(mirrored(x), right, SOLMAZ_CAR, True)))
    error = other - one
    steer = left.steer**2 * 1.5 / 2.5
    slow, fast = u.speed - 0.75 * x.yaw_rate, u.speed + 0.75 * x.yaw_rate
    front = u.speed * x.side_slip + 1.2 * x.yaw_rate
    rear = u.speed * x.side_slip - 1.3 * x.yaw_rate
    front, rear = (np.arctan(a / slow) - np.arctan(a / fast) for a in (front, rear))
    expected = np.stack([front - steer, steer - front, rear, -rear], axis=-1)
    np.testing.assert_allclose(error, expected, atol=1e-14)
    assert abs(error[:, 0]).max() > 1e-3


def test_the_inner_wheel_steers_more_and_runs_slower():
    """In a right turn the printed equations say the opposite."""
    x, u = LateralState(0.0, -0.3), Steering(-0.05, 20.0)
    for printed in (False, True):
        left, right = wheel_angles(u.steer, SOLMAZ_CAR, printed)
        assert (abs(float(right)) > abs(float(left))) is not printed
        rear = slip_angles(x, u, SOLMAZ_CAR, printed)
        # the slower wheel's arctangent is the larger
        assert (abs(float(rear.rear_right)) > abs(float(rear.rear_left))) is not printed


def test_balanced_motion_solves_its_own_loads():
    """Against the root of the quadratic. The worst are unequal sides, hard in a turn."""
    rng = np.random.default_rng(6)
    k = paper.combinations()[rng.integers(0, 16, COUNT)]
    speed, rate = rng.uniform(10.0, 40.0, COUNT), rng.uniform(-0.2, 0.2, COUNT)
    front, rear = np.sort(rng.uniform(-0.06, 0.06, COUNT)) + rng.uniform(-0.01, 0.01, (2, COUNT))
    beta = 1.3 * rate / speed - rear
    x, u = LateralState(beta, rate), Steering(front + beta + 1.2 * rate / speed, speed)
    force = paper.balanced_forces(paper.slip_angles(*x, *u, False), k)
    expected = paper.lateral_acceleration(force)
    assert abs(expected).max() > 2.5
    balanced = jax.jit(balanced_motion, static_argnames="iterations")
    worst = []
    for rounds in (3, 8):
        found = balanced(x, u, tires_of(k), SOLMAZ_CAR, iterations=rounds)
        error = abs(np.asarray(found.lateral_acceleration) - expected) / abs(expected)
        worst.append(error.max())
    assert error[abs(expected) < 2.0].max() < 1e-6
    assert worst[1] < min(1e-4, 0.1 * worst[0])
    np.testing.assert_allclose(columns(found.load), paper.loads(expected), rtol=1e-4)


def axle_stiffnesses(k, car):
    """Slopes of Eq. 3 at rest, by hand."""
    rest = paper.loads(0.0, car)
    each = (k[:, 0] - rest / k[:, 1]) * rest * k[:, 2]
    return each[:2].sum(), each[2:].sum()


@jax.jit
def settled(speed, steer, tires, car):
    """Yaw rate after twenty seconds of constant steer, by Heun's rule."""

    def slope(x):
        found = balanced_motion(x, Steering(steer, speed), tires, car, iterations=3)
        return found.side_slip_rate, found.yaw_acceleration

    def step(x, _):
        first = slope(x)
        second = slope(LateralState(*(a + 0.005 * b for a, b in zip(x, first, strict=True))))
        rates = zip(x, first, second, strict=True)
        return LateralState(*(a + 0.0025 * (b + c) for a, b, c in rates)), None

    start = LateralState(jnp.zeros_like(speed), jnp.zeros_like(speed))
    return jax.lax.scan(step, start, None, length=4000)[0].yaw_rate


@pytest.mark.parametrize("case", ["understeer", "neutral", "oversteer", "one soft"])
def test_a_constant_steer_settles_at_the_yaw_gain(case):
    """The model's long-time limit at a microradian: unequal tyres bend it in its first power."""
    k, arms = np.array([paper.NOMINAL] * 4), (1.2, 1.3)
    if case == "neutral":
        arms = (1.25, 1.25)
    elif case == "oversteer":
        k, arms = np.array([paper.NOMINAL] * 2 + [(1.0, 5650.0, 13.5)] * 2), (1.2, 1.3)
    elif case == "one soft":
        k = np.array([paper.SOFT] + [paper.NOMINAL] * 3)
    car = paper.CAR | {"lv": arms[0], "lh": arms[1]}
    front, rear = axle_stiffnesses(k, car)
    excess = arms[1] * rear - arms[0] * front
    assert np.sign(excess) == {"neutral": 0, "oversteer": -1}.get(case, 1)
    ours = replace(SOLMAZ_CAR, front_arm=arms[0], rear_arm=arms[1])
    speed = np.array([5.0, 15.0, 25.0])
    gain = yaw_gain(speed, front, rear, ours)
    every = jax.tree.map(lambda leaf: np.full(3, leaf), (tires_of(k), ours))
    found = settled(speed, np.full(3, 1e-6), *every) / 1e-6
    np.testing.assert_allclose(found, gain, rtol=1e-5)
    if case == "neutral":
        np.testing.assert_allclose(gain, speed / 2.5, rtol=1e-14)


def test_yaw_gain_peaks_at_the_characteristic_speed_and_diverges_at_the_critical():
    """Understeer: sqrt(L / K), where the gain is half of neutral; oversteer: sqrt(-L / K)."""
    front, rear = 40e3, 45e3
    k = 1300.0 * (1.3 * rear - 1.2 * front) / (front * rear * 2.5)
    v = np.sqrt(2.5 / k)
    gain = np.asarray(yaw_gain(np.array([0.99, 1.0, 1.01]) * v, front, rear, SOLMAZ_CAR))
    assert gain[1] == pytest.approx(v / 5.0, rel=1e-12)
    assert gain[1] > max(gain[0], gain[2])
    rear = 33e3
    critical = np.sqrt(2.5 / (1300.0 * (1.2 * front - 1.3 * rear) / (front * rear * 2.5)))
    assert float(yaw_gain(0.9999 * critical, front, rear, SOLMAZ_CAR)) > 1e4
    assert float(yaw_gain(1.0001 * critical, front, rear, SOLMAZ_CAR)) < -1e4


def test_gradients_are_finite_with_lifted_wheels_and_at_rest():
    def total(x, u, a_y, tires, car, friction):
        found = lateral_motion(x, u, wheel_loads(a_y, car), tires, car, friction)
        return found.side_slip_rate + found.yaw_acceleration

    k, car = paper.combinations()[7], replace(SOLMAZ_CAR, front_transfer=0.6)
    slopes = jax.jit(jax.grad(total, argnums=range(6)))
    for state, a_y in (((0.0, 0.0), 0.0), ((0.05, 0.3), 14.0), ((0.0, -0.3), -4.0)):
        found = slopes(LateralState(*state), Steering(0.0, 20.0), a_y, tires_of(k), car, 0.5)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(found))


def test_float32_is_close_to_float64(float32):
    x, u, k = random_cases(7)
    x, u, tires, load = jax.tree.map(
        lambda leaf: jnp.asarray(leaf, jnp.float32),
        (x, u, tires_of(k), wheel_loads(np.full(COUNT, 2.0), SOLMAZ_CAR)),
    )
    found = motion(x, u, load, tires, SOLMAZ_CAR)
    assert found.lateral_acceleration.dtype == jnp.float32
    force = paper.forces(paper.slip_angles(*x, *u, False), columns(load), k)
    error = found.lateral_acceleration - paper.lateral_acceleration(force)
    assert abs(np.asarray(error)).max() < 2e-5


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mass", 0.0),
        ("yaw_inertia", -1200.0),
        ("front_arm", np.nan),
        ("rear_arm", 1300.0),
        ("track", 0.0),
        ("height", -0.1),
        ("roll_gain", 2.0),
        ("front_transfer", 1.01),
    ],
)
def test_a_bad_parameter_is_named(name, value):
    assert validate(SOLMAZ_CAR) is SOLMAZ_CAR
    with pytest.raises(InputError, match=rf"two_track\.{name}"):
        validate(replace(SOLMAZ_CAR, **{name: value}))
