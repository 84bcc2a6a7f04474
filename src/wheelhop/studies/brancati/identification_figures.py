"""Figures of the identification: what vehicle and quarter car do, and errors of every set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from wheelhop.plots.table3 import plot_norms, plot_overlay
from wheelhop.studies.brancati.identification import ALL, MORE, START, IdentificationStudy
from wheelhop.studies.corner_errors import unsprung_acceleration
from wheelhop.vehicle.record import CornerRecord

Records = Mapping[str, Sequence[CornerRecord]]

_SPEED = 60 / 3.6


def overlay_figure(study: IdentificationStudy, records: Records) -> Figure:
    """Wheel acceleration at the highest and lowest pressure, about 60 km/h, class B if it is there.

    Brancati & Tufano 2022, Fig. 5.
    """
    road_class, speed, drives = _chosen(study)
    ours, paper = f"ours {road_class}", f"paper {road_class}"
    panels = {}
    for k in drives:
        record = _record(study, records, road_class, k)
        rmse = {n: study.errors.rmse[list(study.cars).index(n), k, 1] for n in (ours, paper)}
        headline = (
            f"{study.scenarios[k].pressure / 1e3:g} kPa: RMSE {rmse[ours]:.2g} m/s² fitted, "
            f"{rmse[paper]:.2g} m/s² Table 3"
        )
        panels[headline] = {
            "full vehicle": record.a_u,
            "quarter car, fitted": unsprung_acceleration(study.cars[ours], record),
            "quarter car, Table 3": unsprung_acceleration(study.cars[paper], record),
        }
    title = f"Front-left wheel, class {road_class} road, {3.6 * speed:g} km/h"
    return plot_overlay(record.t, panels, title=title)


def overlay_columns(
    study: IdentificationStudy, records: Records
) -> tuple[dict[str, Any], dict[str, str]]:
    """The numbers of `overlay_figure` and their units."""
    road_class, _, drives = _chosen(study)
    parts: dict[str, list[np.ndarray]] = {}
    for k in drives:
        record = _record(study, records, road_class, k)
        columns = {
            "pressure": np.full(len(record.t), study.scenarios[k].pressure),
            "time": record.t,
            "vehicle": record.a_u,
            "fitted": unsprung_acceleration(study.cars[f"ours {road_class}"], record),
            "table_3": unsprung_acceleration(study.cars[f"paper {road_class}"], record),
        }
        for name, values in columns.items():
            parts.setdefault(name, []).append(np.asarray(values))
    units = dict.fromkeys(("vehicle", "fitted", "table_3"), "m/s^2")
    joined = {name: np.concatenate(values) for name, values in parts.items()}
    return joined, {"pressure": "Pa", "time": "s", **units}


def norms_figure(study: IdentificationStudy) -> Figure:
    """Norm of all errors of every set, by road class."""
    classes = study.settings.classes
    norms = {
        "start (default corner)": [study.norm(START, c) for c in classes],
        "Table 3, set of the class": [study.norm(f"paper {c}", c) for c in classes],
        "fitted to the class": [study.norm(f"ours {c}", c) for c in classes],
    }
    shared = {ALL: "fitted to all roads", MORE: "more parameters, all roads"}
    for name, label in shared.items():
        if name in study.cars:
            norms[label] = [study.norm(name, c) for c in classes]
    count = 2 * len(study.scenarios) // len(classes)
    return plot_norms(
        classes,
        norms,
        [study.measured_norm(c) for c in classes],
        f"Quarter car against full vehicle: norm of {count} RMSEs per road class",
    )


def _chosen(study: IdentificationStudy) -> tuple[str, float, list[int]]:
    """Road class, speed [m/s] and the scenarios of highest and lowest pressure."""
    classes = study.settings.classes
    road_class = "B" if "B" in classes else classes[0]
    rows = study.rows(road_class)
    speed = min((study.scenarios[k].speed for k in rows), key=lambda v: abs(v - _SPEED))
    drives = [int(k) for k in rows if study.scenarios[k].speed == speed]
    drives.sort(key=lambda k: -study.scenarios[k].pressure)
    return road_class, speed, list(dict.fromkeys((drives[0], drives[-1])))


def _record(
    study: IdentificationStudy, records: Records, road_class: str, scenario: int
) -> CornerRecord:
    return records[road_class][scenario - int(study.rows(road_class)[0])]
