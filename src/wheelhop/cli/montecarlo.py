"""`wheelhop montecarlo`: the estimator's errors over many random drives."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from wheelhop.cli.session import (
    OutDirectory,
    Precision,
    Seed,
    command,
    computing,
    console,
    headed_table,
    progress_bar,
    provenance,
    say_files,
)
from wheelhop.cli.vehicle import VehicleFile, load_vehicle
from wheelhop.estimators.immuf import Tuning
from wheelhop.evaluation.consistency import mean_band
from wheelhop.evaluation.errors import ErrorStatistics, error_statistics
from wheelhop.io.results import output_directory, write_figure, write_json, write_table
from wheelhop.montecarlo.campaign import finished_runs, run_campaign
from wheelhop.montecarlo.run import RunResult, report_times
from wheelhop.montecarlo.scenarios import CampaignSettings, validate_settings
from wheelhop.montecarlo.summary import summarise_campaign
from wheelhop.plots import plot_campaign


@command
def montecarlo(
    runs: Annotated[int, typer.Option(help="Number of independent runs.")] = 100,
    duration: Annotated[float, typer.Option(help="Length of each run [s].")] = 10.0,
    level_spread: Annotated[
        float,
        typer.Option(help="Roads off their class centre by up to this many classes (0.5: any)."),
    ] = 0.0,
    noise: Annotated[
        float, typer.Option(help="Accelerometer noise [m/s^2], which the filter knows.")
    ] = 0.5,
    convention: Annotated[
        str, typer.Option(help="Level of the classes: iso8608 or brancati2022.")
    ] = "iso8608",
    vehicle: VehicleFile = None,
    out: OutDirectory = Path("wheelhop-montecarlo"),
    seed: Seed = 0,
    precision: Precision = "float64",
) -> None:
    """Estimate over many random drives: 130-230 kPa, 40-80 km/h, road classes A-D.

    Finished runs are kept in OUT/runs; the same command resumes an interrupted campaign.

    Example: wheelhop montecarlo --runs 100 --seed 1 --out campaign
    """
    settings = validate_settings(
        CampaignSettings(
            runs=runs,
            duration=duration,
            level_spread=level_spread,
            noise=noise,
            convention=convention,
            tuning=Tuning(noise_a_s=noise, noise_a_u=noise),
            seed=seed,
        )
    )
    with computing(precision):
        car, name = load_vehicle(vehicle)
        directory = output_directory(out)
        if done := finished_runs(directory / "runs", settings, car):
            console.print(f"resuming: {done} of {runs} runs are in {directory / 'runs'} already")
        with progress_bar("Monte Carlo", "runs") as advance:
            result = run_campaign(settings, car, directory / "runs", advance)
    t = report_times(settings)
    statistics = error_statistics(result.error, result.sigma)
    summary = summarise_campaign(result, statistics, settings)
    console.print(_table(t, result, statistics))
    console.print(
        f"at the end: rms {summary['final_rms_error_Pa'] / 1e3:.1f} kPa (guessing the prior: "
        f"{summary['rms_error_of_the_prior_Pa'] / 1e3:.1f} kPa), stated sigma "
        f"{summary['final_mean_sigma_Pa'] / 1e3:.1f} kPa, "
        f"{summary['final_share_within_1_sigma']:.0%} of the runs inside it (68 % if honest)"
    )
    _write(directory, t, result, statistics, runs)
    made_by = provenance("montecarlo", precision, vehicle=name, **asdict(settings))
    write_json(directory / "summary.json", {**made_by, "results": summary})
    say_files(directory, "montecarlo.png", "montecarlo.parquet", "runs.parquet", "summary.json")


def _table(t: np.ndarray, result: RunResult, statistics: ErrorStatistics) -> Table:
    low, high = mean_band(5, len(result.error))
    table = headed_table(
        "time [s]",
        "mean error [kPa]",
        "std [kPa]",
        "stated sigma [kPa]",
        f"NEES (5; {low:.1f}-{high:.1f})",
        title="pressure error over runs",
    )
    for column in table.columns:
        column.justify = "right"
    for share in (0.05, 0.1, 0.2, 0.5, 1.0):
        k = max(0, round(share * len(t)) - 1)
        table.add_row(
            f"{t[k]:.2f}",
            f"{statistics.mean[k] / 1e3:.1f}",
            f"{statistics.std[k] / 1e3:.1f}",
            f"{statistics.sigma[k] / 1e3:.1f}",
            f"{result.nees[:, k].mean():.1f}",
        )
    return table


def _write(
    directory: Path, t: np.ndarray, result: RunResult, statistics: ErrorStatistics, runs: int
) -> None:
    low, high = mean_band(5, runs)
    over_time = {
        "t": t,
        "error_mean": statistics.mean,
        "error_std": statistics.std,
        "error_rms": statistics.rms,
        "sigma_mean": statistics.sigma,
        "nees_mean": result.nees.mean(axis=0),
        "nees_low": np.full(len(t), low),
        "nees_high": np.full(len(t), high),
        "nees_stiffness_mean": result.nees_stiffness.mean(axis=0),
        "true_class_probability_mean": result.true_class_probability.mean(axis=0),
    }
    units = {"t": "s"} | dict.fromkeys(("error_mean", "error_std", "error_rms", "sigma_mean"), "Pa")
    write_table(directory / "montecarlo.parquet", over_time, units)
    per_run = {
        "pressure": result.pressure,
        "speed": result.speed,
        "road_class": result.road_class,
        "road_level": result.level,
        "final_error": result.error[:, -1],
        "final_sigma": result.sigma[:, -1],
        "final_nees": result.nees[:, -1],
        "mean_nis": result.nis.mean(axis=1),
        "mean_true_class_probability": result.true_class_probability.mean(axis=1),
    }
    units = {"pressure": "Pa", "speed": "m/s", "road_level": "m^3/rad"}
    units |= {"final_error": "Pa", "final_sigma": "Pa"}
    write_table(directory / "runs.parquet", per_run, units)
    figure = plot_campaign(
        t,
        result.error,
        statistics,
        result.nees.mean(axis=0),
        result.nees_stiffness.mean(axis=0),
        f"IMM of four unscented filters, {runs} runs",
    )
    write_figure(directory / "montecarlo.png", figure)
