"""`wheelhop simulate`: a log of a virtual corner, or of a full vehicle, on any road."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import typer

from wheelhop.cli.corner_report import report_corner
from wheelhop.cli.corner_road import measured_rise, random_rise
from wheelhop.cli.session import Precision, Seed, command, computing, provenance
from wheelhop.cli.simulate_vehicle import DriveChoice, simulate_drive
from wheelhop.cli.vehicle import load_vehicle
from wheelhop.cli.vehicle_road import CONTACTS, RoadChoice
from wheelhop.errors import InputError, require_in_range
from wheelhop.io.results import require_writable
from wheelhop.io.roads import read_road
from wheelhop.vehicle import sensors
from wheelhop.vehicle.drives import DRIVES
from wheelhop.vehicle.full_vehicle_parameters import VEHICLES
from wheelhop.vehicle.scenario import SUBSTEPS, Leak, drive
from wheelhop.vehicle.sensors import Sensor

_FULL = f"Choose a full vehicle, as --vehicle {next(iter(VEHICLES))}."
_OTHER_ROAD = "Use --track and --reflect with a measured road, the others with iso:A to iso:H."

_REMEDIES = {
    "--pressure": "Give --pressures FL,FR,RL,RR, as 230,230,180,230.",
    "--end-pressure": "Give --end-pressures FL,FR,RL,RR.",
    "--convention": "Leave it out: its random roads follow ISO 8608.",
    "--pressures": f"Give --pressure. {_FULL}",
    "--end-pressures": f"Give --end-pressure. {_FULL}",
}

_RANDOM_ROAD_DURATION = 10.0


@command
def simulate(
    road: Annotated[
        str | None,
        typer.Option(help="x_m, z_m table, .crg, iso:A to iso:H or iso:LEVEL; vehicle: flat too."),
    ] = None,
    pressure: Annotated[
        float | None, typer.Option(help="Corner: tyre pressure [kPa]; default 180.")
    ] = None,
    end_pressure: Annotated[
        float | None, typer.Option(help="Corner: pressure at the end, reached linearly [kPa].")
    ] = None,
    speed: Annotated[
        float | None, typer.Option(help="Speed [km/h]; default 60, or that of the maneuver.")
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(help="Length of the log [s]; default that of the road or maneuver, or 10 s."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(help="Sampling rate [Hz]; default 500, vehicle 1000.")
    ] = None,
    track: Annotated[str | None, typer.Option(help="Elevation column of the road.")] = None,
    reflect: Annotated[
        bool, typer.Option("--reflect", help="Continue a short road there and back.")
    ] = False,
    waviness: Annotated[
        float | None, typer.Option(help="Synthesise iso:X by spectrum with this waviness.")
    ] = None,
    convention: Annotated[
        str | None,
        typer.Option(help="Corner: level of a random road: iso8608 (default) or brancati2022."),
    ] = None,
    noise: Annotated[
        float | None, typer.Option(help="Accelerometer noise [m/s^2]; default 0.5.")
    ] = None,
    bias: Annotated[float, typer.Option(help="Accelerometer bias [m/s^2].")] = 0.0,
    resolution: Annotated[float, typer.Option(help="Quantisation step [m/s^2].")] = 0.0,
    dropout: Annotated[
        float, typer.Option(help="Probability of a lost accelerometer sample.")
    ] = 0.0,
    vehicle: Annotated[
        str | None,
        typer.Option(help=f"TOML of a corner, or a full vehicle: {', '.join(VEHICLES)}."),
    ] = None,
    maneuver: Annotated[
        str | None, typer.Option(help=f"Vehicle: {', '.join(DRIVES)}; default the first.")
    ] = None,
    peak: Annotated[
        float | None, typer.Option(help="Vehicle: lateral acceleration of a lane change [g].")
    ] = None,
    pressures: Annotated[
        str | None, typer.Option(help="Vehicle: FL,FR,RL,RR [kPa], as 230,230,180,230.")
    ] = None,
    end_pressures: Annotated[
        str | None, typer.Option(help="Vehicle: pressures at the end, reached linearly [kPa].")
    ] = None,
    contact: Annotated[
        str | None,
        typer.Option(help=f"Vehicle: tyre on the road: {', '.join(CONTACTS)}; default the second."),
    ] = None,
    tire: Annotated[
        Path | None, typer.Option(help="Vehicle: slip forces of a tyre property file (.tir).")
    ] = None,
    anti_roll: Annotated[
        bool | None, typer.Option("--anti-roll/--no-anti-roll", help="Vehicle suv: with its bars.")
    ] = None,
    ppy1: Annotated[
        float | None,
        typer.Option(
            "--ppy1", help="Vehicle: change of cornering stiffness with pressure, as 0.9."
        ),
    ] = None,
    animate: Annotated[
        bool | None, typer.Option("--animate", help="Vehicle: draw an animation as well.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="Corner: log to write, or a directory; vehicle: directory. "
            "Default wheelhop-log.parquet, wheelhop-drive.",
        ),
    ] = None,
    seed: Seed = 0,
    precision: Precision = "float64",
) -> None:
    """Simulate the log of one corner, or of a full vehicle in a maneuver, over a road.

    One corner touches the road in a point and goes straight at constant speed. A full vehicle
    has 14 degrees of freedom. The log carries the true pressure, so that `wheelhop estimate`
    can tell its own error.

    Example: wheelhop simulate --road road.csv --pressure 180 --speed 60 --out drive.csv

    Example: wheelhop simulate --vehicle suv --maneuver lane-change --road iso:B --animate
    """
    sensor = Sensor(0.5 if noise is None else noise, bias, resolution, dropout)
    corner_only = {
        "--pressure": pressure,
        "--end-pressure": end_pressure,
        "--convention": convention,
    }
    vehicle_only = {
        "--maneuver": maneuver,
        "--peak": peak,
        "--pressures": pressures,
        "--end-pressures": end_pressures,
        "--contact": contact,
        "--tire": tire,
        "--anti-roll/--no-anti-roll": anti_roll,
        "--ppy1": ppy1,
        "--animate": animate,
    }
    if vehicle is not None and vehicle in VEHICLES:
        _refuse(corner_only, f"the full vehicle {vehicle}")
        choice = DriveChoice(
            vehicle=vehicle,
            maneuver=maneuver or "straight",
            road=RoadChoice(road or "flat", track, reflect, waviness, contact or "moving-average"),
            pressures=pressures,
            end_pressures=end_pressures,
            speed=speed,
            peak=peak,
            duration=duration,
            rate=rate,
            sensor=sensor,
            tire=tire,
            anti_roll=anti_roll,
            ppy1=ppy1,
            animate=bool(animate),
        )
        simulate_drive(choice, out or Path("wheelhop-drive"), seed, precision)
        return
    _require_known(vehicle)
    _refuse(vehicle_only, "a single corner")
    pressure = 180.0 if pressure is None else pressure
    out = out or Path("wheelhop-log.parquet")
    if road is None:
        raise InputError("--road", "it is missing", "Name a table of x_m, z_m, or iso:A to iso:H.")
    random = road.lower().startswith("iso:")
    measured_only = {"--track": track, "--reflect": reflect or None}
    random_only = {"--waviness": waviness, "--convention": convention}
    _refuse(measured_only if random else random_only, f"the road {road}", _OTHER_ROAD)
    convention = convention or "iso8608"
    speed = 60.0 if speed is None else speed
    rate = 500.0 if rate is None else rate
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
        car, name = load_vehicle(None if vehicle is None else Path(vehicle))
        sensor = sensors.validate("sensor", sensor)
        road_key, sensor_key = jax.random.split(jax.random.key(seed))
        if random:
            seconds = duration or _RANDOM_ROAD_DURATION
            rise = random_rise(
                road_key, road[4:], metres_per_second, seconds, rate, waviness, convention
            )
        else:
            profile, track = read_road(Path(road), track)
            once = profile.length / metres_per_second
            seconds = duration or np.floor(once * rate) / rate
            rise = measured_rise(profile, metres_per_second, seconds, rate, reflect)
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
        "sensor_noise_m_per_s2": sensor.noise,
        "sensor_bias_m_per_s2": bias,
        "sensor_resolution_m_per_s2": resolution,
        "sensor_dropout_probability": dropout,
        "seed": seed,
    }
    title = f"{Path(road).name}, {speed:g} km/h, {pressure:g} kPa"
    report_corner(log, out, record, title, provenance("simulate", precision, **settings))


def _require_known(vehicle: str | None) -> None:
    if vehicle is not None and Path(vehicle).suffix != ".toml" and not Path(vehicle).exists():
        raise InputError(
            "--vehicle",
            f"{vehicle!r} is neither a full vehicle nor a file",
            f"Use {', '.join(VEHICLES)}, or the TOML of a corner.",
        )


def _refuse(strangers: Mapping[str, object], kind: str, remedy: str | None = None) -> None:
    """Refuse options of the other kind of vehicle, or of road."""
    for option, value in strangers.items():
        if value is not None:
            cure = remedy or _REMEDIES.get(option, _FULL)
            raise InputError(option, f"{kind} does not take it", cure)
