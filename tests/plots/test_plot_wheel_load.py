"""The figure of the four wheels' loads."""

import numpy as np
import pytest

from wheelhop.estimators.load_methods import LoadsFound
from wheelhop.plots.wheel_load import plot_wheel_load

T = 0.01 * np.arange(500)
STATIC = np.array([5.2e3, 5.2e3, 4.7e3, 4.7e3])


def loads(sigma=100.0):
    swing = np.sin(2.0 * T)[:, None] * np.array([1.0, -1.0, 1.1, -0.9])
    load = STATIC + 2e3 * swing
    load[0] = 5e4
    spread = np.full((500, 4), sigma)
    return LoadsFound(T, load, spread, load.sum(1), np.full(500, 2.0 * sigma), STATIC)


def labels(ax):
    return ax.get_legend_handles_labels()[1]


def test_wheels_lie_as_on_the_car_and_the_lowest_load_is_marked_where_it_is():
    found = loads()
    truth = found.load + 50.0
    figure = plot_wheel_load(found, truth, 0.3, "drive")
    axes = figure.axes
    titles = [ax.get_title(loc="left") for ax in axes]
    assert titles[:4] == ["front left", "front right", "rear left", "rear right"]
    assert "the weight is 19.80 kN" in titles[4]
    places = [ax.get_subplotspec().rowspan.start for ax in axes]
    assert places == [0, 0, 1, 1, 2]
    assert axes[0].get_ylabel() == "load [kN]"
    assert axes[4].get_xlabel() == "time [s]"
    assert labels(axes[1]) == ["2 sigma", "estimate", "true", *labels(axes[1])[3:]]
    marks = [[text.get_text() for text in ax.texts if "lowest" in text.get_text()] for ax in axes]
    row = int(found.load[30:, 2].argmin()) + 30
    value = 1e-3 * found.load[row, 2]
    assert marks == [[], [], [f"lowest: {value:.2f} kN at {T[row]:.2f} s"], [], []]
    np.testing.assert_allclose(axes[3].lines[0].get_ydata(), 1e-3 * found.load[:, 3])
    np.testing.assert_allclose(axes[4].lines[0].get_ydata(), 1e-3 * found.total)


def test_all_wheels_share_an_axis_that_shows_zero_and_leaves_the_start_up_out():
    figure = plot_wheel_load(loads(), None, 0.3)
    limits = [ax.get_ylim() for ax in figure.axes[:4]]
    assert len(set(limits)) == 1
    assert limits[0][0] < 0
    assert 7.3 < limits[0][1] < 9.0


def test_without_sigma_or_truth_neither_is_drawn():
    figure = plot_wheel_load(loads(np.nan), None, 0.3)
    for ax in figure.axes:
        assert not ax.collections
        assert not {"true", "2 sigma"} & set(labels(ax))
        assert np.isfinite(ax.get_ylim()).all()


@pytest.mark.parametrize("missing", [slice(100, 200), slice(400, None)])
def test_loads_that_are_missing_leave_a_gap(missing):
    found = loads()
    found.load[missing] = np.nan
    found.total[missing] = np.nan
    figure = plot_wheel_load(found, None, 0.3)
    assert np.isnan(figure.axes[0].lines[0].get_ydata()[missing]).all()
    assert all(np.isfinite(ax.get_ylim()).all() for ax in figure.axes)
