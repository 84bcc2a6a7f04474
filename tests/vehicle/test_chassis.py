"""The chassis against Newton's and Euler's laws for the whole, from positions and velocities."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles.vehicle_numpy import attitude, bodies, energy, gravity, momentum, places, plain
from tests.vehicle.driving import coasting, flow, plant, surroundings
from wheelhop.vehicle.full_vehicle import VehicleState
from wheelhop.vehicle.full_vehicle_parameters import suv

CAR = replace(
    suv(),
    chassis=replace(
        suv().chassis,
        roll_yaw_product=jnp.asarray(-90.0),
        wheel_mass=jnp.array([61.0, 58.0, 52.0, 55.0]),
        spin_inertia=jnp.array([1.2, 1.1, 1.3, 1.4]),
        diametral_inertia=jnp.array([0.8, 0.7, 0.9, 0.6]),
    ),
)
PRESSURE = np.array([250e3, 200e3, 230e3, 180e3])


def random_state(seed, height=0.66):
    """Anything: rolled, pitched, sliding, with struts and wheels in motion."""
    rng = np.random.default_rng(seed)
    u = lambda scale, size=(): jnp.asarray(scale * rng.uniform(-1, 1, size))  # noqa: E731
    return VehicleState(
        x=u(5.0), y=u(5.0), z=height + u(0.01), roll=u(0.08), pitch=u(0.03), yaw=u(3.0),
        v_x=20.0 + u(5.0), v_y=u(2.0), v_z=u(0.5), p=u(1.0), q=u(1.0), r=u(1.0),
        compression=u(0.03, 4), compression_rate=u(1.0, 4), spin=60.0 + u(10.0, 4),
        kappa=u(0.1, 4), tan_alpha=u(0.1, 4),
    )  # fmt: skip


def along(x, rate, h):
    return jax.tree.map(lambda a, b: a + h * b, x, rate)


def difference(quantity, x, rate, h=1e-5):
    """Rate of a quantity of the state along the flow."""
    return (quantity(along(x, rate, h)) - quantity(along(x, rate, -h))) / (2 * h)


def external(now, x, around):
    """Forces of the road, weights and drag, and the points they act at, in the world."""
    frame = now.contact.frame
    axes = [np.array(axis) for axis in (frame.x, frame.y, frame.z)]
    parts = (now.forces.longitudinal, now.forces.lateral, now.forces.load)
    road = sum(np.asarray(f)[:, None] * axis.T for f, axis in zip(parts, axes, strict=True))
    mass, position, _ = bodies(x, CAR.chassis)
    foot = position[1:] - np.asarray(now.contact.radius)[:, None] * axes[2].T
    weight = mass[:, None] * gravity(float(around.grade), float(around.bank))
    push = -0.5 * 1.2 * float(CAR.drag_area) * float(x.v_x) * abs(float(x.v_x))
    drag = push * attitude(plain(x))[:, 0]
    return np.vstack([road, weight, drag]), np.vstack([foot, position, position[0]]), road, foot


@pytest.mark.parametrize("seed", range(4))
def test_momentum_of_the_whole_changes_by_the_external_forces(seed):
    """Six equations: linear and angular momentum about the world's origin."""
    around = surroundings(grade=0.1, bank=-0.07)
    x = random_state(seed)
    now, rate = plant(
        x, CAR, PRESSURE, around, steer=[0.1, 0.12, 0, 0], drive=[100, 150, 0, 50], brake=200.0
    )
    assert np.sum(np.asarray(now.forces.load)) > 500.0
    force, point, _, _ = external(now, x, around)
    linear = difference(lambda s: momentum(s, CAR.chassis)[0], x, rate)
    angular = difference(lambda s: momentum(s, CAR.chassis)[1], x, rate)
    scale = np.abs(force).sum()
    np.testing.assert_allclose(linear, force.sum(0), rtol=0, atol=1e-8 * scale)
    axis = np.array(now.pose.axis)
    resisting = 0.01 * np.asarray(now.forces.load * now.forces.effective_radius)
    rolling = (axis * resisting * np.tanh(np.asarray(x.spin) / 0.5)).sum(1)
    moment = np.cross(point, force).sum(0) - rolling
    np.testing.assert_allclose(angular, moment, rtol=0, atol=1e-7 * scale)


@pytest.mark.parametrize("seed", range(2))
def test_every_wheel_obeys_newton_along_its_slide_and_about_its_hinge(seed):
    """The other eight equations."""
    around = surroundings(grade=0.1, bank=-0.07)
    x, steer, drive, brake = random_state(seed), np.array([0.1, 0.12, 0, 0]), 120.0, 200.0
    now, rate = plant(x, CAR, PRESSURE, around, steer=steer, drive=drive, brake=brake)
    _, _, road, foot = external(now, x, around)
    c, turn = plain(CAR.chassis), attitude(plain(x))
    mass, position, _ = bodies(x, CAR.chassis)
    moving = difference(lambda s: bodies(s, CAR.chassis)[2], x, rate)[1:]
    down = gravity(0.1, -0.07)
    s, w = np.asarray(x.compression), np.asarray(x.compression_rate)
    k, d = plain(CAR.strut), plain(CAR.strut.damper)
    strut = k["preload"] + k["stiffness"] * s
    strut += (
        d["damping"]
        * w
        * (1 - d["asymmetry"] * np.tanh(w / d["knee"]))
        / (1 + d["digression"] * np.sqrt(w**2 + 1e-6))
    )
    f, r = float(CAR.anti_roll.front) * (s[0] - s[1]), float(CAR.anti_roll.rear) * (s[2] - s[3])
    strut += np.array([f, -f, r, -r])
    np.testing.assert_allclose(
        mass[1:] * (moving @ turn[:, 2]),
        (road + mass[1:, None] * down) @ turn[:, 2] - strut,
        rtol=0, atol=1e-6 * 20e3,
    )  # fmt: skip
    # the body alone, along the same axis
    body = difference(lambda s: bodies(s, CAR.chassis)[2], x, rate)[0]
    drag = external(now, x, around)[0][-1]
    assert c["body_mass"] * (body @ turn[:, 2]) == pytest.approx(
        strut.sum() + (c["body_mass"] * down + drag) @ turn[:, 2], abs=0.02
    )
    spun = difference(lambda s: np.asarray(s.spin) + float(s.q), x, rate)
    axis = np.stack([-np.sin(steer), np.cos(steer), 0 * steer], 1) @ turn.T
    moment = np.sum(np.cross(foot - position[1:], road) * axis, 1)
    resisting = brake + 0.01 * np.asarray(now.forces.load * now.forces.effective_radius)
    torque = drive - resisting * np.tanh(np.asarray(x.spin) / 0.5) + moment
    np.testing.assert_allclose(c["spin_inertia"] * spun, torque, rtol=1e-6, atol=1e-4)


def test_free_fall():
    """Slack struts: every part falls alike and nothing turns."""
    slack = replace(CAR.strut, preload=jnp.zeros(4))
    x = random_state(3, height=30.0)
    none = jnp.zeros(4)
    x = x._replace(
        p=0 * x.p, q=0 * x.q, r=0 * x.r, v_x=0 * x.v_x,
        compression=none, compression_rate=none, spin=none,
    )  # fmt: skip
    now, rate = plant(x, replace(CAR, strut=slack), PRESSURE, surroundings(bank=0.2))
    acceleration = attitude(plain(x)) @ np.array([rate.v_x, rate.v_y, rate.v_z])
    np.testing.assert_allclose(acceleration, gravity(0.0, 0.2), atol=1e-12)
    for part in (rate.p, rate.q, rate.r, rate.compression_rate, rate.spin):
        np.testing.assert_allclose(part, 0.0, atol=1e-12)
    np.testing.assert_array_equal(now.forces.load, 0.0)


def test_tumbling_in_space_keeps_momentum_and_energy():
    """One second weightless and out of reach of the road: struts are internal forces."""
    none = jnp.zeros(4)
    undamped = replace(CAR.strut, preload=none, damper=replace(CAR.strut.damper, damping=none))
    car = replace(CAR, strut=undamped, drag_area=jnp.asarray(0.0))
    around = surroundings(gravity=0.0)
    x = random_state(5, height=50.0)
    x = x._replace(p=x.p + 2.0, v_z=x.v_z + 3.0)
    end = flow(x, car, coasting(0.0), 1.0, 5e-4, PRESSURE, around)
    turned = attitude(plain(x)).T @ attitude(plain(end))
    assert np.arccos((np.trace(turned) - 1) / 2) > 0.7
    for before, after in zip(momentum(x, car.chassis), momentum(end, car.chassis), strict=True):
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-9 * np.abs(before).max())
    mass, first, velocity = bodies(x, car.chassis)
    moved = mass @ (bodies(end, car.chassis)[1] - first) / mass.sum()
    np.testing.assert_allclose(moved, mass @ velocity / mass.sum(), rtol=0, atol=1e-8)
    still = np.zeros(3)
    assert energy(end, car, PRESSURE, still) == pytest.approx(
        energy(x, car, PRESSURE, still), rel=1e-9
    )


def test_wheel_places_follow_the_geometry():
    from wheelhop.vehicle.chassis import wheel_places

    s = np.array([0.01, -0.02, 0.03, 0.0])
    found = np.stack([np.asarray(p) for p in wheel_places(jnp.asarray(s), CAR.chassis)], 1)
    np.testing.assert_allclose(found, places(s, CAR.chassis), rtol=1e-14)
