"""The full vehicle against a multibody simulator with force laws of its own."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from tests.oracles import magic_formula_numpy
from tests.oracles.mujoco_vehicle import (
    CAR,
    GRAVITY,
    FrictionlessTires,
    Initial,
    MagicFormulaTires,
    Vehicle,
    at_rest,
    gravity,
    simulate,
)
from wheelhop.staging import staged_jit
from wheelhop.vehicle.curve import curve
from wheelhop.vehicle.full_vehicle import derivative, evaluate
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.full_vehicle_state import Controls, Surroundings, VehicleState
from wheelhop.vehicle.magic_formula_parameters import generic_passenger_tire
from wheelhop.vehicle.maneuver import Brake, Maneuver
from wheelhop.vehicle.pressure_course import held
from wheelhop.vehicle.road.surface import surface_from_grid
from wheelhop.vehicle.simulation import simulate_vehicle
from wheelhop.vehicle.vehicle_design import as_arrays, with_tire

ROWS = 60.0
"""Lateral places of the two rows of the roads [m]: both sides of the track."""


def test_the_oracle_falls_freely():
    """Nothing but weight: all parts move alike, on a grade and bank too."""
    none = (0.0,) * 4
    car = {**CAR, "preload": none, "stiffness": none, "cubic_stiffness": none, "drag": 0.0}
    car |= {"antiroll": (0.0, 0.0), "grade": 0.05, "bank": 0.03}
    start = at_rest(car, 20.0)._replace(
        position=np.array([0.0, 0.0, 50.0]), roll_pitch_yaw=np.array([0.1, 0.2, 0.3])
    )
    found = simulate(car, start, duration=0.1)
    expected = np.arange(101)[:, None] ** 2 * 0.5e-6 * gravity(car)
    fall = found["position"] - found["position"][0]
    travel = fall[1] - expected[1]
    np.testing.assert_allclose(fall, expected + np.arange(101)[:, None] * travel, atol=1e-12)
    np.testing.assert_allclose(found["compression"], 0.0, atol=1e-14)


def test_the_oracle_rests_on_its_weight():
    """Wheel loads of a car at rest, from moments about the axles of the level car."""
    found = simulate(CAR, at_rest(CAR), duration=3.0, dt=2e-3)
    pitch = found["roll_pitch_yaw"][-1, 1]
    long, mass = CAR["a"] + CAR["b"], CAR["sprung_mass"]
    shift = CAR["hub_drop"][0] * math.sin(pitch)  # of the body's weight, nose down
    front = GRAVITY * (mass * (CAR["b"] + shift) / long / 2 + CAR["wheel_mass"][0])
    rear = GRAVITY * (mass * (CAR["a"] - shift) / long / 2 + CAR["wheel_mass"][2])
    assert found["wheel_load"][-1] == pytest.approx([front, front, rear, rear], rel=1e-4)
    assert np.abs(found["v"][-1]).max() < 1e-3


def conservative():
    none = (0.0,) * 4
    car = {**CAR, "damping": none, "quadratic_damping": none, "vertical_damping": 0.0}
    car |= {"drag": 0.0, "rolling_resistance": 0.0, "q_Fz2": 40.0, "product_xz": 60.0}
    return car | {"pressure": (2.2e5, 2.5e5, 2.6e5, 2.4e5)}


def potential(car, found):
    """Weight, struts, bars and tyres; no stop is reached."""
    s, rho = found["compression"], np.maximum(found["tire_deflection"], 0.0)
    k, k3 = np.array(car["stiffness"]), np.array(car["cubic_stiffness"])
    strut = np.array(car["preload"]) * s + k * s**2 / 2 + k3 * s**4 / 4
    bars = np.array(car["antiroll"]) * (s[:, 0::2] - s[:, 1::2]) ** 2 / 2
    excess = np.array(car["pressure"]) / car["nominal_pressure"] - 1
    x = rho / car["radius"]
    tires = (1 + car["p_Fz1"] * excess) * car["nominal_load"] * car["radius"]
    tires = tires * (car["q_Fz1"] * x**2 / 2 + car["q_Fz2"] * x**3 / 3)
    return strut.sum(1) + bars.sum(1) + tires.sum(1)


def test_the_oracle_keeps_its_energy():
    """Tumbling gently on an inclined plane without damping or friction, wheels spinning."""
    car = conservative()
    start = at_rest(car, 2.0)
    start = start._replace(
        position=start.position + np.array([0.0, 0.0, -0.005]),
        roll_pitch_yaw=np.array([0.003, 0.002, 0.3]),
        w=np.array([0.02, 0.02, 0.3]),
        compression=np.array([0.002, -0.002, 0.001, -0.002]),
        spin=np.array([5.0, 6.0, 7.0, 4.0]),
    )
    slope = np.full(4, 0.003), np.full(4, -0.002)
    road = lambda x, y: (0.003 * x - 0.002 * y, *slope)  # noqa: E731
    drift = []
    for dt in (2e-3, 1e-3):
        vehicle = Vehicle(car, road=road, tires=FrictionlessTires(), dt=dt)
        found = vehicle.run(start, round(1.0 / dt), energy=True)
        assert found["wheel_load"].min() > 100.0
        assert np.abs(found["compression"]).max() < 0.06
        total = found["energy"].sum(1) + potential(car, found)
        drift.append(np.abs(total - total[0]).max())
        assert np.ptp(found["energy"][:, 1]) > 50.0
    assert drift[1] < 1e-3
    assert drift[0] / drift[1] > 12.0  # fourth order


def test_the_oracle_turns_in_balance():
    """In a steady turn, tyre forces are mass times speed times yaw rate."""
    ahead = np.array([1.0, 1.0, 0.0, 0.0])
    controls = lambda t: (0.02 * ahead, np.full(4, 60.0), np.zeros(4))  # noqa: E731
    found = simulate(CAR, at_rest(CAR, 20.0), controls, duration=4.0, dt=2e-3)
    total = CAR["sprung_mass"] + sum(CAR["wheel_mass"])
    rate = np.linalg.norm(found["v"][-1, :2]) * found["w"][-1, 2]
    sideways = np.linalg.norm(found["force"][-1, :2].sum(1))
    assert rate > 1.5
    assert sideways == pytest.approx(total * rate, rel=0.01)
    # the outer wheels carry the roll moment
    assert found["wheel_load"][-1, 1] > found["wheel_load"][-1, 0] + 500.0


def numbers(vehicle, pressure, grade=0.0, bank=0.0, density=1.2):
    """The plant's parameters as the oracle's plain numbers."""
    four = lambda a: tuple(np.broadcast_to(np.asarray(a, float), 4).tolist())  # noqa: E731
    c, s, v = vehicle.chassis, vehicle.strut, vehicle.tire.vertical
    one = lambda a: float(np.ravel(a)[0])  # noqa: E731
    return {
        "sprung_mass": float(c.body_mass),
        "inertia": (float(c.roll_inertia), float(c.pitch_inertia), float(c.yaw_inertia)),
        "product_xz": float(c.roll_yaw_product),
        "a": float(c.front_arm),
        "b": float(c.rear_arm),
        "track": (float(c.front_track), float(c.rear_track)),
        "hub_drop": four(c.hub_drop),
        "wheel_mass": four(c.wheel_mass),
        "spin_inertia": four(c.spin_inertia),
        "diametral_inertia": four(c.diametral_inertia),
        "preload": four(s.preload),
        "stiffness": four(s.stiffness),
        "cubic_stiffness": four(s.cubic_stiffness),
        "damping": four(s.damper.damping),
        "asymmetry": four(s.damper.asymmetry),
        "asymmetry_velocity": four(s.damper.knee),
        "saturation": four(s.damper.digression),
        "quadratic_damping": four(s.damper.quadratic),
        "bump_gap": four(s.bump_clearance),
        "rebound_gap": four(s.rebound_clearance),
        "stop_curve": (tuple(np.asarray(s.stop.x)), tuple(np.asarray(s.stop.y))),
        "antiroll": (float(vehicle.anti_roll.front), float(vehicle.anti_roll.rear)),
        "radius": one(v.unloaded_radius),
        "nominal_load": one(v.rated_load),
        "nominal_velocity": one(v.reference_speed),
        "nominal_pressure": one(v.nominal_pressure),
        "pressure": four(pressure),
        "q_Fz1": one(v.q_fz1),
        "q_Fz2": one(v.q_fz2),
        "q_v2": one(v.speed_coefficient),
        "p_Fz1": one(v.pressure_coefficient),
        "vertical_damping": one(v.damping),
        "B_reff": one(v.b_reff),
        "D_reff": one(v.d_reff),
        "F_reff": one(v.f_reff),
        "standstill_damping": one(vehicle.tire.standstill_damping),
        "standstill_velocity": 2.0,
        "rolling_resistance": one(vehicle.tire.rolling_resistance),
        "drag": 0.5 * density * float(vehicle.drag_area),
        "grade": grade,
        "bank": bank,
    }


def tires_of(slip):
    """The oracle's tyres with the coefficients of one of ours; the right side is mirrored."""
    coefficients = magic_formula_numpy.coefficients_of(slip) | {"NOMPRES": slip.nominal_pressure}
    return MagicFormulaTires(coefficients, (False, True, False, True), slip.minimum_relaxation)


SLIP = generic_passenger_tire(
    phy1=0.004, pvy1=0.02, phy3=0.03, pvy3=-0.1, phx1=0.002, pdy3=1.0, pex4=0.1, pey3=-0.1,
    ppx1=-0.4, ppx3=-0.1, ppy1=-0.5, ppy2=1.2, ppy3=-0.1, ptx2=0.4, ptx3=-0.3,
)  # fmt: skip
"""Every kind of term: shifts (ply steer), camber, pressure, load-dependent relaxation."""


def loaded_suv():
    """The SUV with everything that its published parameters leave at zero."""
    car = with_tire(suv(), SLIP)
    chassis = replace(
        car.chassis,
        roll_yaw_product=-80.0,
        hub_drop=car.chassis.hub_drop + jnp.array([0.01, 0.0, -0.02, 0.02]),
        diametral_inertia=jnp.array([0.8, 0.7, 0.9, 1.0]),
        spin_inertia=jnp.array([1.2, 1.3, 1.1, 1.4]),
        wheel_mass=jnp.array([61.0, 63.0, 52.0, 50.0]),
    )
    damper = replace(car.strut.damper, quadratic=jnp.full(4, 300.0))
    vertical = replace(
        car.tire.vertical,
        q_fz2=jnp.full(4, 30.0),
        speed_coefficient=jnp.full(4, 0.03),
        f_reff=jnp.full(4, 0.05),
    )
    return as_arrays(
        replace(
            car,
            chassis=chassis,
            strut=replace(car.strut, damper=damper, cubic_stiffness=jnp.full(4, 2e5)),
            tire=replace(car.tire, vertical=vertical),
        )
    )


PRESSURE = np.array([200e3, 250e3, 270e3, 180e3])


def test_accelerations_of_any_state_equal_the_oracles():
    """All fourteen accelerations and eight slip rates, in and out of contact and of the stops."""
    vehicle, runs, grade, bank = loaded_suv(), 60, 0.08, -0.05
    rng = np.random.default_rng(7)
    spread = lambda *scale: rng.uniform(-1, 1, (runs, len(scale))) * np.array(scale)  # noqa: E731
    four = lambda low, high: rng.uniform(low, high, (runs, 4))  # noqa: E731

    # cubic polynomials, which the plant's splines hold exactly
    bend = lambda x: 0.02 * x - 4e-4 * x**2 + 2e-6 * x**3  # noqa: E731
    bend_slope = lambda x: 0.02 - 8e-4 * x + 6e-6 * x**2  # noqa: E731
    lean = lambda x: 0.03 + 1e-3 * x - 1e-5 * x**2  # noqa: E731
    lean_slope = lambda x: 1e-3 - 2e-5 * x  # noqa: E731
    road = lambda x, y: (  # noqa: E731
        bend(x) + lean(x) * y, bend_slope(x) + lean_slope(x) * y, lean(x)
    )  # fmt: skip
    x = np.arange(0.0, 101.0)
    rows = np.stack([bend(x) - ROWS * lean(x), bend(x) + ROWS * lean(x)])
    surface = surface_from_grid(rows, 1.0, 0.0, -ROWS, 2 * ROWS)

    place = np.stack([rng.uniform(20, 80, runs), rng.uniform(-5, 5, runs)], 1)
    height = road(*place.T)[0] + 0.65 + rng.uniform(-0.05, 0.08, runs)
    angles = spread(0.1, 0.06, 3.0)
    v, w = spread(40.0, 3.0, 2.0), spread(1.5, 1.0, 1.0)
    v[:15] *= 0.03
    compression, rate, kappa, tan_alpha = four(-0.1, 0.1), four(-2, 2), four(-0.2, 0.2), four(
        -0.2, 0.2
    )  # fmt: skip
    spin = v[:, :1] / 0.35 * four(0.9, 1.1) + four(-0.5, 0.5)
    steer, drive, brake = four(-0.4, 0.4), four(-300, 300), four(0, 1500)
    state = VehicleState(
        *place.T, height, *angles.T, *v.T, *w.T, compression, rate, spin, kappa, tan_alpha
    )
    around = Surroundings(grade=grade, bank=bank)

    @jax.jit
    @jax.vmap
    def plant(x, controls):
        arguments = (controls, jnp.asarray(PRESSURE), surface, vehicle, around)
        return evaluate(x, *arguments), derivative(x, *arguments)

    now, slope = plant(jax.tree.map(jnp.asarray, state), Controls(steer, drive, brake))

    expected = []
    car = numbers(vehicle, PRESSURE, grade, bank)
    for i in range(runs):
        start = Initial(
            np.array([*place[i], height[i]]), angles[i], v[i], w[i], compression[i], rate[i],
            spin[i], kappa[i], tan_alpha[i],
        )  # fmt: skip
        controls = lambda t, i=i: (steer[i], drive[i], brake[i])  # noqa: E731
        oracle = Vehicle(car, controls, road, tires_of(SLIP))
        expected.append({k: v[0] for k, v in oracle.run(start, 0).items()})
    oracle = {key: np.array([e[key] for e in expected]) for key in expected[0]}

    a = now.acceleration
    found = {
        "wheel_load": now.forces.load,
        "tire_force_x": now.forces.longitudinal,
        "tire_force_y": now.forces.lateral,
        "strut_force": now.strut,
        "acceleration": np.stack(a.body, 1),
        "angular_acceleration": np.stack(a.rotation, 1),
        "compression_acceleration": a.compression,
        "spin_acceleration": a.spin,
        "kappa_rate": slope.kappa,
        "tan_alpha_rate": slope.tan_alpha,
        "v_rate": np.stack([slope.v_x, slope.v_y, slope.v_z], 1),
        "position_rate": np.stack([slope.x, slope.y, slope.z], 1),
    }
    assert (oracle["wheel_load"] == 0).sum() > 20
    assert (oracle["wheel_load"] > 1000).sum() > 100
    assert (np.abs(compression) > 0.07).sum() > 20
    for key, value in found.items():
        scale = np.abs(oracle[key]).max()
        np.testing.assert_allclose(value, oracle[key], rtol=0, atol=1e-11 * scale, err_msg=key)


WAVES = (30.0, 11.0, 4.7, 2.1, 1.1, 0.53, 0.3)
HEIGHTS = np.array([12e-3, 5e-3, 3e-3, 1.5e-3, 0.8e-3, 0.5e-3, 0.3e-3])
TILTS = np.array([4e-3, 2e-3, 2e-3, 1e-3, 0.5e-3, 0.4e-3, 0.2e-3])
PHASES = np.array([0.3, 1.9, 4.1, 2.6, 5.5, 0.9, 3.3])
NUMBERS = 2 * np.pi / np.array(WAVES)


def rough(x, y):
    """Elevation and slopes of a road whose two tracks differ: f(x) + y g(x), sums of sines."""
    angle = np.multiply.outer(np.asarray(x, float), NUMBERS) + PHASES
    sine, cosine = np.sin(angle), np.cos(angle)
    f, g = sine @ HEIGHTS, cosine @ TILTS
    slope = cosine @ (HEIGHTS * NUMBERS) - sine @ (TILTS * NUMBERS) * y
    return f + y * g, slope, g


def test_five_seconds_of_braking_and_steering_on_a_rough_road_equal_the_oracle():
    """From 90 km/h, wavelengths from 30 m to 0.3 m, 2 degrees of steer, 3 kNm of brake torque.

    Both sides advance by Runge-Kutta steps of 1 ms. Largest difference over the range of each
    signal; the plant's splines of the road, 2.5 mm apart, are the only approximation (1e-6; to the
    fourth power of the distance).
    """
    speed, total, begin, rise, dt, every = 25.0, 3000.0, 1.0, 0.3, 1e-3, 5
    steps = round(5.0 / dt)
    vehicle = loaded_suv()
    times = np.linspace(0.0, 6.0, 13)
    angles = math.radians(2.0) * np.sin(2 * np.pi * 0.4 * times)
    steer = curve(times.tolist(), angles.tolist())
    maneuver = Maneuver(
        speed, release=-1.0, brake=Brake(total, begin, rise), steer=steer, follow=0.0
    )
    x = np.arange(0.0, 130.0, 0.0025)
    tracks = np.stack([rough(x, np.full_like(x, y))[0] for y in (-ROWS, ROWS)])
    surface = surface_from_grid(tracks, 0.0025, 0.0, -ROWS, 2 * ROWS)

    zero = np.zeros(4)
    start = Initial(
        np.array([5.0, 0.0, 0.68]), np.zeros(3), np.array([speed, 0.0, 0.0]), np.zeros(3),
        zero, zero, zero + speed / 0.35, zero, zero,
    )  # fmt: skip
    initial = VehicleState(*start.position, *start.roll_pitch_yaw, *start.v, *start.w, *start[4:])
    run = staged_jit(
        lambda x: simulate_vehicle(
            x, vehicle, maneuver, surface, held(jnp.asarray(PRESSURE)), Surroundings(),
            samples=steps // every, rate=1.0 / (dt * every), substeps=every,
        )[1]
    )  # fmt: skip
    ours = run(jax.tree.map(jnp.asarray, initial))

    wheel_angle = PchipInterpolator(times, angles)
    front, split = np.array([1.0, 1.0, 0.0, 0.0]), np.array([0.325, 0.325, 0.175, 0.175])

    def controls(t):
        u = min(max((t - begin) / rise, 0.0), 1.0)
        torque = total * (6 * u**5 - 15 * u**4 + 10 * u**3)
        return wheel_angle(t) * front, zero, torque * split

    oracle = Vehicle(numbers(vehicle, PRESSURE), controls, rough, tires_of(SLIP), dt)
    theirs = oracle.run(start, steps, every)
    theirs = {key: value[1:] for key, value in theirs.items()}

    pairs = {
        "x": (ours.x, theirs["position"][:, 0]),
        "y": (ours.y, theirs["position"][:, 1]),
        "z": (ours.z, theirs["position"][:, 2]),
        "roll": (ours.roll, theirs["roll_pitch_yaw"][:, 0]),
        "pitch": (ours.pitch, theirs["roll_pitch_yaw"][:, 1]),
        "yaw": (ours.yaw, theirs["roll_pitch_yaw"][:, 2]),
        "speed": (ours.speed, theirs["v"][:, 0]),
        "lateral_speed": (ours.lateral_speed, theirs["v"][:, 1]),
        "roll_rate": (ours.roll_rate, theirs["w"][:, 0]),
        "pitch_rate": (ours.pitch_rate, theirs["w"][:, 1]),
        "yaw_rate": (ours.yaw_rate, theirs["w"][:, 2]),
        "a_x": (ours.a_x, theirs["proper_acceleration"][:, 0]),
        "a_y": (ours.a_y, theirs["proper_acceleration"][:, 1]),
        "a_z": (ours.a_z + GRAVITY, theirs["proper_acceleration"][:, 2]),
        "compression": (ours.compression, theirs["compression"]),
        "compression_rate": (ours.compression_rate, theirs["compression_rate"]),
        "spin": (ours.wheel_speed, theirs["spin"]),
        "load": (ours.load, theirs["wheel_load"]),
        "longitudinal": (ours.longitudinal, theirs["tire_force_x"]),
        "lateral": (ours.lateral, theirs["tire_force_y"]),
        "kappa": (ours.kappa, theirs["kappa"]),
        "tan_alpha": (ours.tan_alpha, theirs["tan_alpha"]),
        "wheel": (ours.wheel_acceleration + GRAVITY, theirs["carrier_acceleration"]),
    }
    assert ours.speed[-1] < 12.0
    assert np.ptp(ours.yaw_rate) > 0.2
    worst = {key: np.abs(a - b).max() / np.ptp(b) for key, (a, b) in pairs.items()}
    assert max(worst.values()) < 1e-5, worst
