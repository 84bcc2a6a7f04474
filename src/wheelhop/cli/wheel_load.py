"""`wheelhop wheel-load`: the loads of the four wheels from accelerometers and compressions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import jax
import typer

from wheelhop.cli.session import (
    OutDirectory,
    Precision,
    UnusedSeed,
    command,
    computing,
    console,
    escape,
    messages,
    progress_bar,
    provenance,
    say_files,
)
from wheelhop.cli.wheel_load_output import columns_of, describe, print_loads
from wheelhop.cli.wheel_load_summary import summary_of, verdict_of
from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.load_methods import (
    ALGEBRAIC,
    BANDWIDTH,
    JOINT,
    NAMES,
    SENSORS,
    YOULA,
    LoadsFound,
    loads_by,
)
from wheelhop.estimators.youla_design import passed_bandwidth
from wheelhop.estimators.youla_load import FASTEST, youla_params
from wheelhop.io.load_logs import LEVER_ARMS, SUSPENSION, read_load_log
from wheelhop.io.results import (
    output_directory,
    require_writable,
    write_figure,
    write_json,
    write_table,
)
from wheelhop.plots.wheel_load import plot_wheel_load
from wheelhop.vehicle.corner_suspension import corner_suspensions
from wheelhop.vehicle.full_vehicle_parameters import VEHICLES, suv, with_payload
from wheelhop.vehicle.full_vehicle_state import FullVehicle
from wheelhop.vehicle.load_record import LoadRecord

LOWEST_BANDWIDTH = 0.1
"""[Hz]."""

SETTLING = 0.3
"""Of a record, until what was before it no longer counts [s]."""


@command
def wheel_load(
    log: Annotated[
        Path,
        typer.Argument(
            help="CSV or Parquet: t, a_s_FL to a_s_RR, compression_FL to compression_RR, positive "
            "as the wheel moves up towards the body; a_u_FL to a_u_RR where there are any; a_x and "
            "a_y for --method algebraic and --find-springs."
        ),
    ],
    vehicle: Annotated[str, typer.Option(help=f"{', '.join(VEHICLES)}.")] = "suv",
    method: Annotated[str, typer.Option(help=f"{', '.join(NAMES)}.")] = JOINT,
    bandwidth: Annotated[
        float, typer.Option(help="Of youla and unbiased [Hz]: lower is calmer and later.")
    ] = BANDWIDTH,
    noise: Annotated[
        float, typer.Option(help="Of the vertical accelerometers [m/s^2].")
    ] = SENSORS.acceleration_noise,
    compression_noise: Annotated[float, typer.Option(help="Of the compressions [mm].")] = 1e3
    * SENSORS.deflection_noise,
    no_wheel_accelerometers: Annotated[
        bool,
        typer.Option("--no-wheel-accelerometers", help="Leave out a_u, which joint would use."),
    ] = False,
    find_springs: Annotated[
        bool,
        typer.Option(
            "--find-springs",
            help="Method joint: do not trust the rates of the vehicle's springs and dampers; a_x "
            "(forward) and a_y (to the left, noise 0.05 m/s^2) tell them while braking and "
            "cornering. The springs' force at the design place is taken as known.",
        ),
    ] = False,
    payload: Annotated[
        float, typer.Option(help="Load that the car is known to carry [kg].", min=0.0)
    ] = 0.0,
    anti_roll: Annotated[
        bool | None, typer.Option("--anti-roll/--no-anti-roll", help="Vehicle suv: with its bars.")
    ] = None,
    units: Annotated[
        Path | None,
        typer.Option(help="TOML with [units] and [columns]; default LOG.toml if there."),
    ] = None,
    out: OutDirectory = Path("wheelhop-wheel-load"),
    seed: UnusedSeed = 0,
    precision: Precision = "float64",
) -> None:
    """Tell the loads of the four wheels, how sure they are, and whether a wheel lifts.

    joint filters the four corners together with the vehicle's own springs and dampers; youla and
    unbiased take each axle with linear ones; algebraic is lever arms alone, for slow maneuvers.

    Example: wheelhop wheel-load drive/log.parquet --vehicle suv --out result

    Another: wheelhop simulate --vehicle suv --maneuver brake-step --out drive, then
    wheelhop wheel-load drive/log.parquet --method youla --bandwidth 10

    Stiffer springs than the vehicle's: wheelhop wheel-load drive/log.parquet --find-springs
    """
    require_writable(out)
    if method not in NAMES:
        raise InputError("--method", f"{method!r} is unknown", f"Use one of {', '.join(NAMES)}.")
    if find_springs and method != JOINT:
        raise InputError(
            "--find-springs", f"{method} takes the springs as given", f"Use --method {JOINT}."
        )
    require_in_range("--noise", noise, 1e-4, 100.0, "m/s^2")
    require_in_range("--compression-noise", compression_noise, 1e-4, 100.0, "mm")
    require_in_range("--payload", payload, 0.0, 3000.0, "kg")
    sensors = SENSORS._replace(acceleration_noise=noise, deflection_noise=1e-3 * compression_noise)
    with computing(precision):
        car = known_vehicle(vehicle, anti_roll, payload)
        record = read_load_log(log, units, LEVER_ARMS if method == ALGEBRAIC else SUSPENSION)
        if no_wheel_accelerometers:
            record = record.without_wheel_accelerometers()
        console.print(escape(describe(log.name, record, method)), soft_wrap=True)
        found = loads_told(method, record, car, bandwidth, sensors, find_springs)
        if method == YOULA:
            corner = jax.tree.map(lambda leaf: leaf[0], corner_suspensions(car))
            passed = passed_bandwidth(youla_params(corner, record.dt, bandwidth))
            console.print(f"loads are passed up to {passed:.3g} Hz (-3 dB), and late")
    settled = float(record.t[0]) + SETTLING
    results = summary_of(found, record.true_load, settled, float(car.chassis.body_mass))
    verdict = verdict_of(results)
    print_loads(results)
    console.print(verdict, soft_wrap=True)
    directory = output_directory(out)
    write_table(directory / "wheel_load.parquet", *columns_of(found, record.true_load))
    title = f"{log.name}, {method}: {verdict.splitlines()[0]}"
    figure = plot_wheel_load(found, record.true_load, settled, title)
    write_figure(directory / "wheel_load.png", figure)
    made_by = provenance(
        "wheel-load",
        precision,
        log=str(log),
        vehicle=vehicle,
        method=method,
        bandwidth_Hz=bandwidth,
        accelerometer_noise_m_per_s2=noise,
        compression_noise_mm=compression_noise,
        no_wheel_accelerometers=no_wheel_accelerometers,
        find_springs=find_springs,
        payload_kg=payload,
        anti_roll=anti_roll,
        seed=seed,
    )
    write_json(directory / "summary.json", {**made_by, "verdict": verdict, "results": results})
    say_files(directory, "wheel_load.png", "wheel_load.parquet", "summary.json")


def loads_told(
    method: str,
    record: LoadRecord,
    car: FullVehicle,
    bandwidth: float,
    sensors: LoadSensors,
    find_springs: bool = False,
) -> LoadsFound:
    """The loads, with a progress bar where the method takes long.

    Args:
        method: one of `NAMES`.
        record: of the sensors.
        car: parameters.
        bandwidth: of the methods of single corners and axles [Hz].
        sensors: their noise.
        find_springs: by the joint filter, which needs a_x and a_y.

    Raises:
        InputError: for a bandwidth that the sampling rate does not carry, or a log without a_x and
            a_y where they are needed.
    """
    if method == JOINT:
        with progress_bar("filtering (compiles first)", "samples of filters") as advance:
            return loads_by(method, record, car, bandwidth, sensors, advance, find_springs)
    if method != ALGEBRAIC:
        require_in_range("--bandwidth", bandwidth, LOWEST_BANDWIDTH, FASTEST / record.dt, "Hz")
    with messages.status("computing (compiles first)"):
        return loads_by(method, record, car, bandwidth, sensors)


def known_vehicle(name: str, anti_roll: bool | None, payload: float) -> FullVehicle:
    """The vehicle of a name.

    Args:
        name: a key of `VEHICLES`.
        anti_roll: with anti-roll bars or without; None for as it is.
        payload: at the body's centre of mass [kg].

    Raises:
        InputError: for an unknown vehicle, or bars that cannot be chosen.
    """
    if name not in VEHICLES:
        raise InputError(
            "--vehicle", f"{name!r} is no full vehicle", f"Use one of {', '.join(VEHICLES)}."
        )
    if anti_roll is not None and name != "suv":
        raise InputError(
            "--anti-roll/--no-anti-roll", f"{name} is as published", "Use it with suv."
        )
    car = VEHICLES[name]() if anti_roll is None else suv(anti_roll)
    return with_payload(car, payload) if payload else car
