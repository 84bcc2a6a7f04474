"""Chapters of design and mass: claims follow the numbers, and the numbers those of a hand."""

from dataclasses import replace

import numpy as np
import pytest

from wheelhop.studies.filipozzi.design import (
    BANDWIDTHS,
    HOP,
    Design,
    corner_frequency,
    design,
    needed_bandwidth,
)
from wheelhop.studies.filipozzi.design_report import (
    design_figures,
    design_findings,
    design_numbers,
    design_tables,
)
from wheelhop.studies.filipozzi.settings import FilipozziSettings
from wheelhop.studies.frame import Store


@pytest.fixture(scope="module")
def found() -> Design:
    return design(FilipozziSettings(), Store(None), lambda done, of: None)


def test_the_error_at_wheel_hop_is_that_of_the_low_pass(found):
    w0, s = 2 * np.pi * 30.0, 2j * np.pi * HOP
    tau = 0.1 / w0
    low_pass = w0**2 / ((s**2 + np.sqrt(2) * w0 * s + w0**2) * (tau * s + 1) ** 2)
    at = np.interp(30.0, BANDWIDTHS, found.hop_error)
    assert at == pytest.approx(abs(1 - low_pass), rel=1e-3)
    assert found.marked["sensitivity"][3] == pytest.approx(abs(1 - low_pass), rel=1e-9)
    assert corner_frequency(found) == pytest.approx(30.0, rel=0.02)
    needed = needed_bandwidth(found, 0.1)
    assert np.interp(needed, BANDWIDTHS, found.hop_error) <= 0.1
    assert np.isnan(needed_bandwidth(found, 1e-6))


def test_claims_follow_the_numbers(found):
    good, fast, strong = (f.verdict for f in design_findings(found))
    assert (good, fast, strong) == ("holds in part", "does not hold", "holds")
    small = found.marked | {"sensitivity": np.full(5, 0.01)}
    better = found._replace(marked=small)
    assert [f.verdict for f in design_findings(better)][:2] == ["holds", "holds"]
    blind = {k: o._replace(strongly_observable=False) for k, o in found.sensors.items()}
    assert design_findings(found._replace(sensors=blind))[2].verdict == "does not hold"


def test_tables_figures_and_numbers_are_whole(found):
    accuracy, sensors = design_tables(found)
    assert len(accuracy.rows) == 8
    assert len(sensors.rows) == 10
    figures = {f.name: f for f in design_figures(found)}
    assert set(figures) == {"figure_4", "hop_error"}
    panels = figures["figure_4"].figure.axes
    assert [ax.get_xlabel() for ax in panels] == ["frequency [Hz]"] * 3
    assert all(len({len(c) for c in f.columns.values()}) == 1 for f in figures.values())
    numbers = design_numbers(found)
    assert numbers["bandwidth_for_10_percent_at_hop_Hz"] == needed_bandwidth(found, 0.1)


def test_a_slower_design_is_later(found):
    slow = design(replace(FilipozziSettings(), bandwidth=15.0), Store(None), lambda d, o: None)
    assert slow.marked["sensitivity"][3] > found.marked["sensitivity"][3]
