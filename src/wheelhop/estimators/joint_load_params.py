"""What the joint filter of wheel loads knows of a vehicle, and what it believes of noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp

from wheelhop.vehicle.chassis import corner_masses, wheel_places
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY, FullVehicle
from wheelhop.vehicle.strut import AntiRollBars, Strut
from wheelhop.vehicle.vertical_tire import deflection_at_load


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class JointLoadTuning:
    """Noise that the filter believes in.

    Sensor noises are those of the default `SensorSuite`. `load_walks` and the two tilts were chosen
    on drives of 5.5 s of the 14-degree-of-freedom SUV at 1 kHz and 100 Hz, with and without wheel
    accelerometers: 3,000 Nm of braking from 90 km/h on a flat road and on one of class A, B and C,
    a double lane change of 0.6 g on a flat road, and straight ahead on class B and C. By likelihood
    300 to 1,000 is best on a flat road, 1,000 to 2,000 on class A, 2,000 to 5,000 on B and 5,000 to
    15,000 on C; below 500 the lane change's loads leave their sigma. `moment_walk` and the priors
    are set by judgement. `told_moment_walk` was chosen of 50, 100, 200 and 500 on braking and
    lane changes of the paper's vehicle, its springs and dampers 0.5, 1 and 1.5 times as stiff as
    believed, a slope and a road of class C: at 200 the springs of a lane change seem 0.94 as stiff
    as they are and dampers up to 1.5 times as strong, at 500 0.8 and 2.

    Attributes:
        body_acceleration: of the accelerometers on the body [m/s^2].
        compression: of the deflection sensors [m].
        wheel_acceleration: of the accelerometers on the wheels [m/s^2].
        load_walks: standard deviations that a load gains in one second [N/s^0.5], one for each
            filter of the bank in `wheel_loads`: smooth roads want the least, rough ones the most.
        moment_walk: the same of the two moments [Nm/s^0.5].
        patch_tilt: of the ground under a wheel against the plane of the four contacts [rad], on
            the smoothest road; a lane change on a flat one needs 0.008 for the sharing of lateral
            forces.
        tilt_per_walk: what that gains with the intensity believed in [rad s^0.5/N]: rough ground
            is steep ground. At 1 kHz with wheel accelerometers, 80 to 90 km/h, the simulated
            ground's tilt is 0.0044 on class A, 0.0085 on B and 0.017 on C, where the bank believes
            in 1,200, 2,500 and 4,800.
        mass_prior: of ln_mass before the first sample.
        load_prior: of the loads before the first sample [N].
        horizontal_acceleration: of the accelerometers a_x and a_y, where they tell the moments
            [m/s^2].
        told_moment: deviation of the moments from what a_x and a_y tell [Nm]: drag, an offset of
            the sensor, the height of the centre of mass.
        told_moment_walk: what that gains in one second [Nm/s^0.5].
        scale_prior: of the logarithms of the springs' and dampers' scales before the first sample.
        scale_walk: what they gain in one second [1/s^0.5].
        spring_doubt: of the springs' scale beyond noise, relative: that of the height of the centre
            of mass.
        damper_doubt: of the dampers' scale beyond noise, relative: moments that are believed to
            vary more than they do are taken for damping, 1 to 15 % in most drives of the study,
            27 % on a smooth slope that hardly moves them.
    """

    body_acceleration: Any = 0.5
    compression: Any = 5e-4
    wheel_acceleration: Any = 0.5
    load_walks: tuple[Any, ...] = (500.0, 2000.0, 5000.0, 12000.0)
    moment_walk: Any = 5e3
    patch_tilt: Any = 0.007
    tilt_per_walk: Any = 4.5e-6
    mass_prior: Any = 0.1
    load_prior: Any = 2e3
    horizontal_acceleration: Any = 0.05
    told_moment: Any = 300.0
    told_moment_walk: Any = 50.0
    scale_prior: Any = 0.3
    scale_walk: Any = 1e-3
    spring_doubt: Any = 0.03
    damper_doubt: Any = 0.1


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class JointLoadParams:
    """What the filter needs of a vehicle; corners on a leading axis [4].

    Attributes:
        body_mass: sprung [kg].
        wheel_mass: [kg], [4].
        roll_inertia, pitch_inertia: of the body with the wheels held to it sideways [kg m^2].
        x, y: places of the wheels from the body's centre of mass [m], [4].
        strut: every entry of its springs and dampers [4].
        bars: anti-roll bars.
        static_load: [N], [4].
        tire_stiffness: static load over static deflection [N/m], [4].
        lever: of the tyres' horizontal forces about the body's centre of mass [m].
        brake_share, drive_share: of the longitudinal force on each wheel, [4].
        load_walk: [N/s^0.5].
        scale: what the forces of the springs beyond their preload, and those of the dampers, are
            multiplied by, [2].
        radius: of the wheels under their static loads, mean [m].
        told: 1 where a_x and a_y tell the moments, 0 where they are found without.
        a_x, a_y: what accelerometers at the body's centre of mass show now [m/s^2]; zeros where
            nothing is told.
        dt: sampling interval [s].
        tuning: noise and priors.
    """

    body_mass: Any
    wheel_mass: Any
    roll_inertia: Any
    pitch_inertia: Any
    x: Any
    y: Any
    strut: Strut
    bars: AntiRollBars
    static_load: Any
    tire_stiffness: Any
    lever: Any
    brake_share: Any
    drive_share: Any
    load_walk: Any
    scale: Any
    radius: Any
    told: Any
    a_x: Any
    a_y: Any
    dt: Any
    tuning: JointLoadTuning


def joint_load_params(
    vehicle: FullVehicle, dt: Any, tuning: JointLoadTuning | None = None, load_walk: Any = 3e3
) -> JointLoadParams:
    """Parameters of `joint_load_filter`; pure, so that it maps over vehicles.

    Args:
        vehicle: parameters, as arrays.
        dt: sampling interval [s].
        tuning: noise and priors.
        load_walk: of this filter [N/s^0.5].
    """
    c, wheels = vehicle.chassis, vehicle.tire.vertical
    place = wheel_places(jnp.zeros_like(c.wheel_mass), c)
    total = c.body_mass + jnp.sum(c.wheel_mass, 0)
    below = jnp.sum(c.wheel_mass * place.z, 0) / total
    hanging = jnp.sum(c.wheel_mass * place.z * (place.z - below[None]), 0)
    static = STANDARD_GRAVITY * corner_masses(c)
    still = jnp.zeros_like(static)
    sunk = deflection_at_load(static, still, vehicle.nominal_pressure, wheels)
    height = jnp.mean(c.hub_drop + wheels.unloaded_radius - sunk, 0)
    strut = map_springs(lambda leaf: leaf + still, vehicle.strut)

    def number(leaf: Any) -> Any:
        return jnp.asarray(leaf, static.dtype)

    tuning = JointLoadTuning() if tuning is None else tuning
    return JointLoadParams(
        body_mass=c.body_mass,
        wheel_mass=c.wheel_mass,
        roll_inertia=c.roll_inertia + jnp.sum(c.diametral_inertia, 0) + hanging,
        pitch_inertia=c.pitch_inertia + hanging,
        x=place.x,
        y=place.y,
        strut=strut,
        bars=vehicle.anti_roll,
        static_load=static,
        tire_stiffness=static / sunk,
        lever=height + below,
        brake_share=vehicle.brake_share,
        drive_share=vehicle.drive_share,
        load_walk=number(load_walk),
        scale=number(1.0) + jnp.zeros(2, static.dtype),
        radius=jnp.mean(wheels.unloaded_radius - sunk, 0),
        told=number(0.0),
        a_x=number(0.0),
        a_y=number(0.0),
        dt=number(dt),
        tuning=jax.tree.map(number, tuning),
    )


def map_springs(change: Any, strut: Strut) -> Strut:
    """The strut with every number of its springs and dampers changed, curves as they are."""
    names = ("preload", "stiffness", "cubic_stiffness", "bump_clearance", "rebound_clearance")
    numbers = {name: change(jnp.asarray(getattr(strut, name))) for name in names}
    damper = jax.tree.map(lambda leaf: change(jnp.asarray(leaf)), strut.damper)
    return replace(strut, damper=damper, **numbers)
