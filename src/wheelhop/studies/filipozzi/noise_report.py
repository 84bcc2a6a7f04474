"""Chapter on noisy sensors: words, table, Fig. 10, the rough road, and numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from wheelhop.io.report import DataTable
from wheelhop.plots.load_noise import NoisyLoad, plot_noisy_loads
from wheelhop.studies.filipozzi.maneuvers import JOINT, JOINT_WHEEL, SETTLED
from wheelhop.studies.filipozzi.methods import DERIVATIVE, UNBIASED, YOULA
from wheelhop.studies.filipozzi.noise import JOINT_RUNS, SENSORS, Noise, Noisy
from wheelhop.studies.filipozzi.noise_claims import HELD, WHITE, measured, noise_findings
from wheelhop.studies.filipozzi.sensed import DATASHEET_NOISE, PAPER_NOISE
from wheelhop.studies.filipozzi.settings import CORRELATION_TIME, FilipozziSettings
from wheelhop.studies.frame import StudyFigure

__all__ = ["noise_figures", "noise_findings", "noise_in_words", "noise_numbers", "noise_tables"]

_KEYS = {
    YOULA: "youla",
    UNBIASED: "unbiased",
    DERIVATIVE: "derivative",
    JOINT: "joint",
    JOINT_WHEEL: "joint_wheel",
}
_BRAKING, _ROUGH = (0.5, 4.0), (4.0, 5.5)


def noise_in_words(settings: FilipozziSettings) -> tuple[str, ...]:
    """What was done."""
    held, white = SENSORS[PAPER_NOISE], SENSORS[DATASHEET_NOISE]
    return (
        f"The braking of Fig. 5a, {settings.runs} times with the paper's noise: Gaussian numbers "
        f"of {held.acceleration_noise:g} m/s^2 on the body's accelerations and "
        f"{1e3 * held.deflection_noise:.2g} mm on the deflections, each held for "
        f"{1e3 * CORRELATION_TIME:g} ms, which is how a band-limited white noise of the printed "
        "densities is made. And a class C road at 80 km/h, which the paper does not drive, with "
        f"the noise of data sheets: {white.acceleration_noise:g} m/s^2 and "
        f"{1e3 * white.deflection_noise:g} mm, new in every sample at {settings.rate:g} Hz.",
        f"Every estimator believes in white noise of the true size. Quarter cars let "
        f"{settings.bandwidth:g} Hz pass with -3 dB; the paper does not tell how its unbiased "
        "filter differentiates the deflection, here it is behind two equal poles. The joint "
        f"filter runs {min(settings.runs, JOINT_RUNS)} times, once with the paper's sensors and "
        f"once with accelerometers on the wheel carriers too. Errors count from {SETTLED:g} s on.",
    )


def noise_tables(result: Noise) -> list[DataTable]:
    """Errors and deviations of every estimator in both cases."""
    rows = [(case, m, one) for case, found in result.found.items() for m, one in found.items()]
    columns: dict[str, list[Any]] = {
        "case": [case for case, _, _ in rows],
        "estimator": [method for _, method, _ in rows],
        "rms error [N]": [f"{measured(one, 'rmse'):.0f}" for *_, one in rows],
        "noise in the estimate [N]": [f"{measured(one, 'spread'):.0f}" for *_, one in rows],
        "stated standard deviation [N]": [f"{measured(one, 'stated'):.0f}" for *_, one in rows],
        "within two stated [%]": [f"{100 * measured(one, 'inside'):.1f}" for *_, one in rows],
        "runs": [int(one.runs) for *_, one in rows],
    }
    note = (
        "Over four corners and all runs. Noise: standard deviation about the run without noise. "
        "The joint filter states all that it knows to be uncertain, not the noise alone."
    )
    return [DataTable("Noise in the estimated loads", columns, note)]


def noise_figures(result: Noise) -> Iterator[StudyFigure]:
    """Fig. 10, and the class C road."""
    yield _figure(
        result,
        HELD,
        (YOULA, UNBIASED, JOINT),
        _BRAKING,
        "figure_10",
        _noise_in_words(result.found[HELD], (YOULA, UNBIASED, JOINT)),
        "Fig. 10: front left load while braking from sensors with the paper's noise, first run. "
        "The joint filter is not in the paper.",
    )
    yield _figure(
        result,
        WHITE,
        (YOULA, JOINT, JOINT_WHEEL),
        _ROUGH,
        "noise_on_a_rough_road",
        "On a rough road: " + _errors_in_words(result.found[WHITE], (YOULA, JOINT, JOINT_WHEEL)),
        "Front left load on a class C road at 80 km/h from sensors with the noise of data sheets, "
        "first run.",
    )


def _figure(
    result: Noise,
    case: str,
    methods: tuple[str, ...],
    window: tuple[float, float],
    name: str,
    title: str,
    caption: str,
) -> StudyFigure:
    drive, found = result.drives[case], result.found[case]
    time, true = drive.t, drive.load[:, 0]
    panels = {
        _headline(method, found[method]): NoisyLoad(found[method].first, found[method].first_sigma)
        for method in methods
    }
    columns = {"time": time, "true": true}
    for method, one in found.items():
        key = _KEYS[method]
        columns |= {key: one.first, f"{key}_sigma": one.first_sigma, f"{key}_clean": one.clean}
    units = {column: "s" if column == "time" else "N" for column in columns}
    return StudyFigure(
        name, plot_noisy_loads(time, true, panels, window, title), columns, units, caption
    )


def _noise_in_words(found: dict[str, Noisy], methods: tuple[str, ...]) -> str:
    spread = {m: measured(found[m], "spread") for m in methods}
    ordered = sorted(spread, key=spread.__getitem__)
    return f"Noise in the load while braking: least by {ordered[0]}, most by {ordered[-1]}"


def _errors_in_words(found: dict[str, Noisy], methods: tuple[str, ...]) -> str:
    rmse = {m: measured(found[m], "rmse") for m in methods}
    ordered = sorted(rmse, key=rmse.__getitem__)
    return "rms error least by " + ", then ".join(f"{m} ({rmse[m]:.0f} N)" for m in ordered)


def _headline(method: str, one: Noisy) -> str:
    rmse, spread, stated = (measured(one, name) for name in ("rmse", "spread", "stated"))
    return f"{method}: rms error {rmse:.0f} N, noise {spread:.0f} N, states {stated:.0f} N"


def noise_numbers(result: Noise) -> dict[str, Any]:
    """For results.json; SI units, shares as fractions."""
    names = ("rmse", "spread", "stated", "inside")
    return {
        case: {
            method: {name: measured(one, name) for name in names} | {"runs": int(one.runs)}
            for method, one in found.items()
        }
        for case, found in result.found.items()
    }
