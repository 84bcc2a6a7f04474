"""The full vehicle on the road against balances, closed forms and its own symmetries."""

import math
from dataclasses import replace
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from tests.oracles.vehicle_numpy import energy, gravity, plain
from tests.vehicle.driving import (
    POINTS,
    SPACING,
    TIMES,
    arrays,
    coasting,
    flow,
    plant,
    rest,
    start,
    surroundings,
)
from wheelhop.staging import staged_jit
from wheelhop.vehicle.full_vehicle import Controls, derivative
from wheelhop.vehicle.full_vehicle_parameters import as_arrays, suv, with_tire
from wheelhop.vehicle.magic_formula import slip_stiffness
from wheelhop.vehicle.magic_formula_parameters import generic_passenger_tire
from wheelhop.vehicle.maneuver import Brake, double_lane_change
from wheelhop.vehicle.pressure_course import held
from wheelhop.vehicle.road.surface import flat_surface, surface_from_tracks
from wheelhop.vehicle.simulation import simulate_vehicle

G = 9.80665
NOMINAL = np.full(4, 250e3)
CAR = suv()
MASS = float(CAR.chassis.body_mass + CAR.chassis.wheel_mass.sum())


def rough(seed=1, height=0.004):
    """Four smooth random tracks, wavelengths above 1 m."""
    rng = np.random.default_rng(seed)
    x = SPACING * np.arange(POINTS)
    tracks = np.zeros((4, POINTS))
    for wave in (9.0, 4.0, 2.1, 1.3):
        for k in range(4):
            tracks[k] += (
                height * math.sqrt(wave / 9) * np.sin(2 * np.pi * (x / wave + rng.uniform()))
            )
    return tracks * np.clip(x / 5.0, 0, 1)


# ---- energy


def conservative(damping=0.0):
    damper = jax.tree.map(jnp.zeros_like, CAR.strut.damper)
    damper = replace(damper, damping=jnp.full(4, damping), knee=CAR.strut.damper.knee)
    vertical = replace(CAR.tire.vertical, damping=jnp.zeros(4))
    tire = replace(CAR.tire, vertical=vertical, rolling_resistance=jnp.zeros(4))
    return replace(
        CAR, strut=replace(CAR.strut, damper=damper), tire=tire, drag_area=jnp.asarray(0.0)
    )


def bounced(car, pressure, around):
    """Dropped with roll and pitch, rolling and yawing on ice: into the stops and off the road."""
    x = start(car, pressure, 10.0, around)
    return x._replace(
        z=x.z + 0.05, roll=x.roll + 0.04, pitch=x.pitch - 0.02, v_z=x.v_z - 0.6,
        p=jnp.asarray(0.8), r=jnp.asarray(0.5), compression_rate=jnp.asarray([0.5, -0.5, 0.3, 0.0]),
    )  # fmt: skip


def test_energy_is_conserved_without_dissipation():
    """Motion, weight on a grade, springs, stops, bars and tyres, 1 s long."""
    car, pressure, around = conservative(), np.array([250e3, 180e3, 220e3, 200e3]), surroundings(
        grade=0.05, bank=0.02, friction=0.0
    )  # fmt: skip
    down = gravity(0.05, 0.02)
    x = bounced(car, pressure, around)
    level = energy(start(car, pressure, 0.0, around), car, pressure, down)
    scale = energy(x, car, pressure, down) - level
    drift = {}
    for dt in (1e-3, 5e-4):
        end = flow(x, car, coasting(10.0), 1.0, dt, pressure, around)
        drift[dt] = abs(energy(end, car, pressure, down) - energy(x, car, pressure, down)) / scale
    assert np.abs(np.asarray(end.compression)).max() > 0.005
    assert drift[5e-4] < 1e-6, drift


def test_dampers_take_energy():
    around = surroundings(friction=0.0)
    down, car = gravity(0.0, 0.0), conservative(2500.0)
    x = bounced(car, NOMINAL, around)
    before = [energy(x, car, NOMINAL, down)]
    for _ in range(8):
        x = flow(x, car, coasting(10.0), 0.1, 1e-3, NOMINAL, around)
        before.append(energy(x, car, NOMINAL, down))
    assert np.all(np.diff(before) < 0)


# ---- integration


def flat(state):
    return np.concatenate([np.ravel(np.asarray(leaf, float)) for leaf in state])


def test_runge_kutta_has_its_order_on_a_smooth_maneuver():
    """And the default step of 0.5 ms leaves errors far below what sensors resolve."""
    x = start(CAR, NOMINAL, 25.0)
    x = x._replace(p=jnp.asarray(0.1), q=jnp.asarray(0.1), v_z=jnp.asarray(0.05))
    maneuver = coasting(25.0, 0.02 * np.sin(np.pi * TIMES))
    end = {
        dt: flat(flow(x, CAR, maneuver, 0.096, dt, NOMINAL)) for dt in (2e-3, 1e-3, 5e-4, 1.25e-4)
    }
    error = [np.linalg.norm(end[dt] - end[1.25e-4]) for dt in (2e-3, 1e-3, 5e-4)]
    for coarse, fine in pairwise(error):
        assert math.log2(coarse / fine) == pytest.approx(4.0, abs=0.35), error
    assert error[-1] < 1e-6


def test_the_default_step_resolves_a_rough_road():
    x, tracks = start(CAR, NOMINAL, 20.0), rough()
    end = {dt: flow(x, CAR, straight_on(), 1.5, dt, NOMINAL, tracks=tracks) for dt in (5e-4, 1e-4)}
    worst = jax.tree.map(lambda a, b: float(jnp.max(jnp.abs(a - b))), end[5e-4], end[1e-4])
    assert worst.compression < 1e-5, worst
    assert worst.compression_rate < 1e-3, worst
    assert worst.z < 1e-5, worst


def straight_on():
    return coasting(20.0, release=math.inf, follow=1.0)


def test_single_precision_follows_double_over_two_seconds_of_rough_road(request):
    tracks, maneuver = rough(), straight_on()
    x = start(CAR, NOMINAL, 20.0)
    exact = flow(x, CAR, maneuver, 2.0, 5e-4, NOMINAL, tracks=tracks)
    exact = jax.tree.map(np.asarray, exact)
    request.getfixturevalue("float32")
    lower = lambda tree: jax.tree.map(lambda leaf: np.asarray(leaf, np.float32), tree)  # noqa: E731
    single = flow(
        arrays(lower(x)), as_arrays(lower(CAR)), lower(maneuver), 2.0, 5e-4, lower(NOMINAL),
        around=arrays(lower(surroundings())), tracks=lower(tracks),
    )  # fmt: skip
    assert single.z.dtype == jnp.float32
    apart = {n: np.max(np.abs(np.asarray(getattr(single, n), float) - getattr(exact, n)))
             for n in exact._fields}  # fmt: skip
    assert apart["x"] < 2e-3, apart
    assert apart["z"] < 2e-5, apart
    assert apart["compression"].max() < 2e-5, apart
    assert apart["v_x"] < 2e-3, apart
    assert apart["compression_rate"].max() < 2e-3, apart
    assert apart["roll"] < 1e-5, apart


# ---- symmetry and standstill


def mirrored(x):
    swap = jnp.asarray([1, 0, 3, 2])
    four = {n: getattr(x, n)[swap] for n in ("compression", "compression_rate", "spin", "kappa")}
    odd = {n: -getattr(x, n) for n in ("y", "roll", "yaw", "v_y", "p", "r")}
    return x._replace(**four, **odd, tan_alpha=-x.tan_alpha[swap])


def test_mirrored_steering_and_road_give_the_mirrored_motion():
    x, tracks, angles = start(CAR, NOMINAL, 20.0), rough(), 0.05 * np.sin(2 * np.pi * TIMES / 1.9)
    left = flow(x, CAR, coasting(20.0, angles), 0.6, 1e-3, NOMINAL, tracks=tracks)
    right = flow(x, CAR, coasting(20.0, -angles), 0.6, 1e-3, NOMINAL, tracks=tracks[[1, 0, 3, 2]])
    assert abs(float(left.roll)) > 0.005
    assert abs(float(left.yaw)) > 0.02
    np.testing.assert_allclose(flat(mirrored(left)), flat(right), atol=1e-10)


def test_without_steering_the_car_runs_straight():
    tracks = np.repeat(rough()[:1], 4, axis=0)
    end = flow(start(CAR, NOMINAL, 20.0), CAR, coasting(20.0), 1.5, 1e-3, NOMINAL, tracks=tracks)
    for name in ("y", "roll", "yaw", "v_y", "p", "r"):
        assert abs(float(getattr(end, name))) < 1e-10, name


def test_a_car_braked_to_a_standstill_stays():
    maneuver = coasting(8.0, brake=Brake(3000.0, 0.1))
    x = start(CAR, NOMINAL, 8.0)
    stopped = flow(x, CAR, maneuver, 6.0, 1e-3, NOMINAL)
    later = flow(x, CAR, maneuver, 10.0, 1e-3, NOMINAL)
    # v^2 / 2a plus half the rise
    assert float(stopped.x) == pytest.approx(8.0 * 0.15 + 8.0**2 / (2 * 4.7), rel=0.06)
    assert abs(float(later.v_x)) < 1e-4
    assert abs(float(later.x - stopped.x)) < 1e-3
    assert abs(float(later.y)) < 1e-9


def test_brakes_hold_on_a_grade_but_for_a_creep():
    """Regularised brakes give way at the spin where their torque balances the weight."""
    grade = math.atan(0.2)
    around = surroundings(grade=grade)
    maneuver = coasting(0.0, brake=Brake(6000.0, -1.0))
    x = start(CAR, NOMINAL, 0.0, around)
    first = flow(x, CAR, maneuver, 3.0, 5e-4, NOMINAL, around)
    second = flow(x, CAR, maneuver, 5.0, 5e-4, NOMINAL, around)
    radius = 0.36 - np.mean(np.asarray(rest(CAR, NOMINAL, around).deflection))
    torque = MASS * G * math.sin(grade) * radius
    brake = 6000.0 * np.asarray(CAR.brake_share)
    width = 0.5 + 5e-4 * brake / np.asarray(CAR.chassis.spin_inertia)

    def lacking(spin):
        rolling = 0.01 * MASS * G * 0.35 * math.tanh(spin / 0.5)
        return np.sum(brake * np.tanh(spin / width)) + rolling - torque

    # the shares differ per axle, but all wheels creep alike
    creep = brentq(lacking, 0.0, 5.0)
    speed = float(first.x - second.x) / 2.0
    assert speed == pytest.approx(creep * 0.35, rel=0.03)
    assert speed < 0.1


@pytest.mark.parametrize("torque", [3000.0, 14000.0])
def test_a_stop_rocks_on_the_tires_and_ends(torque):
    """Also with locked wheels: what the tyres stored is a few centimetres, not metres."""
    maneuver = coasting(15.0, brake=Brake(torque, 0.1))
    end = 0.1 + 15.0 / (0.9 * min(torque / 0.35 / MASS, 10.0))
    x = start(CAR, NOMINAL, 15.0)
    later = flow(x, CAR, maneuver, end + 3.0, 5e-4, NOMINAL)
    last = flow(x, CAR, maneuver, end + 4.0, 5e-4, NOMINAL)
    assert abs(float(later.v_x)) < 2e-3
    assert abs(float(last.x - later.x)) < 1e-3


# ---- steady motion


@staged_jit
def _balance(unknown, base, car, pressure, around, speed, steer, share, deceleration):
    """What is left of the equations of a steady motion, and their Jacobian by columns."""
    zero = jnp.zeros_like(unknown[:4])

    def left(u):
        x = base._replace(
            z=u[0], roll=u[1], pitch=u[2], v_x=speed, v_y=u[3], v_z=u[4], p=u[5], q=u[6], r=u[7],
            compression=u[9:13], compression_rate=u[13:17], spin=u[17:21], kappa=u[21:25],
            tan_alpha=u[25:29],
        )  # fmt: skip
        controls = Controls(steer + zero, u[8] * share, zero)
        rate = derivative(x, controls, pressure, flat_surface(dtype=u.dtype), car, around)
        ahead, up = deceleration * jnp.cos(x.pitch), deceleration * jnp.sin(x.pitch)
        body = [rate.z, rate.roll, rate.pitch, rate.v_x + ahead, rate.v_y, rate.v_z + up]
        slowing = rate.spin + deceleration / speed * x.spin
        wheels = [rate.compression, rate.compression_rate, slowing, rate.kappa, rate.tan_alpha]
        return jnp.concatenate([jnp.stack([*body, rate.p, rate.q, rate.r]), *wheels])

    column = lambda tangent: jax.jvp(left, (unknown,), (tangent,))[1]  # noqa: E731
    return left(unknown), jax.lax.map(column, jnp.eye(29, dtype=unknown.dtype)).T


def steady(car, speed, steer=0.0, deceleration=0.0, share=None):
    """State, forces and torque of a steady turn or of braking at constant deceleration."""
    x, around = start(car, NOMINAL, speed), surroundings()
    front = jnp.asarray([1.0, 1.0, 0.0, 0.0]) * steer
    share = car.drive_share if share is None else jnp.asarray(share)
    u = jnp.concatenate([
        jnp.stack([x.z, x.roll, x.pitch]), jnp.zeros(4),
        jnp.asarray([speed * steer / 2.8, 0.0]), x.compression, x.compression_rate, x.spin,
        x.kappa, x.tan_alpha,
    ])  # fmt: skip
    scalars = [jnp.asarray(a) for a in (speed,)]
    for _ in range(20):
        residual, jacobian = _balance(
            u, x, car, jnp.asarray(NOMINAL), around, *scalars, front, share,
            jnp.asarray(deceleration),
        )  # fmt: skip
        if np.abs(residual).max() < 1e-9:
            break
        u = u - jnp.asarray(np.linalg.solve(np.asarray(jacobian), np.asarray(residual)))
    assert np.abs(residual).max() < 1e-7
    x = x._replace(
        z=u[0], roll=u[1], pitch=u[2], v_y=u[3], v_z=u[4], p=u[5], q=u[6], r=u[7],
        compression=u[9:13], compression_rate=u[13:17], spin=u[17:21], kappa=u[21:25],
        tan_alpha=u[25:29],
    )  # fmt: skip
    now, _ = plant(x, car, NOMINAL, around, steer=front, drive=u[8] * share)
    return x, now, float(u[8])


def bicycle(**tire):
    """No camber thrust, drag or rolling resistance; equal tracks."""
    slip = generic_passenger_tire(rated_load=5000.0, phy3=0.0, pvy3=0.0)
    car = with_tire(CAR, slip)
    axle = np.array([0.8, 0.8, 1.0, 1.0])
    car = replace(car, tire=replace(
        car.tire, slip=replace(car.tire.slip, lky=jnp.asarray(axle)),
        rolling_resistance=jnp.zeros(4),
    ))  # fmt: skip
    chassis = replace(car.chassis, rear_track=car.chassis.front_track)
    return replace(car, chassis=chassis, drag_area=jnp.asarray(0.0))


@pytest.mark.parametrize("speed", [15.0, 30.0])
def test_understeer_gradient_is_that_of_the_bicycle(speed):
    """delta = l/R + K a_y with K = m_f/C_f - m_r/C_r, at 0.03 g where tyres are linear."""
    car = bicycle()
    load = rest(car, NOMINAL).load
    _, lateral = slip_stiffness(load, jnp.asarray(NOMINAL), car.tire.slip)
    stiffness = -np.asarray(lateral)
    carried = np.asarray(load) / G
    gradient = carried[:2].sum() / stiffness[:2].sum() - carried[2:].sum() / stiffness[2:].sum()
    base = float(car.chassis.front_arm + car.chassis.rear_arm)
    steer = 0.3 * (base / speed**2 + gradient)
    x, _, _ = steady(car, speed, steer)
    rate = float(x.r)
    found = (steer - base * rate / speed) / (speed * rate)
    # half a percent: driving force on the steered axle, lean of the body
    assert found == pytest.approx(gradient, rel=0.01)
    assert gradient > 1e-3


def test_steady_cornering_transfers_load_by_height_and_roll_stiffness():
    """m a h / T, lean and gyroscopic moment in all.

    Each axle takes its share by the roll stiffness of strut, bar and tyre in series.
    """
    car = bicycle()
    x, now, _ = steady(car, 25.0, 0.016)
    load, c = np.asarray(now.forces.load), plain(car.chassis)
    a_y = float(x.r * x.v_x)
    assert 2.0 < a_y < 4.0
    track = float(c["front_track"])
    hub = float(x.z) + np.asarray(-c["hub_drop"])
    height = (c["body_mass"] * float(x.z) + c["wheel_mass"] @ hub) / MASS
    # the body leans out over its wheels, which stay above their contacts
    lean = c["body_mass"] * G * c["hub_drop"].mean() * abs(float(x.roll))
    total = 0.5 * np.array([load[1] - load[0], load[3] - load[2]])
    gyroscopic = np.sum(c["spin_inertia"] * np.asarray(x.spin)) * float(x.r)
    expected = (MASS * a_y * height + lean + gyroscopic) / track
    assert total.sum() == pytest.approx(expected, rel=5e-3)

    spring, t = np.asarray(car.strut.stiffness)[[0, 2]], 264.7e3
    bar = np.array([float(car.anti_roll.front), float(car.anti_roll.rear)])
    corner = 1 / (1 / (spring + 2 * bar) + 1 / t)
    share = corner / corner.sum()
    assert total[0] / total.sum() == pytest.approx(share[0], rel=0.02)
    # the axle's moment by its stiffness is the roll angle
    angle = total.sum() * track / (0.5 * track**2 * corner.sum())
    assert abs(float(x.roll)) == pytest.approx(angle, rel=0.02)


def test_braking_transfers_load_by_the_height_over_the_wheelbase():
    """m a h / l plus the moment of wheels that slow down, at 0.4 g."""
    car, a, speed = bicycle(), 4.0, 25.0
    x, now, torque = steady(car, speed, 0.0, a, car.brake_share)
    assert torque < 0
    load, c = np.asarray(now.forces.load), plain(car.chassis)
    hub = float(x.z) - c["hub_drop"] + np.asarray(x.compression)
    height = (c["body_mass"] * float(x.z) + c["wheel_mass"] @ hub) / MASS
    base = c["front_arm"] + c["rear_arm"]
    spun = np.sum(c["spin_inertia"] * np.asarray(x.spin)) * a / speed
    # the body moves forward over its wheels as it dives
    dive = c["body_mass"] * G * c["hub_drop"].mean() * float(x.pitch)
    shift = load[:2].sum() - np.asarray(rest(car, NOMINAL).load)[:2].sum()
    assert shift == pytest.approx((MASS * a * height + spun + dive) / base, rel=0.01)
    assert load.sum() == pytest.approx(MASS * G, rel=2e-3)
    assert -float(now.forces.longitudinal.sum()) == pytest.approx(MASS * a, rel=2e-3)


def test_the_driver_changes_lane_and_comes_back():
    """15 m/s, 0.3 g: within 0.35 m of the lane, level with it at the end."""
    maneuver = double_lane_change(15.0, 3.0, begin=0.2)
    maneuver = replace(maneuver, steer=coasting(15.0).steer)
    x = start(CAR, NOMINAL, 15.0)
    arc = maneuver.path.length / 15.0
    there = flow(x, CAR, maneuver, 0.2 + arc + 0.5, 1e-3, NOMINAL)
    assert float(there.y) == pytest.approx(3.5, abs=0.35)
    home = flow(x, CAR, maneuver, 0.2 + 2 * arc + 3.5, 1e-3, NOMINAL)
    assert float(home.y) == pytest.approx(0.0, abs=0.1)
    assert float(home.v_x) == pytest.approx(15.0, abs=0.2)


# ---- derivatives of a drive


def drive(parameters, rest_of, road, x):
    """RMS of wheel accelerations and the last attitude of 0.3 s with brakes and steering."""
    stiffness, damping, pressure, tire, grip = parameters
    car, maneuver, around = rest_of
    damper = replace(car.strut.damper, damping=damping)
    vertical = replace(car.tire.vertical, q_fz1=tire)
    slip = replace(car.tire.slip, lmux=grip, lmuy=grip)
    car = replace(
        car,
        strut=replace(car.strut, stiffness=stiffness, damper=damper),
        tire=replace(car.tire, vertical=vertical, slip=slip),
    )
    end, s = simulate_vehicle(x, car, maneuver, road, held(pressure), around, 150, 500.0, 2)
    vibration = jnp.sqrt(jnp.mean(s.wheel_acceleration**2))
    return vibration + 100.0 * end.roll + end.v_x + 1e-3 * s.load[-1, 2]


PARAMETERS = (
    CAR.strut.stiffness, CAR.strut.damper.damping, jnp.asarray(NOMINAL),
    CAR.tire.vertical.q_fz1, CAR.tire.slip.lmux,
)  # fmt: skip


def directions():
    """One direction per group of parameters, every wheel by its own amount."""
    weights = np.random.default_rng(2).uniform(0.5, 1.5, (5, 4))
    tangent = [jnp.asarray(w) * p for w, p in zip(weights, PARAMETERS, strict=True)]
    return [tuple(t if i == k else 0.0 * t for i, t in enumerate(tangent)) for k in range(5)]


def central(function, direction, h):
    """Central difference of a function of `PARAMETERS`."""
    moved = [
        float(function(tuple(p + s * t for p, t in zip(PARAMETERS, direction, strict=True))))
        for s in (h, -h)
    ]
    return (moved[0] - moved[1]) / (2 * h)


@pytest.mark.slow
def test_derivatives_of_a_drive_equal_central_differences():
    """Over 0.3 s, by springs, dampers, pressures, tyres and grip."""
    steer = 0.05 * np.sin(np.pi * TIMES)
    maneuver = arrays(coasting(20.0, steer, brake=Brake(4000.0, 0.0, 0.1)))
    road = surface_from_tracks(jnp.asarray(rough()), SPACING, -5.0)
    others = ((CAR, maneuver, surroundings()), road, start(CAR, NOMINAL, 20.0))
    forward = staged_jit(lambda p, t, *o: jax.jvp(lambda q: drive(q, *o), (p,), (t,)))
    for direction in directions():
        value = lambda p, d=direction: forward(p, d, *others)[0]  # noqa: E731
        slope = float(forward(PARAMETERS, direction, *others)[1])
        assert slope == pytest.approx(central(value, direction, 1e-5), rel=1e-5)
        assert abs(slope) > 1e-4


def test_reverse_mode_equals_central_differences():
    """Gradient of a weighted sum of the state's rates, two wheels of a turning car unlike."""
    x = start(CAR, NOMINAL, 20.0)
    x = x._replace(
        compression=x.compression + jnp.asarray([0.01, -0.02, 0.0, 0.065]), r=jnp.asarray(0.2),
        compression_rate=jnp.asarray([0.3, -0.2, 0.1, 0.0]), v_y=jnp.asarray(0.3),
        kappa=jnp.asarray([0.02, -0.05, 0.0, 0.1]), tan_alpha=jnp.asarray([0.05, 0.02, -0.1, 0.0]),
    )  # fmt: skip
    rng = np.random.default_rng(6)
    weight = jax.tree.map(lambda leaf: jnp.asarray(rng.uniform(0.5, 1.5, leaf.shape)), x)

    def total(parameters):
        stiffness, damping, pressure, tire, grip = parameters
        damper = replace(CAR.strut.damper, damping=damping)
        car = replace(CAR, strut=replace(CAR.strut, stiffness=stiffness, damper=damper))
        vertical = replace(CAR.tire.vertical, q_fz1=tire)
        slip = replace(CAR.tire.slip, lmux=grip, lmuy=grip)
        car = replace(car, tire=replace(CAR.tire, vertical=vertical, slip=slip))
        none = jnp.zeros(4)
        rate = derivative(
            x, Controls(none, none, none + 100.0), pressure, flat_surface(), car, surroundings()
        )
        return sum(jnp.sum(a * b) for a, b in zip(rate, weight, strict=True))

    both = jax.jit(jax.value_and_grad(total))
    gradient = both(PARAMETERS)[1]
    for k, direction in enumerate(directions()):
        slope = float(jnp.sum(gradient[k] * direction[k]))
        difference = central(lambda p: both(p)[0], direction, 1e-5)
        assert slope == pytest.approx(difference, rel=1e-6)
        assert abs(slope) > 1e-4
