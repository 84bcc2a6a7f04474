"""Chapter on noisy sensors: verdicts that can fall, and a report that is whole."""

import json

import numpy as np
import pytest

from wheelhop.io.report import FAILS, HOLDS, IN_PART
from wheelhop.studies.filipozzi.drives import Drive
from wheelhop.studies.filipozzi.maneuvers import JOINT, JOINT_WHEEL
from wheelhop.studies.filipozzi.methods import DERIVATIVE, UNBIASED, YOULA
from wheelhop.studies.filipozzi.noise import METHODS, Noise, Noisy
from wheelhop.studies.filipozzi.noise_claims import HELD, WHITE
from wheelhop.studies.filipozzi.noise_report import (
    noise_figures,
    noise_findings,
    noise_in_words,
    noise_numbers,
    noise_tables,
)
from wheelhop.studies.filipozzi.settings import QUICK

TIME = np.arange(1, 401) / 100.0
LOAD = 5000.0 + np.where(TIME >= 1.0, 1000.0 * (1.0 - np.exp(-(TIME - 1.0) / 0.2)), 0.0)


def verdicts(findings):
    return [finding.verdict for finding in findings]


def noise_of(numbers=None) -> Noise:
    """Results in which Youla is calm and every stated deviation true, unless told otherwise."""
    spread = {YOULA: 400.0, UNBIASED: 600.0, DERIVATIVE: 500.0, JOINT: 150.0, JOINT_WHEEL: 90.0}
    found = {}
    for case in (HELD, WHITE):
        found[case] = {}
        for method in METHODS:
            size = spread[method]
            figures = {"rmse": size, "spread": size, "stated": size, "inside": 0.9545}
            figures |= (numbers or {}).get((case, method), {})
            load = LOAD
            found[case][method] = Noisy(
                clean=load,
                first=load + size,
                first_sigma=np.full(len(load), size),
                runs=np.asarray(4),
                **{name: np.asarray(value) for name, value in figures.items()},
            )
    return Noise(QUICK, {HELD: long_drive(4.0), WHITE: long_drive(8.0)}, found)


def long_drive(duration: float) -> Drive:
    """400 samples, however long."""
    none, four = np.zeros(len(TIME)), np.zeros((len(TIME), 4))
    own = {"t": TIME * duration / 4.0, "load": np.tile(LOAD[:, None], 4)}
    own |= dict.fromkeys(("a_x", "a_y", "speed", "roll", "pitch"), none)
    return Drive(**{name: own.get(name, four) for name in Drive._fields})


@pytest.mark.parametrize(
    ("changed", "which", "verdict"),
    [
        ({(HELD, YOULA): {"spread": 700.0}}, 0, IN_PART),
        ({(c, YOULA): {"spread": 700.0} for c in (HELD, WHITE)}, 0, FAILS),
        ({(c, DERIVATIVE): {"spread": 700.0} for c in (HELD, WHITE)}, 1, FAILS),
        ({(WHITE, UNBIASED): {"stated": 1200.0}}, 2, IN_PART),
        ({(WHITE, m): {"stated": 200.0} for m in (YOULA, UNBIASED)}, 2, FAILS),
        ({(HELD, m): {"stated": 200.0} for m in (YOULA, UNBIASED)}, 3, FAILS),
        ({(WHITE, m): {"inside": 0.8} for m in (YOULA, UNBIASED)}, 4, FAILS),
        ({(WHITE, JOINT): {"rmse": 450.0}}, 5, IN_PART),
        ({(WHITE, m): {"rmse": 450.0} for m in (JOINT, JOINT_WHEEL)}, 5, FAILS),
        ({(HELD, JOINT): {"inside": 0.7}}, 6, IN_PART),
        ({(c, JOINT): {"inside": 0.7} for c in (HELD, WHITE)}, 6, IN_PART),
    ],
)
def test_noise_verdicts_follow_the_numbers(changed, which, verdict):
    assert verdicts(noise_findings(noise_of())) == [HOLDS] * 7
    assert noise_findings(noise_of(changed))[which].verdict == verdict


def test_noise_chapter_is_whole():
    result = noise_of({(WHITE, YOULA): {"rmse": 500.0}})
    assert all(paragraph.strip() for paragraph in noise_in_words(QUICK))
    # sqrt(500^2 - 400^2) is what the noise does not explain
    assert "Youla 300 N rms" in noise_findings(result)[4].why
    (table,) = noise_tables(result)
    assert table.columns["rms error [N]"][5] == "500"
    assert len(table.rows) == 2 * len(METHODS)
    figures = list(noise_figures(result))
    assert len({figure.name for figure in figures}) == 2
    for figure in figures:
        figure.figure.draw_without_rendering()
        assert {len(column) for column in figure.columns.values()} == {len(TIME)}
        assert set(figure.units) == set(figure.columns)
    numbers = json.loads(json.dumps(noise_numbers(result)))
    assert numbers[WHITE][YOULA]["rmse"] == 500.0
    assert numbers[HELD][JOINT] == {
        "rmse": 150.0, "spread": 150.0, "stated": 150.0, "inside": 0.9545, "runs": 4
    }  # fmt: skip
