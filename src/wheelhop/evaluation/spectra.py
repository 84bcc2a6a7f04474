"""Spectral matrices of what the accelerometers of a wheel, or of an axle pair, measure.

The linear quarter car on a random road is a Gaussian process that its spectral matrix describes
completely. Everything here is float64 NumPy, whatever JAX's precision, with exact derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from wheelhop.errors import require_in_range
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.road.iso8608 import road_velocity_intensity
from wheelhop.vehicle.tire import require_stiff, stiffness_from_pressure

FOLDS = 8
"""Sampling folds back what lies about this many multiples of the sampling rate, on both sides,
summed one by one; what lies beyond them folds back too, by its asymptote (`_beyond`)."""

RESOLUTION = 0.1
"""Widest frequency step [Hz]; the resonances are ten times wider."""

CORNER_UNKNOWNS = ("k_t", "m_s", "k_s", "c_s", "m_u")
"""What one wheel has of its own, as logarithms."""

ROAD_UNKNOWNS = ("level", "waviness")
"""What wheels share: the logarithm of the level, and the waviness."""


class IsoRoad(NamedTuple):
    """A random road whose elevation has the PSD Gd(W) = level (W / W0)^-waviness, W0 = 1 rad/m.

    Attributes:
        level: Gd(W0) [m^3/rad].
        waviness: w [-].
    """

    level: float
    waviness: float = 2.0


class SampledSpectrum(NamedTuple):
    """Spectral matrix of m sampled signals and its derivatives.

    Attributes:
        frequency: midpoints of equal bins between 0 and the Nyquist frequency [Hz], [f].
        density: two-sided, noise included [(m/s^2)^2/Hz], Hermitian, [f, m, m].
        slopes: derivative of the density along each unknown, [f, m, m]: logarithms, but for the
            waviness [-] and the delay [s].
    """

    frequency: np.ndarray
    density: np.ndarray
    slopes: Mapping[str, np.ndarray]


class _Response(NamedTuple):
    value: np.ndarray
    slopes: dict[str, np.ndarray]


def corner_spectrum(
    car: QuarterCar,
    pressure: float,
    road: IsoRoad,
    speed: float,
    noise: tuple[float, float] = (0.5, 0.5),
    rate: float = 500.0,
) -> SampledSpectrum:
    """Spectral matrix of a_s and a_u of one wheel, sampled without an anti-aliasing filter.

    S(f) = sum_k |H|^2 G at f + k rate, plus the noise's variance over the rate: the accelerations
    are read at an instant, as a simulated log reads them, so what lies above the Nyquist frequency
    folds back. H of the linear car from road velocity to accelerations; G the road's velocity,
    pi level v (2 pi f / v)^(2 - w).

    Args:
        car: the corner; the linear terms of its suspension, see `linearisation`. The tyre's damper
            is left out, as estimators on an unknown road do: sampled at an instant, what it hands
            on of a road that is white in velocity would have no finite variance.
        pressure: of the tyre [Pa].
        road: level and waviness.
        speed: v [m/s].
        noise: standard deviations of the samples of a_s and a_u [m/s^2].
        rate: sampling rate [Hz].

    Raises:
        InputError: for a road, speed, pressure, noise or rate out of range.
    """
    require_drive(car, pressure, road, speed, noise, rate)
    frequency, folded = _grid(rate)
    intensity, road_slopes = road_velocity_psd(road, speed, folded)
    beyond = _beyond(car, pressure, road, speed, frequency, rate)
    density, slopes = _auto(corner_response(car, pressure, folded), intensity, road_slopes, beyond)
    return SampledSpectrum(frequency, density + _noise(noise, rate), slopes)


def pair_spectrum(
    cars: tuple[QuarterCar, QuarterCar],
    pressures: tuple[float, float],
    road: IsoRoad,
    speed: float,
    delay: float,
    coherence: float,
    noise: tuple[float, float] = (0.5, 0.5),
    rate: float = 500.0,
) -> SampledSpectrum:
    """Spectral matrix of a_s, a_u of a front wheel, then of the rear wheel in its track.

    Both roads have the same spectrum; the rear one is the front one `delay` later, with the cross
    spectrum front to rear coherence G exp(2 pi i f delay). See `corner_spectrum` for the rest.

    Args:
        cars: front and rear corner.
        pressures: of their tyres [Pa].
        road: level and waviness.
        speed: v [m/s].
        delay: from front to rear [s], wheelbase over speed.
        coherence: amplitude, 0 to 1: the front explains its square of the rear road's power.
        noise: standard deviations of the samples of a_s and a_u [m/s^2].
        rate: sampling rate [Hz].

    Returns:
        Density [f, 4, 4]. Unknowns of a wheel are named "k_t front", "k_t rear" and so on; level,
        waviness and "delay" [s] are shared.

    Raises:
        InputError: for a road, speed, delay, coherence, pressure, noise or rate out of range.
    """
    for car, pressure in zip(cars, pressures, strict=True):
        require_drive(car, pressure, road, speed, noise, rate)
    require_in_range("coherence", coherence, 0.0, 1.0, "(no unit)")
    require_in_range("delay", delay, 0.0, 60.0, "s")
    frequency, folded = _grid(rate)
    intensity, road_slopes = road_velocity_psd(road, speed, folded)
    front, rear = (corner_response(c, p, folded) for c, p in zip(cars, pressures, strict=True))
    shift = coherence * np.exp(2j * np.pi * folded * delay)
    cross = {"": _folded_product(front.value, rear.value, intensity * shift)}
    for name in CORNER_UNKNOWNS:
        cross[f"{name} front"] = _folded_product(front.slopes[name], rear.value, intensity * shift)
        cross[f"{name} rear"] = _folded_product(front.value, rear.slopes[name], intensity * shift)
    for name in ROAD_UNKNOWNS:
        slope = intensity * road_slopes[name] * shift
        cross[name] = _folded_product(front.value, rear.value, slope)
    turned = 2j * np.pi * folded * intensity * shift
    cross["delay"] = _folded_product(front.value, rear.value, turned)

    blocks = [
        _auto(wheel, intensity, road_slopes, _beyond(c, p, road, speed, frequency, rate))
        for wheel, c, p in zip((front, rear), cars, pressures, strict=True)
    ]
    none = np.zeros_like(cross[""])

    def of(first: np.ndarray, second: np.ndarray, name: str) -> np.ndarray:
        between = cross[name]
        return np.block([[first, between], [np.conj(between.swapaxes(1, 2)), second]])

    slopes = {"delay": of(none, none, "delay")}
    for name in CORNER_UNKNOWNS:
        slopes[f"{name} front"] = of(blocks[0][1][name], none, f"{name} front")
        slopes[f"{name} rear"] = of(none, blocks[1][1][name], f"{name} rear")
    for name in ROAD_UNKNOWNS:
        slopes[name] = of(blocks[0][1][name], blocks[1][1][name], name)
    density = of(blocks[0][0], blocks[1][0], "") + _noise((*noise, *noise), rate)
    return SampledSpectrum(frequency, density, slopes)


def corner_response(car: QuarterCar, pressure: float, frequency: np.ndarray) -> _Response:
    """Road velocity to a_s and a_u of the linear car, and its derivatives, [2, ...] each.

    With s = 2 pi i f, c = k_s + c_s s and b = m_s s^2 + c:
    H = s k_t [c, b] / ((m_u s^2 + k_t) b + c m_s s^2).
    """
    s = 2j * np.pi * frequency
    m_s, m_u = float(car.sprung_mass), float(car.unsprung_mass)
    k_s, c_s = float(car.suspension.stiffness), float(car.suspension.damping)
    k_t = float(stiffness_from_pressure(pressure, car.tire))
    square = s * s
    coupling = k_s + c_s * s
    body = m_s * square + coupling
    wheel = m_u * square + k_t
    below = wheel * body + coupling * m_s * square
    above = np.stack([coupling, body])
    value = s * k_t * above / below
    zero, one = np.zeros_like(s), np.ones_like(s)
    by_coupling = wheel + m_s * square
    # derivatives of numerator [c, b] and of the denominator
    changes = {
        "m_s": (m_s, np.stack([zero, square]), square * (wheel + coupling)),
        "k_s": (k_s, np.stack([one, one]), by_coupling),
        "c_s": (c_s, np.stack([s, s]), s * by_coupling),
        "m_u": (m_u, np.stack([zero, zero]), square * body),
    }
    slopes = {
        name: p * (s * k_t * numerator - value * denominator) / below
        for name, (p, numerator, denominator) in changes.items()
    }
    slopes["k_t"] = value * (1.0 - k_t * body / below)
    return _Response(value, slopes)


def road_velocity_psd(
    road: IsoRoad, speed: float, frequency: np.ndarray
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Two-sided PSD of the road's velocity [m^2/s], and its relative slopes."""
    wavenumber = 2.0 * np.pi * np.abs(frequency) / speed
    white = float(road_velocity_intensity(road.level, speed))
    intensity = white * wavenumber ** (2.0 - road.waviness)
    return intensity, {"level": np.ones_like(wavenumber), "waviness": -np.log(wavenumber)}


def _beyond(
    car: QuarterCar,
    pressure: float,
    road: IsoRoad,
    speed: float,
    frequency: np.ndarray,
    rate: float,
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """What folds back onto the density of a_u from beyond the folds, [f], and its slopes.

    There a_u is the road's elevation times k_t / m_u, a power law whose sum over the folds is an
    integral (midpoint rule). a_s fades two powers faster, and the phase of the delay all but
    cancels the cross spectrum of two wheels.
    """
    w, cycle = road.waviness, 2.0 * np.pi
    k_t = float(stiffness_from_pressure(pressure, car.tire))
    white = float(road_velocity_intensity(road.level, speed))
    scale = (k_t / float(car.unsprung_mass)) ** 2 * white * speed ** (w - 2.0)
    total, by_waviness = np.zeros_like(frequency), np.zeros_like(frequency)
    for edge in (cycle * ((FOLDS + 0.5) * rate + way * frequency) for way in (-1.0, 1.0)):
        part = scale * edge ** (1.0 - w) / ((w - 1.0) * cycle * rate)
        total += part
        by_waviness += part * (np.log(speed) - np.log(edge) - 1.0 / (w - 1.0))
    none = np.zeros_like(total)
    slopes = {"k_t": 2.0 * total, "m_u": -2.0 * total, "level": total, "waviness": by_waviness}
    return total, {name: slopes.get(name, none) for name in (*CORNER_UNKNOWNS, *ROAD_UNKNOWNS)}


def _auto(
    response: _Response,
    intensity: np.ndarray,
    road_slopes: Mapping[str, np.ndarray],
    beyond: tuple[np.ndarray, Mapping[str, np.ndarray]],
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Spectral matrix of one wheel without noise, and its slopes."""
    density = _folded_product(response.value, response.value, intensity)
    slopes = {}
    for name, change in response.slopes.items():
        half = _folded_product(change, response.value, intensity)
        slopes[name] = half + np.conj(half.swapaxes(1, 2))
    for name, relative in road_slopes.items():
        slopes[name] = _folded_product(response.value, response.value, intensity * relative)
    density[:, 1, 1] += beyond[0]
    for name, tail in beyond[1].items():
        slopes[name][:, 1, 1] += tail
    return density, slopes


def _folded_product(left: np.ndarray, right: np.ndarray, density: np.ndarray) -> np.ndarray:
    """sum over the folds of left density right^H, [f, 2, 2]."""
    weighted, other = left * density, np.conj(right)
    entries = [[np.sum(one * two, 0) for two in other] for one in weighted]
    return np.moveaxis(np.array(entries), 2, 0)


def _grid(rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Midpoints up to the Nyquist frequency [f], and what folds onto them [folds, f]."""
    bins = max(round(0.5 * rate / RESOLUTION), 2500)
    frequency = 0.5 * rate / bins * (np.arange(bins) + 0.5)
    return frequency, frequency + rate * np.arange(-FOLDS, FOLDS + 1)[:, None]


def _noise(noise: tuple[float, ...], rate: float) -> np.ndarray:
    return np.diag(np.asarray(noise, float) ** 2 / rate)


def require_drive(
    car: QuarterCar,
    pressure: float,
    road: IsoRoad,
    speed: float,
    noise: tuple[float, float],
    rate: float,
) -> None:
    """Refuse a drive that no car makes, as `InputError`; arguments as of `corner_spectrum`."""
    require_in_range("speed", speed, 1.0, 100.0, "m/s")
    require_in_range("road level", road.level, 1e-8, 0.1, "m^3/rad")
    require_in_range("waviness", road.waviness, 1.2, 3.5, "(no unit)")
    require_in_range("pressure", pressure, 20e3, 1.5e6, "Pa")
    require_stiff(car.tire, pressure)
    require_in_range("rate", rate, 50.0, 20e3, "Hz")
    for value in noise:
        require_in_range("noise", value, 1e-6, 1e3, "m/s^2")
