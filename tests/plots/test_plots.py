"""Figures carry labels with units, and what they draw is the data."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from wheelhop.estimators.pressure_estimate import PressureEstimate
from wheelhop.evaluation.errors import error_statistics
from wheelhop.evaluation.innovations import InnovationReport
from wheelhop.plots import plot_campaign, plot_estimate, plot_innovations, plot_log, plot_road
from wheelhop.plots.estimate import moving_average
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import Profile, fit_iso8608, profile_psd

T = 0.01 * np.arange(1, 401)


def estimate():
    rng = np.random.default_rng(0)
    share = rng.dirichlet(np.ones(4), size=400)
    missing = np.zeros(400, int)
    missing[100:130] = 2
    return PressureEstimate(
        T,
        2e5 + T,
        1e4 + T,
        2e5 + T,
        1e4 + T,
        tuple("ABCD"),
        share,
        rng.chisquare(2, 400),
        missing,
        missing > 5,
        np.zeros(400, int),
    )


def record():
    rng = np.random.default_rng(1)
    return CornerRecord(T, rng.normal(size=400), rng.normal(size=400), T + 9, np.full(400, 2e5))


def road():
    profile = Profile(0.1, np.cumsum(np.random.default_rng(2).normal(size=2000)) * 1e-3)
    spectrum = profile_psd(profile)
    return plot_road(profile, spectrum, fit_iso8608(spectrum), "a road")


def campaign():
    error = np.random.default_rng(3).normal(size=(20, 400)) * 1e4
    statistics = error_statistics(error, np.full(error.shape, 1e4))
    return plot_campaign(T, error, statistics, np.full(400, 5.0), np.full(400, 1.0))


def innovations():
    rng = np.random.default_rng(4)
    report = InnovationReport(
        names=("a_s", "a_u"),
        normalised=rng.normal(size=(400, 2)),
        autocorrelation=np.vstack([np.ones((1, 2)), 0.05 * rng.normal(size=(20, 2))]),
        whiteness_bound=np.full(2, 0.1),
        nis=rng.chisquare(2, 400),
        dof=np.where(np.arange(400) < 30, 0, 2),
        mean_nis=1.01,
        mean_nis_band=(0.9, 1.1),
        outside=np.zeros(2),
        probability=0.95,
    )
    return plot_innovations(report, 0.002)


FIGURES = {
    "innovations": innovations,
    "estimate": lambda: plot_estimate(estimate(), record()),
    "log": lambda: plot_log(record()),
    "road": road,
    "campaign": campaign,
}


@pytest.mark.parametrize("name", FIGURES)
def test_every_axis_has_a_label_with_a_unit(name, tmp_path):
    figure = FIGURES[name]()
    assert isinstance(figure, Figure)
    for ax in figure.axes:
        assert "[" in ax.get_ylabel()
    assert "[" in figure.axes[-1].get_xlabel()
    figure.savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_pressure_is_drawn_in_kilopascal():
    top = plot_estimate(estimate(), record()).axes[0]
    lines = {line.get_label(): line.get_ydata() for line in top.lines}
    np.testing.assert_allclose(lines["estimate"], estimate().pressure / 1e3)
    np.testing.assert_allclose(lines["true"], 200.0)


def test_moving_average_ignores_gaps_and_keeps_the_ends():
    values = np.array([1.0, 2.0, np.nan, 4.0, 5.0])
    np.testing.assert_allclose(moving_average(values, 3), [1.5, 1.5, 3.0, 4.5, 4.5])
    assert np.isnan(moving_average(np.full(9, np.nan), 3)).all()
