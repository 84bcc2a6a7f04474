"""Chapter of the Youla observer's design: claims, tables, figures, numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wheelhop.io.report import FAILS, HOLDS, IN_PART, DataTable, Finding
from wheelhop.plots.load_design import plot_hop_error, plot_singular_values
from wheelhop.studies.filipozzi.design import (
    BANDWIDTHS,
    FREQUENCIES,
    HOP,
    INTERVALS,
    MARKS,
    Design,
    corner_frequency,
    needed_bandwidth,
)
from wheelhop.studies.filipozzi.settings import FilipozziSettings
from wheelhop.studies.frame import StudyFigure

PAPER_SENSORS = ("body_acceleration", "deflection")

_LOW = 3.0
_SMALL, _SHARE = 0.2, 0.1


def design_in_words(settings: FilipozziSettings) -> tuple[str, ...]:
    """What was done."""
    return (
        f"A Butterworth low-pass of {settings.bandwidth:g} Hz and damping ratio 1/sqrt(2) with two "
        "further poles ten times as fast (the paper does not say where they are) shapes the closed "
        "loop of a front corner of our SUV. The observer that runs is the product Y of low-pass "
        "and polynomial inverse, discretised by the bilinear transform.",
        "Since the shaped loop is the same low-pass in every direction, both singular values of "
        "T_u, S_u and L_u are equal.",
    )


def design_findings(result: Design) -> list[Finding]:
    """What the paper says of the design, against what it is."""
    closed, error = (result.marked[n] for n in ("closed", "sensitivity"))
    low = [k for k, f in enumerate(MARKS) if f <= _LOW]
    flat = max(abs(20.0 * np.log10(closed[k])) for k in low)
    corner, wanted = corner_frequency(result), result.settings.bandwidth
    hop = MARKS.index(HOP)
    needed = needed_bandwidth(result, _SHARE)
    two, three = (result.sensors[s] for s in (PAPER_SENSORS, (*PAPER_SENSORS, "deflection_rate")))
    good_low = flat < 0.1 and error[low].max() < _SMALL
    return [
        Finding(
            "Section 3, Fig. 4",
            "Below the bandwidth T_u is 0 dB and S_u is small, which ensures good tracking.",
            f"T_u within {flat:.3f} dB and S_u at most {error[low].max():.2f} up to {_LOW:g} Hz; "
            f"-3 dB at {corner:.1f} Hz; at {HOP:g} Hz S_u is {error[hop]:.2f}.",
            HOLDS if good_low and error[hop] < _SMALL else IN_PART if good_low else FAILS,
            "A low-pass of second order is late by 2 zeta / w0 + 2 tau long before it damps: the "
            "size of the load is right and its phase is not.",
        ),
        Finding(
            "Section 3",
            f"A bandwidth of {wanted:g} Hz, faster than wheel hop at {HOP:g} Hz, is enough to "
            "capture the tyre's force.",
            f"A load that swings at {HOP:g} Hz is {100 * error[hop]:.0f} % wrong; "
            f"{needed:.0f} Hz would bring that to {100 * _SHARE:.0f} %.",
            HOLDS if error[hop] < _SHARE else FAILS,
            "Its amplitude is passed with "
            f"{100 * closed[hop]:.0f} %, but late; where the delay does not matter, or is taken "
            "off afterwards, it is enough.",
        ),
        Finding(
            "Section 4, Eq. 18",
            "With the body's acceleration and the deflection alone the corner is not strongly "
            "observable; the deflection's rate makes it so.",
            f"Rank {two.rank} of {two.columns} without, {three.rank} of {three.columns} with the "
            f"rate. {two.missing} {three.missing}",
            HOLDS if three.strongly_observable and not two.strongly_observable else FAILS,
            "Sampled, the two signals hide one motion that decays, so that a filter exists without "
            "the third; it rings near half the sampling rate.",
        ),
    ]


def design_tables(result: Design) -> list[DataTable]:
    """Accuracy of the discretisation, and what every set of sensors determines."""
    columns: dict[str, list[Any]] = {
        "sampling [ms]": [1e3 * dt for _ in result.discrete for dt in INTERVALS],
        "method": [m for m in result.discrete for _ in INTERVALS],
    }
    for k, mark in enumerate(MARKS):
        columns[f"error at {mark:g} Hz [%]"] = [
            100.0 * row[k] for rows in result.discrete.values() for row in rows
        ]
    sets = result.sensors
    return [
        DataTable(
            "Discretised Y against Y",
            columns,
            "Largest relative error of an entry of Y. At 1 kHz either method is far better than "
            "the delay of its low-pass; logs of 100 Hz need a smaller bandwidth.",
        ),
        DataTable(
            "Which sensors determine the load",
            {
                "sensors": [", ".join(s.replace("_", " ") for s in names) for names in sets],
                "rank of Eq. 18": [f"{o.rank} of {o.columns}" for o in sets.values()],
                "strongly observable": [
                    "yes" if o.strongly_observable else "no" for o in sets.values()
                ],
                "filter exists": ["yes" if o.usable else "no" for o in sets.values()],
            },
        ),
    ]


def design_figures(result: Design) -> Iterator[StudyFigure]:
    """Fig. 4, and the error at wheel hop over the bandwidth."""
    closed, error = (result.marked[n][MARKS.index(HOP)] for n in ("closed", "sensitivity"))
    columns: dict[str, Any] = {"frequency": FREQUENCIES}
    for name, values in result.values.items():
        columns |= {f"{name}_{k + 1}": values[:, k] for k in (0, 1)}
    yield StudyFigure(
        "figure_4",
        plot_singular_values(FREQUENCIES, result.values, result.settings.bandwidth, HOP),
        columns,
        {"frequency": "Hz"},
        f"Singular values, the larger solid and the smaller dashed. At wheel hop, {HOP:g} Hz, T_u "
        f"is {closed:.2f} and the error S_u {error:.2f} of the load's swing.",
    )
    yield StudyFigure(
        "hop_error",
        plot_hop_error(BANDWIDTHS, result.hop_error, result.settings.bandwidth, HOP),
        {"bandwidth": BANDWIDTHS, "error": result.hop_error},
        {"bandwidth": "Hz", "error": "1"},
        "What the delay of the low-pass costs at wheel hop.",
    )


def design_numbers(result: Design) -> dict[str, Any]:
    """Every figure; SI units."""
    return {
        "corner_frequency_Hz": corner_frequency(result),
        "bandwidth_for_10_percent_at_hop_Hz": needed_bandwidth(result, _SHARE),
        "marks_Hz": list(MARKS),
        **{name: list(map(float, values)) for name, values in result.marked.items()},
        "discretisation": {
            m: {f"{dt:g}": list(map(float, row)) for dt, row in zip(INTERVALS, rows, strict=True)}
            for m, rows in result.discrete.items()
        },
        "sensors": {
            "+".join(names): {
                "strongly_observable": o.strongly_observable,
                "usable": o.usable,
                "zeros": [abs(z) for z in o.zeros],
            }
            for names, o in result.sensors.items()
        },
    }
