"""All 16 combinations on the paper's own car: a small real run, and judgements on invented ones."""

from dataclasses import replace

import numpy as np
import pytest

from wheelhop.estimators.failure_modes import level_table, mode_names
from wheelhop.io.report import FAILS, HOLDS, IN_PART
from wheelhop.studies.solmaz.judges import Verdicts
from wheelhop.studies.solmaz.outcomes import SOUND, detection_time, share
from wheelhop.studies.solmaz.own_plant import (
    BANK,
    LEVEL_TRUTHS,
    OBSERVER,
    PRINTED,
    LevelTrial,
    OwnPlant,
    judged,
)
from wheelhop.studies.solmaz.own_plant_cases import (
    LEVEL_CASES,
    MAIN,
    SECOND,
    STRAIGHT,
    Case,
    cases,
    driven,
    sensed,
    truths,
)
from wheelhop.studies.solmaz.own_plant_claims import own_plant_findings
from wheelhop.studies.solmaz.own_plant_disturbed import disturbed_findings
from wheelhop.studies.solmaz.own_plant_figures import own_plant_figures
from wheelhop.studies.solmaz.own_plant_measures import (
    false_alarms,
    quantile,
    reliability,
    score,
    soft_right,
    straight,
    swept,
    works,
)
from wheelhop.studies.solmaz.own_plant_tables import own_plant_numbers, own_plant_tables
from wheelhop.studies.solmaz.settings import SolmazSettings
from wheelhop.vehicle.cornering import Cornering

SETTINGS = SolmazSettings(runs=25)
TIME = np.arange(1, 201) / 10
NOBODY = [Case("small", 3, 0.01, 1, 1)]
SAMPLES = 650


@pytest.fixture(scope="module")
def small():
    """1.5 s of the lane change, each combination once."""
    return driven(NOBODY[0], SAMPLES), judged(NOBODY[0], SETTINGS, 16, SAMPLES)


def test_the_driver_corrects_what_the_car_does_not_do(small):
    drives, _ = small
    t = np.arange(1, SAMPLES + 1) / 100
    meant = np.where(t > 5.0, 0.01 * np.sin(2 * np.pi * (t - 5.0) / 2.5), 0.0)
    np.testing.assert_allclose(drives.steer[SOUND], meant, atol=1e-12)
    missing = drives.yaw_rate[SOUND] - drives.yaw_rate
    np.testing.assert_allclose(drives.steer, meant + 0.2 * missing, atol=1e-9)
    # the car that turns less is steered more
    assert np.abs(drives.steer[3]).max() > 1.1 * np.abs(meant).max()


def test_left_and_right_are_mirror_images(small):
    drives, _ = small
    mirrored = driven(replace(NOBODY[0], amplitude=-0.01), SAMPLES)
    order = np.array([int("".join(str(b) for b in row[[1, 0, 3, 2]]), 2) for row in level_table(2)])
    np.testing.assert_allclose(mirrored.yaw_rate[order], -drives.yaw_rate, atol=1e-12)


def test_a_small_run_names_the_tyres(small):
    _, found = small
    true = np.arange(16)
    assert found["peak"].shape == (16,)
    right = {who: np.mean(found[f"{who} selected"][:, -1] == true) for who in (OBSERVER, BANK)}
    assert right[OBSERVER] >= 0.75
    assert right[BANK] >= 0.9
    # nothing is seen before the steering begins
    np.testing.assert_array_equal(found[f"{OBSERVER} selected"][:, :49], SOUND)
    assert np.mean(found[f"{PRINTED} selected"][:, 20:49] != SOUND) > 0.5
    soft = found[f"{BANK} soft"][:, -1] > 0.5
    assert np.mean(soft == (level_table(2) == 0)) >= 0.95
    assert np.isnan(found[f"{PRINTED} probability"]).all()


def test_sensors_have_the_errors_of_their_case():
    t = np.arange(1, 2001) / 100
    clean = np.tile(0.01 * np.sin(t), (16, 1))
    drives = Cornering(np.tile(t, (16, 1)), clean, None, clean, clean, None, None, None, None)
    rows = np.repeat(np.arange(16), 20)
    y = sensed(drives, rows, NOBODY[0], SETTINGS)
    for signal, size in ((y.steer, 1.25e-4), (y.lateral_acceleration, 0.05), (y.yaw_rate, 0.002)):
        assert np.std(signal - clean[rows]) == pytest.approx(size, rel=0.02)
    # a run does not depend on how many there are; a case and a car have their own
    again = sensed(drives, rows[:25], NOBODY[0], SETTINGS)
    np.testing.assert_array_equal(again.yaw_rate, y.yaw_rate[:25])
    other = sensed(drives, rows[:2], replace(NOBODY[0], number=4), SETTINGS)
    assert np.all(other.yaw_rate[0] != y.yaw_rate[0])
    assert np.all(y.yaw_rate[20] != y.yaw_rate[0])
    offset = sensed(drives, rows, replace(NOBODY[0], offsets=1.0), SETTINGS)
    off = np.mean(offset.lateral_acceleration - clean[rows], axis=1)
    assert np.std(off) == pytest.approx(0.1, rel=0.15)
    assert np.std(np.mean(offset.steer - clean[rows], axis=1)) == pytest.approx(1e-3, rel=0.15)
    lossy = sensed(drives, rows, replace(NOBODY[0], dropout=0.05), SETTINGS)
    for signal in (lossy.steer, lossy.lateral_acceleration, lossy.yaw_rate):
        assert np.mean(np.isnan(signal)) == pytest.approx(0.05, rel=0.03)
    exact = sensed(drives, rows, replace(NOBODY[0], steer_noise=0.0), SETTINGS)
    np.testing.assert_array_equal(exact.steer, clean[rows])


def told(case, since=5.75, probability=0.999, until=99.0, before=SOUND, always=None):
    """A contender that names the truth between two times, and else one mode."""
    true = truths(case)[:, None]
    inside = (since <= TIME + 1e-9) & (until > TIME + 1e-9)
    selected = np.where(inside, true, before)
    selected = selected if always is None else np.full(selected.shape, always)
    sure = np.full(selected.shape, probability)
    soft = probability * (level_table(2) == 0)[selected]
    return Verdicts(selected, sure, soft, np.ones(selected.shape))


def invented(**changes):
    """Everybody right 0.75 s after the onset, in every case but straight ahead, where all say
    "none"; changes by name of a case, of all contenders."""
    every = cases(SETTINGS)
    verdicts, peaks = {}, {}
    for name, case in every.items():
        still = case.amplitude == 0.0
        found = changes.get(name, {"always": SOUND} if still else {})
        verdicts[name] = {who: told(case, **found) for who in (PRINTED, OBSERVER, BANK)}
        peaks[name] = np.full(16, 175.0 * case.amplitude)
    levels = changes.get("levels", np.array(LEVEL_TRUTHS))
    trial = LevelTrial(np.array(LEVEL_TRUTHS), {OBSERVER: levels, BANK: levels})
    return OwnPlant(SETTINGS, TIME, every, peaks, verdicts, dict.fromkeys(LEVEL_CASES, trial))


WHERE, MODES, SOON, STILL = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)


def verdicts_of(result, part):
    return [f.verdict for f in own_plant_findings(result)[part]]


def test_findings_follow_the_verdicts():
    good = invented()
    assert [f.verdict for f in own_plant_findings(good)[:12]] == [HOLDS] * 12
    lost = invented(**{MAIN: {"until": 15.0}})
    assert verdicts_of(lost, MODES) == [FAILS] * 3
    assert verdicts_of(lost, SOON) == [FAILS] * 3
    assert "6.2%" in own_plant_findings(lost)[3].measured
    assert "100.0% when the steering ends" in own_plant_findings(lost)[3].measured
    late = invented(**{MAIN: {"since": 6.5}})
    assert (verdicts_of(late, MODES), verdicts_of(late, SOON)) == ([HOLDS] * 3, [FAILS] * 3)
    assert verdicts_of(invented(**{STRAIGHT: {"always": 7}}), STILL) == [FAILS] * 3
    guessing = invented(**{STRAIGHT: {"always": 7, "probability": 0.5}})
    assert verdicts_of(guessing, STILL) == [FAILS, FAILS, HOLDS]
    gone = {"always": SOUND}
    weak = invented(**{f"sweep {a:g}": gone for a in (0.0006, 0.0012, 0.02)})
    assert verdicts_of(weak, WHERE) == [IN_PART] * 3
    assert "from 0.35 to 2.6 m/s^2" in own_plant_findings(weak)[0].measured


def test_what_disturbs_is_judged_by_the_bank():
    names = ["probabilities", "road", "offsets", "load", "missing", "sign", "levels"]

    def judge(**changes):
        found = disturbed_findings(invented(**changes))
        return {n: f.verdict for n, f in zip(names, found, strict=True)}

    good = judge()
    # 99.9 % sure and wrong for 0.7 s: within the bin of the others
    assert good == dict.fromkeys(names, HOLDS)
    assert judge(**{"friction 0.5": {"always": 0}})["road"] == IN_PART
    assert judge(**{"20 % more load": {"always": 0}})["load"] == IN_PART
    assert judge(**{"offsets of the sensors": {"always": SOUND}})["offsets"] == IN_PART
    assert judge(**{"5 % of the samples missing": {"always": 0}})["missing"] == FAILS
    assert judge(**{"opposite pressure sign, unknown": {"always": 0}})["sign"] == FAILS
    assert judge(levels=np.full((len(LEVEL_TRUTHS), 4), 2))["levels"] == FAILS
    assert judge(**{MAIN: {"since": 12.0}})["probabilities"] == FAILS


def test_measures_are_what_they_say():
    result = invented(**{MAIN: {"until": 15.0, "since": 6.0}, SECOND: {"always": 7}})
    main = score(result, MAIN, BANK)
    np.testing.assert_array_equal(main.confusion[:, SOUND], 1.0)
    assert main.steered == 1.0
    assert main.right.value == pytest.approx(1 / 16)
    np.testing.assert_allclose(main.tires, 0.5)
    assert np.isinf(main.times[0])
    assert main.slowest[SOUND] == 0.0
    # FL alone: right for the other three of a quarter... of all sixteen half each
    np.testing.assert_allclose(score(result, SECOND, OBSERVER).tires, 0.5)
    assert soft_right(result, SECOND, BANK).value == pytest.approx(1 / 15)
    assert false_alarms(result, SECOND, BANK).value == 1.0
    assert quantile(np.array([1.0, 2.0, np.inf, np.inf]), 0.5) == 2.0
    assert quantile(np.array([1.0, 2.0, np.inf, np.inf]), 0.9) == np.inf

    still = straight(invented(**{STRAIGHT: {"always": 7, "probability": 0.5}}), BANK)
    assert (still.sound, still.sound_sure, still.sound_end) == (1.0, 0.0, 0.0)
    # front left is not soft in 7 of the 15 combinations with a soft tyre
    assert still.soft == pytest.approx(7 / 15)
    assert still.switches == 0.0
    assert straight(invented(**{STRAIGHT: {"until": 10.0, "since": 0.0}}), BANK).sound == 0.0

    half = reliability(invented(**{MAIN: {"since": 12.55, "probability": 0.6}}))
    np.testing.assert_allclose(half.stated, [0.6])
    # of 150 samples 75 are right, and all of the sound car
    np.testing.assert_allclose(half.observed, [(15 * 0.5 + 1) / 16], atol=1e-12)
    assert half.samples[0] == 16 * 25 * 150


def test_the_stretch_in_which_a_method_works():
    peaks = np.array([0.1, 0.5, 1.0, 2.0, 3.0])
    one, none = share(np.ones(50, bool)), share(np.zeros(50, bool))
    assert works(peaks, [none, one, one, none, one]) == (0.5, 1.0)
    assert works(peaks, [none, none, none, none, one]) == (3.0, 3.0)
    assert np.isnan(works(peaks, [none] * 5)).all()
    found = swept(invented())
    assert np.all(np.diff(found.peaks) > 0)
    assert found.beyond[0] == 0
    assert found.beyond[-1] == 16
    # a run right only for a while is not right for good
    selected = np.array([[0, 0, 7, 7, 7], [7, 7, 0, 7, 7], [7, 7, 7, 7, 0]])
    times = detection_time(np.arange(5.0), selected, np.array([7, 7, 7]), 1.0)
    np.testing.assert_array_equal(times, [1.0, 2.0, np.inf])


def test_figures_tables_and_numbers_agree():
    result = invented()
    figures = {f.name: f for f in own_plant_figures(result)}
    assert len(figures) == 5
    for figure in figures.values():
        assert len({len(column) for column in figure.columns.values()}) == 1
        assert set(figure.units) <= set(figure.columns)
    panels = figures["own_plant_confusion"].figure.axes
    assert [t.get_text() for t in panels[2].get_yticklabels()] == list(mode_names())
    assert panels[2].get_title(loc="left") == "bank of filters: 100.0% right"
    matrix = figures["own_plant_confusion"].columns
    rows = (matrix["true"] == "FL") & (np.array(matrix["told"]) == "FL")
    assert matrix["as_printed"][rows] == [1.0]

    where = own_plant_tables(result)[0]
    assert where.columns["works from [m/s^2]"] == pytest.approx([175 * 0.0006] * 3)
    numbers = own_plant_numbers(result)
    assert numbers["contenders"][BANK]["truths_right"]["FL+RR"] == 1.0
    assert numbers["contenders"][BANK]["time_right_for_good"]["90%"] == pytest.approx(0.8)
    assert numbers["levels"][MAIN][OBSERVER]["all_right"] == 1.0
