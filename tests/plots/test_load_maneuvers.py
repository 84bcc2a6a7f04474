"""Figures of wheel loads in maneuvers show every curve and number where it belongs."""

import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.plots.load_maneuvers import (
    plot_load_amplitude,
    plot_load_delay,
    plot_load_errors,
    plot_load_maneuver,
    plot_load_sum,
)

T = np.arange(1, 401) / 100.0
TRUTH = 5000.0 + 400.0 * np.sin(T)[:, None] * np.array([1.0, -1.0, 0.5, -0.5])
LOADS = {"Youla": TRUTH + 20.0, "algebraic": TRUTH - 300.0 * (T > 1.0)[:, None]}


def _curves(ax):
    return {line.get_label(): line.get_ydata() for line in ax.get_lines()}


def test_loads_start_and_errors_of_each_corner():
    spiked = TRUTH + 20.0 + 2e5 * (T[:, None] < 0.1)
    figure = plot_load_maneuver(T, TRUTH, LOADS | {"Youla": spiked}, "Braking", road=0.01 * TRUTH)
    figure.draw_without_rendering()
    wide, near, rear, _, error, start, _, _, road, hidden = figure.axes
    np.testing.assert_allclose(_curves(wide)["true"], TRUTH[:, 0] / 1e3)
    np.testing.assert_allclose(_curves(rear)["algebraic"], LOADS["algebraic"][:, 2] / 1e3)
    assert near.get_xlim() == (0.0, 0.2)
    # the spike of the start does not set any scale
    assert wide.get_ylim()[1] < 6.0
    # errors are scaled for all but the worst, which is said to be cut off
    assert error.get_ylim()[1] < 50.0
    assert any("algebraic" in text.get_text() for text in error.texts)
    np.testing.assert_allclose(_curves(error)["Youla"], 20.0)
    assert start.get_yscale() == "log"
    assert _curves(start)["Youla"].max() == pytest.approx(2e5 + 20.0)
    marks = [line for line in start.get_lines() if line.get_linestyle() == ":"]
    assert marks[0].get_ydata()[0] == pytest.approx(0.05 * TRUTH[0, 0])
    np.testing.assert_allclose(_curves(road)["road under RL"], 0.01 * TRUTH[:, 2])
    assert not hidden.get_visible()


def test_a_method_keeps_its_colour():
    def colour(loads):
        axes = plot_load_maneuver(T, TRUTH, loads).axes
        return {line.get_label(): line.get_color() for line in axes[0].get_lines()}

    both, alone = colour(LOADS | {"other": TRUTH}), colour({"algebraic": TRUTH})
    assert both["algebraic"] == alone["algebraic"]
    assert len(set(both.values())) == 4


def test_errors_stand_in_their_cells():
    errors = {"5a: braking": {"a": 12.0, "b": 40.0}, "road": {"a": 700.0, "b": 7.0}}
    figure = plot_load_errors(errors, {"5a: braking": 400.0, "road": 1000.0}, "Errors")
    figure.draw_without_rendering()
    ax = figure.axes[0]
    shown = {text.get_position(): text.get_text() for text in ax.texts}
    assert shown == {(0, 0): "12", (1, 0): "700", (0, 1): "40", (1, 1): "7"}
    np.testing.assert_allclose(
        ax.images[0].get_array(), np.log10([[0.03, 0.7], [0.1, 0.007]]), rtol=1e-9
    )
    assert "(400 N)" in ax.get_xticklabels()[0].get_text()


def test_delay_amplitude_and_sum():
    shift = np.arange(3) * 1e-3
    figure = plot_load_delay(T, TRUTH, {"Youla": LOADS["Youla"]}, shift, {"Youla": [9.0, 2.0, 5.0]})
    left, right = figure.axes
    np.testing.assert_allclose(_curves(left)["Youla"], LOADS["Youla"][:, 0] / 1e3)
    np.testing.assert_allclose(right.get_lines()[0].get_xdata(), [0.0, 1.0, 2.0])
    found = plot_load_amplitude([1.0, 2.0], [0.01, 0.02], {"true": np.array([100.0, 60.0])}, 1.3)
    np.testing.assert_allclose(_curves(found.axes[1])["true"], [10.0, 3.0])
    total = plot_load_sum({"braking": (T, T, 2.0 * T)})
    np.testing.assert_allclose(_curves(total.axes[0])["computed from the tilt"], 2.0 * T)


def test_other_shapes_are_refused():
    with pytest.raises(InputError, match="'short'"):
        plot_load_maneuver(T, TRUTH, {"short": TRUTH[1:]})
    with pytest.raises(InputError, match="Give one to 5"):
        plot_load_delay(T, TRUTH, {}, [0.0], {})
    with pytest.raises(InputError, match="one drive or more"):
        plot_load_errors({}, {})
    with pytest.raises(InputError, match="'b' lacks"):
        plot_load_errors({"a": {"m": 1.0}, "b": {}}, {"a": 1.0, "b": 1.0})
    with pytest.raises(InputError, match="one to six"):
        plot_load_amplitude([], [], {}, 1.0)
    with pytest.raises(InputError, match="one drive or more"):
        plot_load_sum({})
