"""Figures of wrong springs and dampers draw what they are given, where it belongs."""

import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.plots.load_robustness import (
    LoadPair,
    plot_damping_robustness,
    plot_stiffness_robustness,
)

TIME = np.linspace(0.0, 4.0, 41)
SPEED = np.linspace(-0.5, 0.5, 11)


def pair(gain: float) -> LoadPair:
    change = np.where(TIME > 1.0, 1000.0, 0.0)
    return LoadPair(5000.0 + change, 5000.0 + gain * change)


def test_truth_is_solid_and_the_estimate_dashed():
    panels = {
        "from the free spring": {"soft": pair(2.0), "stiff": pair(0.5)},
        "from rest": {"soft": pair(2.0), "stiff": pair(0.5)},
    }
    figure = plot_stiffness_robustness(TIME, panels, 1.0, (0.5, 3.0), "Springs")
    figure.draw_without_rendering()
    assert [ax.get_title(loc="left") for ax in figure.axes] == list(panels)
    soft, soft_estimate, _, stiff_estimate, mark = figure.axes[1].lines
    assert (soft.get_linestyle(), soft_estimate.get_linestyle()) == ("-", "--")
    assert soft.get_color() == soft_estimate.get_color() != stiff_estimate.get_color()
    # kN, within the window alone
    assert soft_estimate.get_ydata().max() == pytest.approx(7.0)
    assert stiff_estimate.get_ydata().max() == pytest.approx(5.5)
    assert soft.get_xdata()[[0, -1]] == pytest.approx([0.5, 3.0])
    assert mark.get_xdata()[0] == 1.0
    shown = [text.get_text() for text in figure.legends[0].get_texts()]
    assert shown == ["soft", "stiff", "solid: truth", "dashed: estimate"]


def test_dampers_stand_beside_their_errors_and_maps():
    figure = plot_damping_robustness(
        TIME,
        {"half": pair(0.9), "own": pair(1.0)},
        pair(1.0).true,
        {"Youla": pair(0.8).estimated, "joint": pair(1.0).estimated},
        SPEED,
        {"nonlinear": 1e3 * np.tanh(SPEED), "linear": 1e3 * SPEED},
        1.0,
        (0.75, 2.75),
    )
    figure.draw_without_rendering()
    above, below, beside, law = figure.axes
    half, own = beside.lines[:2]
    assert half.get_ydata().min() == pytest.approx(-100.0)
    np.testing.assert_array_equal(own.get_ydata(), 0.0)
    assert len(above.lines) == 5
    names = [line.get_label() for line in below.lines[:3]]
    assert names == ["truth", "Youla", "joint"]
    assert below.lines[1].get_ydata().max() == pytest.approx(5.8)
    nonlinear, linear = law.lines
    np.testing.assert_allclose(nonlinear.get_ydata(), np.tanh(SPEED))
    np.testing.assert_allclose(linear.get_ydata(), SPEED)


def test_unequal_things_are_refused():
    window = (0.5, 3.0)
    with pytest.raises(InputError, match="no load to draw"):
        plot_stiffness_robustness(TIME, {}, 1.0, window)
    with pytest.raises(InputError, match="'rest' has"):
        plot_stiffness_robustness(
            TIME, {"free": {"soft": pair(1.0)}, "rest": {"stiff": pair(1.0)}}, 1.0, window
        )
    short = LoadPair(TIME, TIME[:-1])
    with pytest.raises(InputError, match="estimated"):
        plot_stiffness_robustness(TIME, {"free": {"soft": short}}, 1.0, window)
    with pytest.raises(InputError, match="holds no samples"):
        plot_stiffness_robustness(TIME, {"free": {"soft": pair(1.0)}}, 1.0, (5.0, 6.0))
    with pytest.raises(InputError, match="maps"):
        plot_damping_robustness(
            TIME, {"own": pair(1.0)}, TIME, {"a": TIME}, SPEED, {"own": TIME}, 1.0, window
        )
