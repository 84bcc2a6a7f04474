"""`wheelhop simulate`: a log of a virtual corner on a measured or random road."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import jax
import numpy as np
import typer

from wheelhop.cli.session import Precision, Seed, command, computing, console, provenance
from wheelhop.cli.vehicle import VehicleFile, load_vehicle
from wheelhop.errors import InputError, require_in_range
from wheelhop.io.logs import write_log
from wheelhop.io.results import output_directory, require_writable, write_figure, write_json
from wheelhop.io.roads import read_road
from wheelhop.plots import plot_log
from wheelhop.vehicle import sensors
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import Profile, class_level, synthesise
from wheelhop.vehicle.road.shape_filter import stationary_variance
from wheelhop.vehicle.scenario import (
    SUBSTEPS,
    Leak,
    constant_travel,
    drive,
    road_rise_from_profile,
    road_rise_of_class,
)
from wheelhop.vehicle.sensors import Sensor

_RANDOM_ROAD_DURATION = 10.0
_SYNTHESIS_SPACING = 0.02


@command
def simulate(
    road: Annotated[str, typer.Option(help="x_m, z_m table, or iso:A to iso:H.")],
    pressure: Annotated[float, typer.Option(help="Tyre pressure [kPa].")] = 180.0,
    end_pressure: Annotated[
        float | None, typer.Option(help="Pressure at the end, reached linearly [kPa].")
    ] = None,
    speed: Annotated[float, typer.Option(help="Vehicle speed [km/h].")] = 60.0,
    duration: Annotated[
        float | None, typer.Option(help="Length of the log [s]; default the road once, or 10 s.")
    ] = None,
    rate: Annotated[float, typer.Option(help="Sampling rate [Hz].")] = 500.0,
    track: Annotated[str | None, typer.Option(help="Elevation column of the road.")] = None,
    reflect: Annotated[
        bool, typer.Option("--reflect", help="Continue a short road there and back.")
    ] = False,
    waviness: Annotated[
        float | None, typer.Option(help="Synthesise iso:X by spectrum with this waviness.")
    ] = None,
    convention: Annotated[
        str, typer.Option(help="Level of iso:X: iso8608 or brancati2022.")
    ] = "iso8608",
    noise: Annotated[float, typer.Option(help="Accelerometer noise [m/s^2].")] = 0.5,
    bias: Annotated[float, typer.Option(help="Accelerometer bias [m/s^2].")] = 0.0,
    resolution: Annotated[float, typer.Option(help="Quantisation step [m/s^2].")] = 0.0,
    dropout: Annotated[float, typer.Option(help="Probability of a lost sample.")] = 0.0,
    vehicle: VehicleFile = None,
    out: Annotated[
        Path, typer.Option("--out", help="Log to write (.csv, .parquet), or a directory for it.")
    ] = Path("wheelhop-log.parquet"),
    seed: Seed = 0,
    precision: Precision = "float64",
) -> None:
    """Simulate the log of one corner over a measured road profile or an ISO 8608 road.

    The tyre touches the road in a point and the vehicle goes straight at constant speed. The
    log carries the true pressure, so that `wheelhop estimate` can tell its own error.

    Example: wheelhop simulate --road road.csv --pressure 180 --speed 60 --out drive.csv
    """
    log = out if out.suffix in (".csv", ".parquet") else out / "log.parquet"
    require_writable(log.parent)
    if log.is_dir():
        raise InputError("--out", f"{log} is a directory", "Name a file, or another directory.")
    metres_per_second = speed / 3.6
    require_in_range("--speed", speed, 3.6, 360.0, "km/h")
    require_in_range("--pressure", pressure, 20.0, 1500.0, "kPa")
    if duration is not None:
        require_in_range("--duration", duration, 0.1, 36000.0, "s")
    require_in_range("--rate", rate, 50.0, 20e3, "Hz")
    with computing(precision):
        car, name = load_vehicle(vehicle)
        sensor = sensors.validate("sensor", Sensor(noise, bias, resolution, dropout))
        road_key, sensor_key = jax.random.split(jax.random.key(seed))
        if road.lower().startswith("iso:"):
            seconds = duration or _RANDOM_ROAD_DURATION
            rise = _random_road(
                road_key, road[4:], metres_per_second, seconds, rate, waviness, convention
            )
        else:
            profile, track = read_road(Path(road), track)
            once = profile.length / metres_per_second
            seconds = duration or np.floor(once * rate) / rate
            rise = _measured_road(profile, metres_per_second, seconds, rate, reflect, once)
        last = pressure if end_pressure is None else end_pressure
        leak = Leak(1e3 * pressure, 1e3 * last, 0.0, seconds)
        record, _ = drive(
            sensor_key, car, rise, leak, metres_per_second, rate, sensors=(sensor, sensor)
        )
    settings = {
        "road": road,
        "track": track,
        "reflect": reflect,
        "waviness": waviness,
        "convention": convention,
        "pressure_kPa": [pressure, last],
        "speed_km_per_h": speed,
        "rate_Hz": rate,
        "simulation_steps_per_sample": SUBSTEPS,
        "vehicle": name,
        "sensor_noise_m_per_s2": noise,
        "sensor_bias_m_per_s2": bias,
        "sensor_resolution_m_per_s2": resolution,
        "sensor_dropout_probability": dropout,
        "seed": seed,
    }
    title = f"{Path(road).name}, {speed:g} km/h, {pressure:g} kPa"
    _report(log, out, record, title, provenance("simulate", precision, **settings))


def _report(log: Path, out: Path, record: CornerRecord, title: str, made_by: dict) -> None:
    """Write the log, its figure and its summary, and say so."""
    directory = output_directory(log.parent)
    write_log(log, record)
    write_figure(log.with_suffix(".png"), plot_log(record, title))
    seconds = len(record.t) * record.dt
    results = {
        "duration_s": seconds,
        "samples": len(record.t),
        "distance_m": float(np.sum(record.v) * record.dt),
        "rms_a_s_m_per_s2": float(np.sqrt(np.nanmean(record.a_s**2))),
        "rms_a_u_m_per_s2": float(np.sqrt(np.nanmean(record.a_u**2))),
    }
    summary = directory / ("summary.json" if log.parent == out else f"{log.stem}.summary.json")
    write_json(summary, {**made_by, "results": results})
    console.print(
        f"{len(record.t)} samples over {seconds:.2f} s and {results['distance_m']:.1f} m; rms "
        f"body {results['rms_a_s_m_per_s2']:.2f} m/s^2, wheel "
        f"{results['rms_a_u_m_per_s2']:.2f} m/s^2"
    )
    console.print(f"wrote {log}, {log.with_suffix('.png').name} and {summary.name}", soft_wrap=True)


def _random_road(
    key: Any,
    road_class: str,
    speed: float,
    duration: float,
    rate: float,
    waviness: float | None,
    convention: str,
) -> Any:
    """Rise per fine step of an ISO road: exact shape filter, or spectral for any waviness."""
    level = class_level(road_class)
    if waviness is None:
        samples = round(duration * rate)
        travel = constant_travel(speed, samples, rate)
        return road_rise_of_class(key, level, travel, convention)
    require_in_range("--waviness", waviness, 1.0, 4.0, "(no unit)")
    level *= stationary_variance(1.0, convention) / stationary_variance(1.0)
    length = speed * duration + 2.0
    z = synthesise(key, length, _SYNTHESIS_SPACING, level, waviness)
    profile = Profile(_SYNTHESIS_SPACING, np.asarray(z, float))
    return road_rise_from_profile(profile, speed, duration, rate)


def _measured_road(
    profile: Profile, speed: float, duration: float, rate: float, reflect: bool, once: float
) -> np.ndarray:
    if duration > once * (1 + 1e-9) and not reflect:
        raise InputError(
            "--duration",
            f"the road of {profile.length:g} m lasts {once:.3g} s at {3.6 * speed:g} km/h, "
            f"not {duration:g} s",
            "Give a shorter duration, or --reflect to continue the road there and back.",
        )
    if duration > once * (1 + 1e-9):
        console.print(f"the road of {profile.length:g} m is continued there and back (--reflect)")
    return road_rise_from_profile(profile, speed, duration, rate, reflect=reflect)
