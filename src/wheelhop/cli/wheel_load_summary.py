"""What `wheelhop wheel-load` says of the loads: figures for each wheel, and a verdict."""

from __future__ import annotations

from typing import Any

import numpy as np

from wheelhop.estimators.joint_load_scales import RUNAWAY
from wheelhop.estimators.load_methods import LoadsFound
from wheelhop.vehicle.full_vehicle_parameters import CORNERS
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY

LIFTED = 0.1
"""Share of the load at rest at or below which, two sigma included, a wheel counts as lifted."""

_WEIGHT_TOLERANCE = 0.03
_EQUAL = 5e-4
_FEW_INSIDE = 0.8
_NIS_RATIO = 1.5
_TELLS_LITTLE = 0.2


def summary_of(
    found: LoadsFound, truth: np.ndarray | None, settled: float, body_mass: float | None = None
) -> dict[str, Any]:
    """Figures of the loads from a time on; forces in N, None where unknown.

    Args:
        found: the loads.
        truth: true loads [N], [time, 4], or None.
        settled: time from which they count [s].
        body_mass: sprung mass of the vehicle as it was given [kg], or None.
    """
    counts = found.t >= settled
    t, load, sigma = found.t[counts], found.load[counts], found.sigma[counts]
    true = None if truth is None else truth[counts]
    wheels = {
        corner: _wheel(
            t,
            load[:, k],
            sigma[:, k],
            None if true is None else true[:, k],
            float(found.static[k]),
        )
        for k, corner in enumerate(CORNERS)
    }
    lowest = min(wheels, key=lambda corner: wheels[corner]["lowest_N"])
    total, weight = found.total[counts], float(found.static.sum())
    return {
        "from_s": settled,
        "wheels": wheels,
        "lowest": {
            "wheel": lowest,
            "load_N": wheels[lowest]["lowest_N"],
            "sigma_N": wheels[lowest]["lowest_sigma_N"],
            "at_s": wheels[lowest]["lowest_at_s"],
        },
        "weight_N": weight,
        "mean_sum_N": float(np.nanmean(total)),
        "sum_over_weight": float(np.nanmean(total)) / weight - 1.0,
        "mean_sigma_of_sum_N": _mean(found.total_sigma[counts]),
        "rmse_of_sum_N": None if true is None else _rms(total - true.sum(1)),
        **_believed(found, counts, body_mass),
    }


def _believed(found: LoadsFound, counts: np.ndarray, given: float | None) -> dict[str, Any]:
    """What the joint filter finds beside the loads."""
    if found.joint is None:
        return {}
    scales: dict[str, Any] = {}
    if found.joint.scale is not None and found.joint.scale_sigma is not None:
        for k, name in enumerate(("springs", "dampers")):
            scales[f"{name}_scale"] = float(found.joint.scale[k])
            scales[f"{name}_scale_sigma"] = float(found.joint.scale_sigma[k])
    return scales | {
        "body_mass_kg": float(found.joint.body_mass[-1]),
        "body_mass_sigma_kg": float(found.joint.body_mass_sigma[-1]),
        "given_body_mass_kg": given,
        "mean_nis": float(np.mean(found.joint.nis[counts])),
        "mean_samples_at_once": float(np.mean(found.joint.freedom[counts])),
    }


def _wheel(
    t: np.ndarray, load: np.ndarray, sigma: np.ndarray, true: np.ndarray | None, static: float
) -> dict[str, Any]:
    row = int(np.nanargmin(load))
    dt = float(np.median(np.diff(t)))
    both = np.isfinite(load) & np.isfinite(sigma)
    low, top = load[both] - 2.0 * sigma[both], load[both] + 2.0 * sigma[both]
    told = bool(both.any())
    if true is not None:
        both &= np.isfinite(true)
    inside = None
    if true is not None and both.any():
        inside = float(np.mean(np.abs(load - true)[both] <= 2.0 * sigma[both]))
    return {
        "static_N": static,
        "mean_N": float(np.nanmean(load)),
        "lowest_N": float(load[row]),
        "lowest_at_s": float(t[row]),
        "lowest_sigma_N": float(sigma[row]) if np.isfinite(sigma[row]) else None,
        "highest_N": float(np.nanmax(load)),
        "mean_sigma_N": _mean(sigma),
        "lifted_s": dt * float(np.sum(top <= LIFTED * static)) if told else None,
        "may_have_lifted_s": dt * float(np.sum(low <= 0.0)) if told else None,
        "rmse_N": None if true is None else _rms(load - true),
        "share_within_2_sigma": inside,
        "true_lowest_N": None if true is None else float(np.nanmin(true)),
    }


def verdict_of(results: dict[str, Any]) -> str:
    """In plain words: lowest load, lift, the sum beside the weight, and what speaks against it."""
    low = results["lowest"]
    sigma = "" if low["sigma_N"] is None else f" +- {low['sigma_N']:,.0f}"
    excess = results["sum_over_weight"]
    side = f"{100 * abs(excess):.1f} % {'above' if excess >= 0 else 'below'} the weight"
    words = (
        f"lowest load {low['load_N']:,.0f}{sigma} N at {low['wheel']}, {low['at_s']:.2f} s; "
        f"sum of loads {'equals the weight' if abs(excess) < _EQUAL else side}"
    )
    lines = [words, _lift(results), *_doubts(results)]
    if abs(excess) > _WEIGHT_TOLERANCE:
        lines.append(_why_beside_weight(results))
    return "\n".join(lines)


def _why_beside_weight(results: dict[str, Any]) -> str:
    """What a sum over a whole drive that is not the weight comes from."""
    given = results.get("given_body_mass_kg")
    if given is not None:
        more = results["body_mass_kg"] - given
        sigma = results["body_mass_sigma_kg"]
        unexplained = results["mean_sum_N"] - results["weight_N"] - more * STANDARD_GRAVITY
        if abs(unexplained) < _WEIGHT_TOLERANCE * results["weight_N"] and abs(more) > 2.0 * sigma:
            return (
                f"the sprung mass found is {abs(more):,.0f} +- {sigma:.0f} kg "
                f"{'more' if more > 0 else 'less'} than the {given:,.0f} kg of the vehicle given, "
                "which is the sum's difference: a payload, or another vehicle"
            )
    return (
        "the sum over a whole drive is the weight: look for a payload, compressions that are "
        "not counted from the design place, or another vehicle"
    )


def _doubts(results: dict[str, Any]) -> list[str]:
    """What the truth, where it is known, and the innovations say against the loads."""
    lines = []
    wheels = results["wheels"].items()
    few = [
        f"{corner} {100 * share:.0f} %"
        for corner, wheel in wheels
        if (share := wheel["share_within_2_sigma"]) is not None and share < _FEW_INSIDE
    ]
    if few:
        lines.append(
            "sigma is too small for the errors: the true loads lie within two sigma at "
            f"{', '.join(few)} of the samples, where 95 % should"
        )
    for name in ("springs", "dampers"):
        scale, sigma = results.get(f"{name}_scale"), results.get(f"{name}_scale_sigma")
        if scale is None or sigma is None:
            continue
        if not 1.0 / RUNAWAY < scale < RUNAWAY:
            lines.append(
                f"the {name} seem {scale:.3g} times as strong as the vehicle's, which explains "
                "nothing: the loads are not to be trusted; check a_x, a_y and --vehicle"
            )
        elif sigma > _TELLS_LITTLE * scale:
            lines.append(
                f"this drive tells little of the {name}: braking and cornering do, not coasting"
            )
    if "mean_nis" in results:
        ratio = results["mean_nis"] / results["mean_samples_at_once"]
        if not 1.0 / _NIS_RATIO <= ratio <= _NIS_RATIO:
            lines.append(
                f"the innovations are {'larger' if ratio > 1 else 'smaller'} than the filter "
                f"expects, NIS {results['mean_nis']:.1f} where "
                f"{results['mean_samples_at_once']:.0f} fits: check --noise, --compression-noise "
                "and --vehicle"
            )
    return lines


def _lift(results: dict[str, Any]) -> str:
    wheels = {c: w for c, w in results["wheels"].items() if w["lifted_s"] is not None}
    if not wheels:
        return "whether a wheel lifts cannot be told: the method says no sigma"
    sure = {c: w["lifted_s"] for c, w in wheels.items() if w["lifted_s"] > 0.0}
    perhaps = [c for c, w in wheels.items() if c not in sure and w["may_have_lifted_s"] > 0.0]
    words = []
    if sure:
        spans = ", ".join(f"{corner} for {time:.2g} s" for corner, time in sure.items())
        words.append(
            f"off the ground or nearly: {spans} below {100 * LIFTED:.0f} % of the load at rest"
        )
    if perhaps:
        words.append(f"may have lifted, zero being within two sigma: {', '.join(perhaps)}")
    return "; ".join(words) or "no wheel lifts"


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def _mean(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else None
