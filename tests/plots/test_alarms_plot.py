"""The figure of four tyres and their alarms."""

import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.estimators.alarm_events import AlarmEvent
from wheelhop.plots.alarms import plot_alarms

T = np.linspace(0.0, 300.0, 301)
EVENT = AlarmEvent(
    "FR", 1, 120.0, float("nan"), 0.12, 0.02, 0.27, 0.25, "puncture", -400.0, 90.0, ""
)


def pressures():
    kpa = np.full((301, 4), 230e3)
    kpa[100:, 1] -= np.minimum(np.arange(201) * 600.0, 62e3)
    return kpa


def test_each_wheel_has_a_panel_and_the_alarm_is_on_its_own():
    figure = plot_alarms(T, pressures(), np.full((301, 4), 5e3), 230e3, [EVENT], truth=pressures())
    assert len(figure.axes) == 4
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert titles[1] == "front right: alarm"
    assert all("no alarm" in title for i, title in enumerate(titles) if i != 1)
    words = [text.get_text() for text in figure.axes[1].texts]
    assert any("alarm at 120 s" in w and "puncture" in w and "25 %" in w for w in words)
    assert figure.axes[0].get_ylabel() == "tyre pressure [kPa]"
    assert figure.axes[2].get_xlabel() == "time [s]"
    low, high = figure.axes[0].get_ylim()
    assert low < 165 < 235 < high


def test_a_lone_corner_and_beliefs_not_yet_there():
    kpa = pressures()[:, :1]
    kpa[:20] = np.nan
    figure = plot_alarms(T, kpa, np.full((301, 1), 5e3), 230e3, wheels=("RL",))
    assert figure.get_suptitle() == "No tyre is low"
    assert np.isfinite(figure.axes[0].get_ylim()).all()


def test_names_must_match_the_wheels():
    with pytest.raises(InputError, match="4 names for 2 wheels"):
        plot_alarms(T, pressures()[:, :2], np.full((301, 2), 5e3), 230e3)
