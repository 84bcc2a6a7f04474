"""A 14-degree-of-freedom vehicle in MuJoCo, its force laws in NumPy, apart from wheelhop.

MuJoCo holds the masses, the constraints and the integration: a free joint, four slides along the
body's z and four hinges about its y, with no contact, damping or armature. Every force is written
here and injected by `mjcb_act_dyn`, which MuJoCo calls in each of the four Runge-Kutta stages
after the positions and velocities of that stage; the eight relaxed slips are activations of one
user actuator without force, so that the same integrator carries them. Positions, orientations
and velocities are read from MuJoCo. ISO 8855 axes, corners FL, FR, RL, RR, SI units.
"""

import math
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from tests.oracles.magic_formula_numpy import magic_formula

GRAVITY = 9.80665
SPIN_SCALE = 0.5
EPS = 1e-3

CAR = {
    "sprung_mass": 1788.0,
    "inertia": (700.0, 2900.0, 3230.0),
    "product_xz": 0.0,  # integral of x z dm
    "a": 1.347,
    "b": 1.471,
    "track": (1.606, 1.6364),
    "hub_drop": (0.308, 0.308, 0.308, 0.308),
    "wheel_mass": (61.14, 61.14, 52.75, 52.75),
    "spin_inertia": (1.2, 1.2, 1.2, 1.2),
    "diametral_inertia": (0.8, 0.8, 0.8, 0.8),
    "preload": (4576.6, 4576.6, 4190.8, 4190.8),
    "stiffness": (33.6e3, 33.6e3, 35.5e3, 35.5e3),
    "cubic_stiffness": (1e5, 1e5, 1e5, 1e5),
    "damping": (2400.0, 2400.0, 2400.0, 2400.0),
    "asymmetry": (0.3, 0.3, 0.3, 0.3),
    "asymmetry_velocity": (0.05, 0.05, 0.05, 0.05),
    "saturation": (0.5, 0.5, 0.5, 0.5),
    "quadratic_damping": (300.0, 300.0, 300.0, 300.0),
    "bump_gap": (0.06, 0.06, 0.06, 0.06),
    "rebound_gap": (0.07, 0.07, 0.07, 0.07),
    "stop_curve": ((0.0, 0.02, 0.04), (0.0, 2e3, 9e3)),
    "antiroll": (15e3, 10e3),
    "radius": 0.36,
    "nominal_load": 5000.0,
    "nominal_velocity": 16.6,
    "nominal_pressure": 250e3,
    "pressure": (250e3, 250e3, 250e3, 250e3),
    "q_Fz1": 264.7e3 * 0.36 / 5000.0,
    "q_Fz2": 0.0,
    "q_v2": 0.0,
    "p_Fz1": 0.7,
    "vertical_damping": 50.0,
    "B_reff": 8.0,
    "D_reff": 0.25,
    "F_reff": 0.01,
    "standstill_damping": 0.02,
    "standstill_velocity": 2.0,
    "rolling_resistance": 0.012,
    "drag": 0.5 * 1.225 * 0.9,
    "grade": 0.0,
    "bank": 0.0,
}
"""A complete set of numbers: the keys that `Vehicle` needs, tuples per corner or (front, rear)."""


class Initial(NamedTuple):
    """Start of a run: `v` and `w` in body components, the rest per corner."""

    position: np.ndarray
    roll_pitch_yaw: np.ndarray
    v: np.ndarray
    w: np.ndarray
    compression: np.ndarray
    rate: np.ndarray
    spin: np.ndarray
    kappa: np.ndarray
    tan_alpha: np.ndarray


class LinearTires:
    """Slip stiffness without camber or relaxation's load, saturated."""

    def forces(self, kappa, tan_alpha, load, sin_camber, pressure):
        """F_x and F_y of the four tyres."""
        scale = 20 * load / np.sqrt(1 + (20 * kappa) ** 2 + (20 * tan_alpha) ** 2)
        return scale * kappa, -scale * tan_alpha

    def lengths(self, load):
        """Longitudinal and lateral relaxation length."""
        return 0.3, 0.5

    def stiffness(self, load, pressure):
        """Slopes of the forces at zero slip."""
        return 20 * load, 20 * load


class FrictionlessTires(LinearTires):
    """Tyres that carry load only."""

    def forces(self, kappa, tan_alpha, load, sin_camber, pressure):
        """No force in the road's plane."""
        return np.zeros(4), np.zeros(4)


class MagicFormulaTires:
    """Four tyres of one Magic Formula set, those on the right mirrored.

    Args:
        coefficients: upper-case keys of a tyre property file, NOMPRES included.
        mirrored: for each corner, whether its tyre is the mirror image.
        shortest: lower bound of the relaxation lengths [m].
    """

    def __init__(self, coefficients, mirrored, shortest=0.1):
        self.c, self.mirrored, self.shortest = coefficients, mirrored, shortest

    def forces(self, kappa, tan_alpha, load, sin_camber, pressure):
        """F_x and F_y of the four tyres."""
        f_x, f_y = np.zeros(4), np.zeros(4)
        excess = pressure / self.c["NOMPRES"] - 1
        for i, mirror in enumerate(self.mirrored):
            sign = -1.0 if mirror else 1.0
            f_x[i], lateral = magic_formula(
                float(kappa[i]),
                sign * float(tan_alpha[i]),
                float(load[i]),
                sign * float(sin_camber[i]),
                self.c,
                float(excess[i]),
            )
            f_y[i] = sign * lateral
        return f_x, f_y

    def stiffness(self, load, pressure):
        """Slopes of the forces at their centres; Pacejka 2012, section 4.3, upright."""
        c = self.c
        dfz = load / c["FNOMIN"] - 1
        dp = np.asarray(pressure) / c["NOMPRES"] - 1
        x = load * (c["PKX1"] + c["PKX2"] * dfz) * np.exp(c["PKX3"] * dfz)
        x = x * (1 + c.get("PPX1", 0.0) * dp + c.get("PPX2", 0.0) * dp**2)
        place = c["PKY2"] * (1 + c.get("PPY2", 0.0) * dp) * c["FNOMIN"]
        y = c["PKY1"] * (1 + c.get("PPY1", 0.0) * dp) * c["FNOMIN"]
        return x, y * np.sin(c.get("PKY4", 2.0) * np.arctan(load / place))

    def lengths(self, load):
        """Relaxation lengths; Pacejka 2012, appendix 3, upright."""
        c = self.c
        r0, fz0 = c["UNLOADED_RADIUS"], c["FNOMIN"]
        dfz = load / fz0 - 1
        x = r0 * load / fz0 * (c["PTX1"] + c["PTX2"] * dfz) * np.exp(-c["PTX3"] * dfz)
        y = r0 * c["PTY1"] * np.sin(2 * np.arctan(load / (c["PTY2"] * fz0)))
        return np.maximum(x, self.shortest), np.maximum(y, self.shortest)


def flat(x, y):
    """Elevation and slopes of a plane road."""
    zero = np.zeros(4)
    return zero, zero, zero


def coast(t):
    """Steer angle, drive torque and brake torque of a car left alone."""
    zero = np.zeros(4)
    return zero, zero, zero


def gravity(car):
    """Weight per mass in axes that follow the mean road plane."""
    grade, bank = car["grade"], car["bank"]
    return -GRAVITY * np.array(
        [
            math.sin(grade),
            math.cos(grade) * math.sin(bank),
            math.cos(grade) * math.cos(bank),
        ]
    )


def xml(car, dt):
    """The multibody model; mass and inertia of a corner sit on its carrier and wheel."""
    ixx, iyy, izz = car["inertia"]
    x = (car["a"], car["a"], -car["b"], -car["b"])
    front, rear = car["track"]
    y = (front / 2, -front / 2, rear / 2, -rear / 2)
    corners = ""
    for i in range(4):
        half, d, w = car["wheel_mass"][i] / 2, car["diametral_inertia"][i], car["spin_inertia"][i]
        corners += f"""
        <body name="carrier{i}" pos="{x[i]!r} {y[i]!r} {-car["hub_drop"][i]!r}">
          <site name="hub{i}"/>
          <joint name="slide{i}" type="slide" axis="0 0 1"/>
          <inertial pos="0 0 0" mass="{half!r}" diaginertia="1e-12 1e-12 1e-12"/>
          <body name="wheel{i}">
            <joint name="hinge{i}" type="hinge" axis="0 1 0"/>
            <inertial pos="0 0 0" mass="{half!r}" diaginertia="{d!r} {w!r} {d!r}"/>
          </body>
        </body>"""
    sensors = "".join(f'<accelerometer site="hub{i}"/>' for i in range(4))
    gx, gy, gz = gravity(car).tolist()
    return f"""
    <mujoco>
      <option integrator="RK4" timestep="{dt!r}" gravity="{gx!r} {gy!r} {gz!r}">
        <flag contact="disable" constraint="disable"/>
      </option>
      <worldbody>
        <body name="body">
          <freejoint/>
          <site name="middle"/>
          <inertial pos="0 0 0" mass="{car["sprung_mass"]!r}"
            fullinertia="{ixx!r} {iyy!r} {izz!r} 0 {-car["product_xz"]!r} 0"/>{corners}
        </body>
      </worldbody>
      <sensor><accelerometer site="middle"/>{sensors}</sensor>
      <actuator>
        <general joint="hinge0" dyntype="user" actdim="8" gainprm="0"/>
      </actuator>
    </mujoco>"""


def stop(gap, curve):
    """Force of a stop over its penetration: monotone cubic, then straight."""
    points, values = (np.asarray(c, float) for c in curve)
    slopes = PchipInterpolator(points, values).derivative()(points)
    slopes[0] = 0.0  # soft contact
    law = CubicHermiteSpline(points, values, slopes)
    last, slope = points[-1], slopes[-1]
    gap = np.asarray(gap, float)

    def force(travel):
        depth = travel - gap
        if depth.max() <= 0:
            return 0.0
        inside = np.clip(depth, 0.0, last)
        return np.where(depth > 0, law(inside) + slope * np.maximum(depth - last, 0.0), 0.0)

    return force


class Vehicle:
    """The model, its force laws and what they last evaluated.

    Args:
        car: numbers as in `CAR`.
        controls: t -> steer angle [rad], drive torque and brake torque [Nm], [4] each.
        road: x, y [4] -> elevation and slopes of the effective plane, [4] each.
        tires: what gives slip forces and relaxation lengths.
        dt: time step [s].
    """

    def __init__(self, car, controls=coast, road=flat, tires=None, dt=1e-3):
        self.car = {k: np.array(v) if isinstance(v, tuple) else v for k, v in car.items()}
        self.controls, self.road, self.tires = controls, road, tires or LinearTires()
        self.model = mujoco.MjModel.from_xml_string(xml(car, dt))
        self.data = mujoco.MjData(self.model)
        bodies, joints = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_JOINT
        find = lambda kind, name: mujoco.mj_name2id(self.model, kind, name)  # noqa: E731
        self.body = find(bodies, "body")
        self.carriers = np.array([find(bodies, f"carrier{i}") for i in range(4)])
        slides = [find(joints, f"slide{i}") for i in range(4)]
        hinges = [find(joints, f"hinge{i}") for i in range(4)]
        self.slide_q, self.slide_v = self.model.jnt_qposadr[slides], self.model.jnt_dofadr[slides]
        self.hinge_v = self.model.jnt_dofadr[hinges]
        self.bump = stop(self.car["bump_gap"], car["stop_curve"])
        self.rebound = stop(self.car["rebound_gap"], car["stop_curve"])
        # nominal load over the stiffness at that load
        self.rho_0 = car["radius"] / math.sqrt(car["q_Fz1"] ** 2 + 4 * car["q_Fz2"])
        self._velocity = np.zeros((4, 6))
        self.found = {}

    def place(self, start):
        """Put the car into a state."""
        d = self.data
        mujoco.mj_resetData(self.model, d)
        roll, pitch, yaw = start.roll_pitch_yaw
        quaternion = np.zeros(4)
        mujoco.mju_euler2Quat(quaternion, np.array([yaw, pitch, roll], float), "zyx")
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, quaternion)
        d.qpos[:3], d.qpos[3:7] = start.position, quaternion
        d.qvel[:3], d.qvel[3:6] = rotation.reshape(3, 3) @ start.v, start.w
        d.qpos[self.slide_q], d.qvel[self.slide_v] = start.compression, start.rate
        d.qvel[self.hinge_v] = start.spin
        d.act[:4], d.act[4:] = start.kappa, start.tan_alpha

    def struts(self, s, rate):
        """Force of every strut, positive where it pushes the body up."""
        c = self.car
        spring = c["preload"] + c["stiffness"] * s + c["cubic_stiffness"] * s**3
        lean = 1 - c["asymmetry"] * np.tanh(rate / c["asymmetry_velocity"])
        fade = 1 + c["saturation"] * np.sqrt(rate**2 + EPS**2)
        damper = c["damping"] * rate * lean / fade + c["quadratic_damping"] * rate * np.abs(rate)
        roll = c["antiroll"] * (s[0::2] - s[1::2])
        bar = np.array([roll[0], -roll[0], roll[1], -roll[1]])
        return spring + damper + self.bump(s) - self.rebound(-s) + bar

    def loads(self, rho, rate, spin):
        """Vertical tyre force."""
        c = self.car
        r0 = c["radius"]
        excess = (c["pressure"] - c["nominal_pressure"]) / c["nominal_pressure"]
        stiff = (1 + c["q_v2"] * np.abs(spin) * r0 / c["nominal_velocity"]) * (
            1 + c["p_Fz1"] * excess
        )
        x = rho / r0
        elastic = stiff * (c["q_Fz1"] * x + c["q_Fz2"] * x * x) * c["nominal_load"]
        return np.where(rho > 0, np.maximum(elastic + c["vertical_damping"] * rate, 0.0), 0.0)

    def evaluate(self, model, data, _):
        """All forces and slip rates of a stage, written into MuJoCo's buffers."""
        c = self.car
        for i, carrier in enumerate(self.carriers):
            mujoco.mj_objectVelocity(
                model, data, mujoco.mjtObj.mjOBJ_XBODY, carrier, self._velocity[i], 0
            )
        turn, velocity = self._velocity[:, :3].T, self._velocity[:, 3:].T
        rotation = data.xmat[self.body].reshape(3, 3)
        place = data.xpos[self.carriers].T
        s, rate = data.qpos[self.slide_q], data.qvel[self.slide_v]
        spin = data.qvel[self.hinge_v]
        kappa, tan_alpha = data.act[:4], data.act[4:]
        steer, drive, brake = self.controls(data.time)
        elevation, slope_x, slope_y = self.road(place[0], place[1])

        n = np.array([-slope_x, -slope_y, np.ones(4)])
        n /= np.sqrt((n * n).sum(0))
        axis = rotation @ np.array([-np.sin(steer), np.cos(steer), np.zeros(4)])
        t = cross(axis, n)
        t /= np.sqrt((t * t).sum(0))
        lateral = cross(n, t)
        radius = (place[2] - elevation) * n[2]
        rho = c["radius"] - radius
        arm = -radius * n
        contact = velocity + cross(turn, arm)
        load = self.loads(rho, -(velocity * n).sum(0), spin + (turn * axis).sum(0))

        pressed = np.maximum(rho, 0.0) / self.rho_0
        rolling = c["radius"] - self.rho_0 * (
            c["D_reff"] * np.arctan(c["B_reff"] * pressed) + c["F_reff"] * pressed
        )
        forward = (velocity * t).sum(0)
        slide_y = (contact * lateral).sum(0)
        slide_x = forward - (spin + (turn * axis).sum(0)) * rolling
        speed = np.abs(forward)
        stiff_x, stiff_y = self.tires.stiffness(load, c["pressure"])
        pressed_on = np.maximum(load, 1.0)
        demand = (stiff_x * kappa / pressed_on) ** 2 + (stiff_y * tan_alpha / pressed_on) ** 2
        floor = 0.005 + 1e-3 * speed
        length_x, length_y = (
            np.maximum(length / (1 + np.sqrt(demand + 1e-8)), floor)
            for length in self.tires.lengths(load)
        )
        kappa_rate = (-slide_x - speed * kappa) / length_x
        alpha_rate = (slide_y - speed * tan_alpha) / length_y
        slow = np.minimum(speed / c["standstill_velocity"], 1.0)
        xi = c["standstill_damping"] * 0.5 * (1 + np.cos(np.pi * slow))
        f_x, f_y = self.tires.forces(
            kappa - xi * slide_x,
            tan_alpha + xi * slide_y,
            load,
            (axis * n).sum(0),
            c["pressure"],
        )
        force = load * n + f_x * t + f_y * lateral
        facing = np.tanh(spin / SPIN_SCALE)
        resisting = c["rolling_resistance"] * load * rolling * facing
        moment = cross(arm, force) - resisting * axis
        width = SPIN_SCALE + 5e-4 * np.abs(brake) / np.array(c["spin_inertia"])
        torque = drive - brake * np.tanh(spin / width) + (moment * axis).sum(0)
        strut = self.struts(s, rate)
        ahead = rotation[:, 0] @ data.qvel[:3]

        data.xfrc_applied[self.carriers, :3] = force.T
        data.xfrc_applied[self.carriers, 3:] = moment.T
        data.xfrc_applied[self.body, :3] = -c["drag"] * abs(ahead) * ahead * rotation[:, 0]
        data.qfrc_applied[self.slide_v] = -strut
        data.qfrc_applied[self.hinge_v] = torque
        data.act_dot[:4], data.act_dot[4:] = kappa_rate, alpha_rate
        self.found = {
            "wheel_load": load,
            "tire_force_x": f_x,
            "tire_force_y": f_y,
            "strut_force": strut,
            "tire_deflection": rho,
            "loaded_radius": radius,
            "force": force,
            "kappa_rate": kappa_rate,
            "tan_alpha_rate": alpha_rate,
        }
        return 0.0

    def record(self):
        """What a run keeps of the present state; `mj_forward` must have been called."""
        d = self.data
        rotation = d.xmat[self.body].reshape(3, 3)
        roll = math.atan2(rotation[2, 1], rotation[2, 2])
        pitch = -math.asin(rotation[2, 0])
        yaw = math.atan2(rotation[1, 0], rotation[0, 0])
        return {
            "time": d.time,
            "position": d.qpos[:3].copy(),
            "roll_pitch_yaw": np.array([roll, pitch, yaw]),
            "v": rotation.T @ d.qvel[:3],
            "w": d.qvel[3:6].copy(),
            "compression": d.qpos[self.slide_q],
            "compression_rate": d.qvel[self.slide_v],
            "spin": d.qvel[self.hinge_v],
            "kappa": d.act[:4].copy(),
            "tan_alpha": d.act[4:].copy(),
            "acceleration": rotation.T @ d.qacc[:3],
            "angular_acceleration": d.qacc[3:6].copy(),
            "compression_acceleration": d.qacc[self.slide_v],
            "spin_acceleration": d.qacc[self.hinge_v],
            "v_rate": rotation.T @ d.qacc[:3] - np.cross(d.qvel[3:6], rotation.T @ d.qvel[:3]),
            "position_rate": d.qvel[:3].copy(),
            "energy": d.energy.copy(),
            "proper_acceleration": d.sensordata[:3].copy(),
            "carrier_acceleration": d.sensordata[5::3].copy(),
            **self.found,
        }

    def run(self, start, steps, every=1, energy=False):
        """Record of every `every`-th of `steps` time steps, the start included.

        `energy` adds that of weight and motion, which MuJoCo computes.
        """
        self.model.opt.enableflags = int(mujoco.mjtEnableBit.mjENBL_ENERGY) if energy else 0
        self.place(start)
        rows = []
        mujoco.set_mjcb_act_dyn(self.evaluate)
        try:
            for k in range(steps + 1):
                mujoco.mj_forward(self.model, self.data)
                if k % every == 0:
                    rows.append(self.record())
                if k < steps:
                    mujoco.mj_RungeKutta(self.model, self.data, 4)
        finally:
            mujoco.set_mjcb_act_dyn(None)
        return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def cross(a, b):
    """Cross product of [3, 4] arrays; faster than `np.cross` on arrays this small."""
    return np.array(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )


def at_rest(car, speed=0.0):
    """A start at the design position, level, wheels rolling freely."""
    height = np.mean(np.array(car["hub_drop"])) + static_radius(car)
    zero = np.zeros(4)
    return Initial(
        np.array([0.0, 0.0, height]),
        np.zeros(3),
        np.array([speed, 0.0, 0.0]),
        np.zeros(3),
        zero,
        zero,
        zero + speed / car["radius"],
        zero,
        zero,
    )


def static_radius(car):
    """Loaded radius under a quarter of the weight on a linear tyre."""
    weight = GRAVITY * (car["sprung_mass"] + sum(car["wheel_mass"])) / 4
    return car["radius"] * (1 - weight / (car["q_Fz1"] * car["nominal_load"]))


def simulate(car, initial, controls=coast, road=flat, duration=1.0, dt=1e-3, tires=None):
    """Arrays over time of a run from `initial` under `controls` on `road`."""
    vehicle = Vehicle(car, controls, road, tires, dt)
    return vehicle.run(initial, round(duration / dt))
