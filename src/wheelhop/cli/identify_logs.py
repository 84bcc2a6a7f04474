"""Logs for `wheelhop identify`: read and named, pressure and road added where they lack one."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from wheelhop.errors import InputError, InputWarning, require_in_range
from wheelhop.identification import with_road
from wheelhop.io.logs import read_log
from wheelhop.io.roads import read_road
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road.profile import Profile
from wheelhop.vehicle.tire import require_stiff


def each_once(logs: Sequence[Path]) -> list[Path]:
    """The logs without those named before, which are warned of.

    Raises:
        InputError: if there is none.
    """
    if not logs:
        raise InputError("LOG", "there is none", "Name at least one log, as drive.parquet.")
    paths: dict[Path, Path] = {}
    for log in logs:
        if log.resolve() in paths:
            warnings.warn(f"{log}: it is given twice; used once.", InputWarning, stacklevel=2)
        paths.setdefault(log.resolve(), log)
    return list(paths.values())


def short_names(paths: Sequence[Path]) -> list[str]:
    """File names, or whole paths where two files have the same name."""
    short = [path.name for path in paths]
    return short if len(set(short)) == len(short) else [str(path) for path in paths]


def read_named_log(path: Path, units: Path | None, corner: str | None) -> CornerRecord:
    """A log, its refusal and its warnings told with its name: there may be many.

    Args:
        path: of the log.
        units: TOML file with units and column names, or None.
        corner: the one to read of a log of four, or None.

    Raises:
        InputError: as `read_log` does.
    """
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", InputWarning)
        try:
            record = read_log(path, units, corner)
        except InputError as error:
            if path.name in str(error):
                raise
            raise InputError(f"{path.name}: {error.field}", error.problem, error.remedy) from None
    for warning in told:
        warnings.warn(f"{path.name}: {warning.message}", InputWarning, stacklevel=2)
    return record


def with_pressure(
    records: Sequence[CornerRecord], names: Sequence[str], kpa: float | None
) -> list[CornerRecord]:
    """The records, those without a pressure with the stated one.

    Args:
        records: as read.
        names: of the records.
        kpa: stated pressure [kPa], or None.

    Raises:
        InputError: if a pressure is missing, or one is stated that no record needs.
    """
    if kpa is not None:
        require_in_range("--pressure", kpa, 20.0, 1500.0, "kPa")
        if all(_known(r.pressure) for r in records):
            raise InputError(
                "--pressure", "every log has its own column `pressure`", "Leave it out."
            )
    given = []
    for name, record in zip(names, records, strict=True):
        if _known(record.pressure):
            given.append(record)
        elif kpa is None:
            raise InputError(
                f"{name}: pressure",
                "the log has no such column",
                "Add the true pressure to the log, or state it by --pressure KPA.",
            )
        else:
            given.append(replace(record, pressure=np.full(len(record.t), 1e3 * kpa)))
    return given


def with_elevation(
    records: Sequence[CornerRecord],
    names: Sequence[str],
    road: Path | None,
    track: str | None,
    reflect: bool,
) -> list[CornerRecord]:
    """The records, those without an elevation with that of the measured road.

    Args:
        records: as read.
        names: of the records.
        road: profile to read, driven from x = 0, or None.
        track: its elevation column, or None.
        reflect: continue a road that is too short there and back.

    Raises:
        InputError: if a road is missing or too short, or one is named that no record needs.
    """
    lacking = [not _known(r.elevation) for r in records]
    if road is None:
        if track is not None or reflect:
            option = "--reflect" if reflect else "--track"
            raise InputError(option, "there is no measured road", "Name one by --road.")
        if any(lacking):
            raise InputError(
                f"{names[lacking.index(True)]}: elevation",
                "the log has no such column",
                "Add the road's elevation under the wheel to the log, name the measured road by "
                "--road ROAD.csv, or fit without a road by --blind.",
            )
        return list(records)
    if not any(lacking):
        raise InputError("--road", "every log has its own column `elevation`", "Leave it out.")
    profile, _ = read_road(road, track)
    return [
        _on_road(name, record, profile, reflect) if missing else record
        for name, record, missing in zip(names, records, lacking, strict=True)
    ]


def require_pressures(
    records: Sequence[CornerRecord], names: Sequence[str], car: QuarterCar
) -> None:
    """Raise `InputError` for a pressure that no tyre has, or at which this one has no stiffness."""
    for name, record in zip(names, records, strict=True):
        assert record.pressure is not None
        lowest = float(np.nanmin(record.pressure))
        for value in (lowest, float(np.nanmax(record.pressure))):
            require_in_range(f"{name}: pressure", value, 20e3, 1.5e6, "Pa")
        require_stiff(car.tire, lowest)


def _on_road(name: str, record: CornerRecord, profile: Profile, reflect: bool) -> CornerRecord:
    try:
        return with_road(record, profile, reflect)
    except InputError as error:
        remedy = "Cut the log, or let the road be continued there and back by --reflect."
        raise InputError(f"{name}: {error.field}", error.problem, remedy) from None


def _known(values: np.ndarray | None) -> bool:
    return values is not None and bool(np.isfinite(values).any())
