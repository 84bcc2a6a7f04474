"""Linear view of a full vehicle: vertical modes at rest, and how tyre loads compress the struts."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from wheelhop.staging import staged_jit
from wheelhop.vehicle.chassis import BodyMotion, Loads, accelerations, wheel_places
from wheelhop.vehicle.equilibrium import Rest, require_rest, state_at_rest, static_equilibrium
from wheelhop.vehicle.full_vehicle import (
    Controls,
    FullVehicle,
    Surroundings,
    derivative,
    gravity_in_plane,
    strut_force,
)
from wheelhop.vehicle.road.surface import flat_surface
from wheelhop.vehicle.vector import Vector, body_frame, cross, lift_frame, to_body

_PLACES = ("z", "roll", "pitch", "compression")
_RATES = ("v_z", "p", "q", "compression_rate")


class Modes(NamedTuple):
    """Modes of the seven vertical motions, slowest first, [7] each.

    Attributes:
        frequency: undamped natural frequency |lambda| / (2 pi) [Hz].
        damping: damping ratio [-]; above 1 for a mode that does not oscillate.
        shape: [7, 7], a row per mode: complex amplitudes of heave [m], roll and pitch [rad] and
            the compressions FL, FR, RL, RR [m], the largest one.
        name: what holds most of the kinetic energy: heave, roll or pitch of the body, or hop
            (wheels alike) or tramp (wheels opposed) of an axle.
    """

    frequency: np.ndarray
    damping: np.ndarray
    shape: np.ndarray
    name: tuple[str, ...]


def vertical_system(
    rest: Rest, vehicle: FullVehicle, pressure: Any, around: Surroundings, speed: Any = 0.0
) -> Any:
    """System matrix A [14, 14] of x' = A x about static equilibrium, by differentiation.

    x holds heave, roll, pitch and compressions FL, FR, RL, RR, then the rates v_z, p, q and s'.
    Heading and horizontal velocity keep their values and the tyres carry no slip forces: the
    vehicle moves on ice. Pure; inside `jit` it compiles faster by `staged_jit`.

    Args:
        rest: the equilibrium, from `static_equilibrium`.
        vehicle: parameters.
        pressure: of the tyres [Pa], [4].
        around: gravity's direction; its friction is not used.
        speed: at which the vehicle rolls [m/s], for tyres that stiffen with spin.
    """
    ice = replace(around, friction=jnp.zeros_like(jnp.asarray(around.friction, pressure.dtype)))
    state = state_at_rest(rest, speed, vehicle)
    none = jnp.zeros_like(rest.compression)
    still = Controls(none, none, none)
    road = flat_surface(dtype=rest.compression.dtype)
    # a body that moves with its own pitch attitude heaves in its own frame: stop that part
    state = state._replace(v_x=jnp.zeros_like(rest.z), v_z=jnp.zeros_like(rest.z))
    names = _PLACES + _RATES
    start, restore = ravel_pytree({name: getattr(state, name) for name in names})

    def rate(flat: Any) -> Any:
        moved = state._replace(**restore(flat))
        slope = derivative(moved, still, pressure, road, vehicle, ice)
        return ravel_pytree({name: getattr(slope, name) for name in names})[0]

    def column(tangent: Any) -> Any:
        return jax.jvp(rate, (start,), (tangent,))[1]

    # one column at a time: compiles much faster than a batched Jacobian
    columns = jax.lax.map(column, jnp.eye(start.shape[0], dtype=start.dtype))
    order = _order(names)
    return columns.T[order][:, order]


def modes(
    vehicle: FullVehicle, pressure: Any, around: Surroundings | None = None, speed: float = 0.0
) -> Modes:
    """Natural frequencies, damping ratios and shapes of heave, roll, pitch and the four wheels.

    Args:
        vehicle: parameters, as arrays (`as_arrays`).
        pressure: of the tyres [Pa], [4].
        around: gravity's direction.
        speed: at which the vehicle rolls [m/s], for tyres that stiffen with spin.

    Raises:
        DivergenceError: if the vehicle finds no static equilibrium.
    """
    pressure = jnp.asarray(pressure)
    around = Surroundings() if around is None else around
    around = jax.tree.map(lambda leaf: jnp.asarray(leaf, pressure.dtype), around)
    equilibrium, linear = _compiled()
    rest = require_rest(equilibrium(vehicle, pressure, around))
    system = linear(rest, vehicle, pressure, around, jnp.asarray(speed, pressure.dtype))
    values, vectors = np.linalg.eig(np.asarray(system, float))
    frequency, damping, shape = [], [], []
    for first, second in _pairs(values):
        product, total = (values[first] * values[second]).real, (values[first] + values[second])
        natural = np.sqrt(abs(product))
        frequency.append(natural / (2.0 * np.pi))
        damping.append(-total.real / (2.0 * natural) if natural > 0 else np.inf)
        one = vectors[:7, first]
        shape.append(one / one[np.argmax(np.abs(one))])
    order = np.argsort(frequency)
    shapes = np.array(shape)[order]
    names = tuple(_name(one, vehicle) for one in shapes)
    return Modes(np.array(frequency)[order], np.array(damping)[order], shapes, names)


def static_gain(rest: Rest, vehicle: FullVehicle, around: Surroundings) -> Any:
    """d compression / d tyre load [m/N], [4, 4], in the steadily accelerating frame of the body.

    The four loads accelerate the body; the compressions are those at which no wheel moves
    relative to it, s''(s, F) = 0, so that ds/dF = -(ds''/ds)^-1 ds''/dF about static
    equilibrium (implicit function theorem). The plant gain G(0) of Filipozzi et al. 2021,
    section 2. Pure.

    Args:
        rest: the equilibrium, from `static_equilibrium`.
        vehicle: parameters.
        around: gravity's direction.
    """
    none, zero = jnp.zeros_like(rest.compression), jnp.zeros_like(rest.z)
    still, no_force = Vector(zero, zero, zero), Vector(none, none, none)

    def relative(compression: Any, load: Any) -> Any:
        loads = Loads(
            wheel_force=Vector(none, none, load),
            wheel_moment=no_force,
            spin_torque=none,
            strut=strut_force(compression, none, vehicle),
            body_force=still,
            gravity=gravity_in_plane(around),
        )
        motion = BodyMotion(still, still, none, none)
        places = wheel_places(compression, vehicle.chassis)
        return accelerations(places, motion, loads, vehicle.chassis).compression

    by_place, by_load = jax.jacfwd(relative, argnums=(0, 1))(rest.compression, rest.load)
    return -jnp.linalg.solve(by_place, by_load)


def in_the_turn(around: Surroundings, lateral_acceleration: Any) -> Surroundings:
    """The leaning gravity under which a vehicle in a steady turn is at rest in its own frame.

    `static_equilibrium` under it is the place of `cornering_gain`: the tyres share the lateral
    force as they share the load.

    Args:
        around: of level ground.
        lateral_acceleration: a_y, positive to the left [m/s^2].
    """
    gravity = jnp.hypot(lateral_acceleration, around.gravity)
    return replace(around, bank=jnp.arctan2(lateral_acceleration, around.gravity), gravity=gravity)


def cornering_gain(
    rest: Rest, vehicle: FullVehicle, around: Surroundings, speed: Any, lateral_acceleration: Any
) -> Any:
    """`static_gain` about steady cornering on level ground [m/N], [4, 4].

    About that place a tyre's load acts along the axes of the rolled body, the lateral forces keep
    their values and their points on the road, and the body turns with the yaw rate a_y / v.
    Filipozzi et al. 2021 linearise there in section 2. Pure.

    Args:
        rest: compressions, roll, pitch and loads in the turn, from `static_equilibrium` under
            `in_the_turn`.
        vehicle: parameters.
        around: of level ground, true gravity.
        speed: v [m/s].
        lateral_acceleration: a_y, positive to the left [m/s^2]; 0 for straight ahead.
    """
    none, zero = jnp.zeros_like(rest.compression), jnp.zeros_like(rest.z)
    frame = body_frame(rest.roll, rest.pitch, zero)
    axes = lift_frame(frame)
    down = gravity_in_plane(around)
    sideways = Vector(none, rest.load * (lateral_acceleration / around.gravity), none)
    height = vehicle.tire.vertical.unloaded_radius - rest.deflection
    moment = to_body(axes, cross(Vector(none, none, -height), sideways))
    still, turning = Vector(zero, zero, zero), Vector(zero, zero, lateral_acceleration / speed)
    motion = BodyMotion(still, to_body(frame, turning), none, none)

    def relative(compression: Any, load: Any) -> Any:
        loads = Loads(
            wheel_force=to_body(axes, Vector(none, sideways.y, load)),
            wheel_moment=moment,
            spin_torque=none,
            strut=strut_force(compression, none, vehicle),
            body_force=still,
            gravity=to_body(frame, down),
        )
        places = wheel_places(compression, vehicle.chassis)
        return accelerations(places, motion, loads, vehicle.chassis).compression

    by_place, by_load = jax.jacfwd(relative, argnums=(0, 1))(rest.compression, rest.load)
    return -jnp.linalg.solve(by_place, by_load)


def relative_gain_array(gain: Any) -> Any:
    """Relative gains G * (G^-1)^T, entry by entry: 1 on the diagonal where nothing couples.

    Bristol 1966; Filipozzi et al. 2021, Eq. 1.

    Args:
        gain: steady-state gain G from inputs (columns) to outputs (rows), [n, n].
    """
    return gain * jnp.linalg.inv(gain).T


@lru_cache(maxsize=1)
def _compiled() -> tuple[Any, Any]:
    return staged_jit(static_equilibrium), staged_jit(vertical_system)


def _order(names: tuple[str, ...]) -> np.ndarray:
    """Places of the named entries in a raveled dictionary, whose keys are sorted."""
    sizes = {name: 4 if name.startswith("compression") else 1 for name in names}
    begins, at = {}, 0
    for name in sorted(names):
        begins[name] = at
        at += sizes[name]
    return np.concatenate([begins[name] + np.arange(sizes[name]) for name in names])


def _pairs(values: np.ndarray) -> list[tuple[int, int]]:
    """Indices of conjugate eigenvalues; real ones pair from the ends, slowest with fastest."""
    real = np.abs(values.imag) <= 1e-9 * np.abs(values)
    above = [int(k) for k in np.flatnonzero(~real & (values.imag > 0))]
    pairs = [(k, int(np.argmin(np.abs(values - values[k].conj())))) for k in above]
    slow = [int(k) for k in sorted(np.flatnonzero(real), key=lambda k: abs(values[k]))]
    return pairs + [(slow[k], slow[-1 - k]) for k in range(len(slow) // 2)]


def _name(shape: np.ndarray, vehicle: FullVehicle) -> str:
    """The motion with most kinetic energy; wheels count by their own vertical motion."""
    c = jax.tree.map(np.asarray, vehicle.chassis)
    places = jax.tree.map(np.asarray, wheel_places(jnp.zeros(4), vehicle.chassis))
    wheel = shape[0] + shape[1] * places.y - shape[2] * places.x + shape[3:]
    m = c.wheel_mass
    energy = {
        "heave": c.body_mass * abs(shape[0]) ** 2,
        "roll": c.roll_inertia * abs(shape[1]) ** 2,
        "pitch": c.pitch_inertia * abs(shape[2]) ** 2,
        "front hop": 0.5 * m[0] * abs(wheel[0] + wheel[1]) ** 2,
        "front tramp": 0.5 * m[0] * abs(wheel[0] - wheel[1]) ** 2,
        "rear hop": 0.5 * m[2] * abs(wheel[2] + wheel[3]) ** 2,
        "rear tramp": 0.5 * m[2] * abs(wheel[2] - wheel[3]) ** 2,
    }
    return max(energy, key=lambda name: float(energy[name]))
