"""The report of the fused drive says what its numbers say; the drive itself is long."""

from dataclasses import replace

import numpy as np
import pytest

from wheelhop.io.report import FAILS, HOLDS
from wheelhop.studies.frame import Store
from wheelhop.studies.solmaz.fusion import Course, FusionDemo, fusion_demo
from wheelhop.studies.solmaz.fusion_report import (
    fusion_figures,
    fusion_findings,
    fusion_in_words,
    fusion_numbers,
    fusion_tables,
)
from wheelhop.studies.solmaz.settings import QUICK

TIME = np.linspace(5.0, 60.0, 40)
TRUE = np.array([180e3, 230e3, 230e3, 230e3])


def course(pressure, sd, low):
    """Beliefs that do not change."""
    return Course(*(np.tile(np.asarray(a, float), (len(TIME), 1)) for a in (pressure, sd, low)))


def invented():
    """As the estimators might have it: each half sure, both sure."""
    vertical = course([198e3, 233e3, 234e3, 231e3], [12e3] * 4, [0.35, 0.01, 0.01, 0.02])
    lateral = course([176e3, 205e3, 220e3, 219e3], [25e3] * 4, [0.78, 0.3, 0.1, 0.1])
    fused = course([181e3, 231e3, 232e3, 230e3], [9e3] * 4, [0.95, 0.004, 0.002, 0.003])
    nothing = np.zeros((len(TIME), 4))
    a_y = 3.0 * np.sin(TIME)
    return FusionDemo(TIME, a_y, TRUE, vertical, lateral, fused, np.full(len(TIME), 1.7), nothing)


def test_surer_and_closer_holds():
    found = fusion_findings(invented())
    assert [f.verdict for f in found] == [HOLDS, HOLDS]
    assert "vertical alone 0.35; lateral alone 0.78; both 0.95" in found[0].measured
    assert "both off by +1 kPa, stated 9" in found[1].measured


def test_a_fusion_that_blames_every_tyre_does_not_hold():
    wrong = course([181e3] * 4, [9e3] * 4, [0.5, 0.6, 0.7, 0.8])
    assert fusion_findings(replace(invented(), fused=wrong))[0].verdict == FAILS


def test_an_error_beyond_what_is_stated_is_no_success():
    sharp = course([120e3, 230e3, 230e3, 230e3], [9e3] * 4, [0.95, 0.0, 0.0, 0.0])
    assert fusion_findings(replace(invented(), fused=sharp))[1].verdict != HOLDS


def test_a_pressure_farther_from_the_truth_than_one_alone_is_no_success():
    far = course([194e3, 231e3, 232e3, 230e3], [9e3] * 4, [0.95, 0.004, 0.002, 0.003])
    assert fusion_findings(replace(invented(), fused=far))[1].verdict != HOLDS


def test_table_figure_and_numbers_hold_every_tyre():
    result = invented()
    (table,) = fusion_tables(result)
    assert table.columns["both [kPa]"][0] == "181 +- 9"
    (figure,) = fusion_figures(result)
    assert len(figure.figure.axes) >= 6
    assert figure.units["both_FL"] == "Pa"
    np.testing.assert_allclose(figure.columns["both_FL"], 181e3)
    assert fusion_numbers(result)["both"]["probability_low"][0] == 0.95
    assert "180, 230, 230, 230 kPa" in fusion_in_words(QUICK)[0]


@pytest.mark.slow
def test_a_quick_drive_of_both_estimators():
    result = fusion_demo(QUICK, Store(None), lambda done, total: None)
    assert np.isfinite(result.fused.pressure).all()
    assert result.fused.low[-1, 0] > 0.5
