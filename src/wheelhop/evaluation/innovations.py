"""Are a filter's innovations white and as large as it says? Works without any truth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2, norm

from wheelhop.filtering import Info


class InnovationReport(NamedTuple):
    """Consistency of one record's innovations.

    Attributes:
        names: of the m measurement entries.
        normalised: innovation over its stated standard deviation [time, m], NaN where missing.
        autocorrelation: of each entry at lags 0, 1, ... [lags + 1, m].
        whiteness_bound: bound on |autocorrelation| of one lag for white innovations [m].
        nis: normalised innovation squared [time].
        dof: entries present [time], the NIS's degrees of freedom.
        mean_nis: mean NIS per degree of freedom; 1 if consistent.
        mean_nis_band: interval it stays in for a consistent filter.
        outside: share of lags 1, 2, ... outside the whiteness bound [m].
        probability: of the bounds.
    """

    names: tuple[str, ...]
    normalised: Float[np.ndarray, "time m"]
    autocorrelation: Float[np.ndarray, "lags m"]
    whiteness_bound: Float[np.ndarray, " m"]
    nis: Float[np.ndarray, " time"]
    dof: Int[np.ndarray, " time"]
    mean_nis: float
    mean_nis_band: tuple[float, float]
    outside: Float[np.ndarray, " m"]
    probability: float

    @property
    def consistent(self) -> bool:
        """Whether the mean NIS lies in its band and no entry leaves its whiteness bound often.

        Often: more than three times the share that chance allows.
        """
        low, high = self.mean_nis_band
        white = bool(np.all(self.outside <= 3.0 * (1.0 - self.probability)))
        return low <= self.mean_nis <= high and white


def innovation_report(
    info: Info, lags: int = 40, probability: float = 0.95, estimated_inputs: int = 0
) -> InnovationReport:
    """Judge the innovations of one record.

    White innovations with the stated covariance are what a filter has whose model is right
    (Kailath 1968; Bar-Shalom, Li & Kirubarajan 2001, section 5.4). The autocorrelation r_k is that
    of the normalised innovations, about zero; for white ones r_k ~ N(0, 1/N).

    Args:
        info: the steps' reports of one record, entries [time], as `drive.run` gives them.
        lags: largest lag of the autocorrelation, in samples.
        probability: of the bounds.
        estimated_inputs: degrees of freedom that each sample spends on unknown inputs; their
            number for `unknown_input`, whose projected innovations are not white entry by entry.

    An IMM's NIS is not chi-square (improbable modes widen its covariance): judge its members, or
    read the report as a comparison.

    Raises:
        ValueError: for a record not longer than `lags`, several records at once, or a
            probability outside (0, 1).
    """
    nis = np.asarray(info.nis, float)
    if nis.ndim != 1 or len(nis) <= lags or lags < 1:
        raise ValueError(
            f"lags={lags} with innovations of shape {nis.shape}: give one record [time] longer "
            "than the largest lag, which is at least 1"
        )
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability={probability}: give a number between 0 and 1")
    deviation = np.stack([np.asarray(v, float) for v in info.innovation], axis=1)
    variance = np.stack([np.asarray(row[-1], float) for row in info.innovation_cov], axis=1)
    m = deviation.shape[1]
    entries = m - np.asarray(info.flags.missing, int)
    dof = np.maximum(entries - estimated_inputs, 0)
    # a missing entry has innovation exactly 0
    present = (deviation != 0.0) | (entries == m)[:, None]
    normalised = np.where(present, deviation / np.sqrt(variance), np.nan)
    correlation = np.stack([_autocorrelation(column, lags) for column in normalised.T], axis=1)
    bound = norm.ppf(0.5 + 0.5 * probability) / np.sqrt(np.maximum(present.sum(axis=0), 1))
    total = int(dof.sum())
    tail = 0.5 * (1.0 - probability)
    low, high = chi2.ppf([tail, 1.0 - tail], total) / total if total else (np.nan, np.nan)
    return InnovationReport(
        names=tuple(info.innovation._fields),
        normalised=normalised,
        autocorrelation=correlation,
        whiteness_bound=bound,
        nis=nis,
        dof=dof,
        mean_nis=float(nis[dof > 0].sum() / total) if total else float("nan"),
        mean_nis_band=(float(low), float(high)),
        outside=np.mean(np.abs(correlation[1:]) > bound, axis=0),
        probability=probability,
    )


def _autocorrelation(values: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelation about zero at lags 0 .. lags; missing samples count as none."""
    filled = np.where(np.isfinite(values), values, 0.0)
    power = float(filled @ filled)
    products = [filled[k:] @ filled[: len(filled) - k] for k in range(lags + 1)]
    return np.asarray(products) / power if power > 0 else np.full(lags + 1, np.nan)
