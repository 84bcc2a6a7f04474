"""Tables of filters, their tuning and the misprints."""

from __future__ import annotations

from wheelhop.evaluation.tracking import TOLERANCE
from wheelhop.io.report import DataTable, Finding
from wheelhop.studies.brancati.claims import (
    ROADS,
    kpa,
    verdict_of,
)
from wheelhop.studies.brancati.contenders import FLOOR
from wheelhop.studies.brancati.study import ConventionResult, Validation


def misprint_findings(study: Validation) -> list[Finding]:
    """Section 3 as printed."""
    texts, works = [], []
    for convention, result in study.conventions.items():
        literal = result.misprints[0]
        texts.append(
            f"on {ROADS[convention]} median error {kpa(literal.median_error)} at the end, "
            f"{literal.finite:.0%} of the runs finite"
        )
        works.append(literal.finite == 1.0 and literal.median_error < 60e3)
    return [
        Finding(
            "Section 3, Eq. 9-12",
            "The interacting multiple model is given by the printed equations.",
            "taken literally: " + "; ".join(texts),
            verdict_of(works),
            "The printed weights of Eq. 10 and 11 do not sum to one: an improbable mode's state "
            "is nearly doubled in every step, the stiffness with it. The filter compared here as "
            "printed keeps every misprint but this one."
            if not all(works)
            else "The printed forms happen to do little harm with this tuning.",
        )
    ]


def misprint_table(result: ConventionResult) -> DataTable:
    """What each misprint does by itself."""
    effects = result.misprints
    return DataTable(
        f"Misprints one by one, {result.convention}",
        {
            "misprints kept": [e.name for e in effects],
            "finite runs [%]": [100.0 * e.finite for e in effects],
            "final RMSE [kPa]": [e.final_rmse / 1e3 for e in effects],
            "median error [kPa]": [e.median_error / 1e3 for e in effects],
            "stated sigma [kPa]": [e.sigma / 1e3 for e in effects],
            "NEES [-]": [e.nees for e in effects],
        },
        "All variants have the tuning of the filter as printed.",
    )


def comparison_table(result: ConventionResult) -> DataTable:
    """All filters on the Monte Carlo."""
    figures = dict(result.monte_carlo.figures)
    figures |= {n: f for n, f in result.untuned_monte_carlo.figures.items() if n != FLOOR}
    if result.second_monte_carlo is not None:
        figures |= {
            f"{name}, tuned for honest errors": f
            for name, f in result.second_monte_carlo.figures.items()
            if name != FLOOR
        }
    names = list(figures)
    return DataTable(
        f"All filters on {len(result.monte_carlo.truth)} runs, {result.convention}",
        {
            "filter": names,
            "final RMSE [kPa]": [figures[n].final_rmse.value / 1e3 for n in names],
            "low [kPa]": [figures[n].final_rmse.low / 1e3 for n in names],
            "high [kPa]": [figures[n].final_rmse.high / 1e3 for n in names],
            "bias [kPa]": [figures[n].final_bias / 1e3 for n in names],
            "inside one sigma [%]": [100 * figures[n].inside for n in names],
            "NEES at the end [-]": [float(figures[n].nees[-1]) for n in names],
            "lost runs": [figures[n].lost for n in names],
            "converged [%]": [100 * figures[n].converged for n in names],
            "convergence time [s]": [figures[n].convergence_time for n in names],
        },
        f"Converged: within {TOLERANCE / 1e3:g} kPa to the end; the constant guess does so where "
        "the truth happens to lie there.",
    )


def tuning_table(result: ConventionResult) -> DataTable:
    """What tuning did."""
    shown = [(f.name, f.tuned) for f in result.filters]
    shown += [(f"{f.name}, for honest errors", f.tuned) for f in result.second]
    return DataTable(
        f"Tuning by gradient, {result.convention}",
        {
            "filter": [n for n, _ in shown],
            "objective": [t.settings.objective for _, t in shown],
            "training, start": [t.start_train for _, t in shown],
            "training, tuned": [t.train for _, t in shown],
            "test, start": [t.start_test for _, t in shown],
            "test, tuned": [t.test for _, t in shown],
        },
        'In (kN/m)^2 for "mse", in nats per sample for "log_score". The test runs are those of '
        "the Monte Carlo.",
    )
