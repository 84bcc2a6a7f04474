"""The full vehicle in the Solmaz study: what is driven, and judgements on invented verdicts."""

from dataclasses import replace

import numpy as np
import pytest

from wheelhop.estimators.failure_modes import level_table, mode_names
from wheelhop.estimators.lateral_vehicle import HELD, SURE, SoftTires
from wheelhop.io.report import FAILS, HOLDS
from wheelhop.studies.frame import Store
from wheelhop.studies.solmaz import full_vehicle as study
from wheelhop.studies.solmaz.full_vehicle import (
    BANK,
    SWITCHED,
    FullVehicleResult,
    Outcome,
    full_vehicle,
    lost_control,
)
from wheelhop.studies.solmaz.full_vehicle_claims import full_vehicle_findings
from wheelhop.studies.solmaz.full_vehicle_figures import full_vehicle_figures
from wheelhop.studies.solmaz.full_vehicle_measures import (
    by_peak,
    false_names,
    reliability,
    sure_and_wrong,
    tally,
    times,
    told_over_time,
    works_from,
)
from wheelhop.studies.solmaz.full_vehicle_tables import (
    full_vehicle_in_words,
    full_vehicle_numbers,
    full_vehicle_tables,
    lost_stiffness,
)
from wheelhop.studies.solmaz.judges import Verdicts
from wheelhop.studies.solmaz.settings import QUICK, SolmazSettings
from wheelhop.studies.solmaz.vehicle_conditions import (
    MAIN,
    NO_EFFECT,
    ONSET,
    OPPOSITE,
    STRAIGHT,
    STRAIGHT_ROUGH,
    conditions,
    pieces,
)
from wheelhop.studies.solmaz.vehicle_drives import RATE, LateralSignals
from wheelhop.vehicle.lateral_record import LateralRecord, LateralSample

TIME = np.arange(0.1, 20.05, 0.1)
REPEATS = 20
TRUE = np.tile(np.arange(16), REPEATS)
SOFT = level_table(2) == 0


def verdicts(selected, probability=0.99):
    p = np.broadcast_to(probability, selected.shape)
    return Verdicts(selected, p, SOFT[selected].astype(float), np.ones(selected.shape))


def invented(wrong=(), unsure=(), lost=(), after=2.0, cornered=2.0):
    """Verdicts that are right from `after` on but in some runs; before that, "none"."""
    runs = len(TRUE)
    selected = np.where(ONSET + after < TIME, TRUE[:, None], 15)
    selected[list(wrong)] = (TRUE[list(wrong), None] + 1) % 16
    p = np.full(selected.shape, 0.99)
    p[list(unsure)] = 0.6
    gone = np.isin(np.arange(runs), lost)
    steering = np.where(TIME > ONSET + 0.5, cornered, 0.0) * np.ones((runs, 1))
    observer = np.where(TRUE[:, None] < 8, selected, 15)
    peak = np.linspace(1.0, 4.49, runs)
    nothing = np.zeros(runs, bool)
    return Outcome(
        TRUE,
        np.full(runs, 20.0),
        peak,
        gone,
        nothing,
        steering,
        verdicts(selected, p),
        verdicts(observer, np.nan),
    )


def result(**changed):
    every = conditions(SolmazSettings())
    outcomes = {name: changed.get(name, invented()) for name in every}
    for name in (STRAIGHT, STRAIGHT_ROUGH):
        outcomes[name] = changed.get(name, invented(cornered=0.0))
    t = TIME - 0.1
    p = np.zeros((len(t), 16))
    p[:, 3] = 1.0
    one = np.ones(len(t))
    soft = np.array([[1.0, 1.0, 0.0, 0.0]]) * one[:, None]
    words = np.where(t < 6.0, "not enough cornering", "FL+FR")
    shown = SoftTires(t, mode_names(), p, soft, one, 0.1 * one, one, one, one, one, words)
    record = LateralRecord(TIME, LateralSample(0.01 * one, 20 * one, np.sin(TIME), 0.1 * one))
    return FullVehicleResult(SolmazSettings(), TIME, every, outcomes, record, shown)


def test_shares_are_those_of_the_runs_that_kept_to_the_road():
    # all four soft and told without RR, FL+FR+RL told as FL+FR+RR, and a run that is lost
    wrong, unsure, lost = (0, 1, 2), (3, 4, 16), (2, 40)
    found = tally(invented(wrong, unsure, lost))
    runs = len(TRUE) - 2
    assert (found.runs, found.lost) == (runs, 2)
    np.testing.assert_allclose(found.outcomes, np.array([runs - 5, 3, 0, 1, 1]) / runs)
    np.testing.assert_allclose(found.wrong, 2 / runs)
    np.testing.assert_allclose(found.right.value, 1 - 2 / runs)
    np.testing.assert_allclose(found.told, 1 - 3 / runs)
    kept = ~np.isin(np.arange(len(TRUE)), lost)
    observer = (TRUE < 8) | (TRUE == 15)
    observer[list(wrong)] = False
    np.testing.assert_allclose(found.switched.value, observer[kept].mean())
    assert found.alarms == 0.0
    np.testing.assert_allclose(sure_and_wrong(invented(wrong, unsure, lost)), 2 / runs)


def test_what_is_told_too_early_counts_as_told_wrong_at_some_time():
    # "none" is believed until the truth is; it may be told after HELD seconds of cornering
    early, late = (tally(invented(after=a)).ever for a in (0.5 + 0.5 * HELD, 0.5 + 2 * HELD))
    assert early == 0.0
    np.testing.assert_allclose(late, 15 / 16)
    telling = told_over_time(invented(after=0.0))
    assert not telling[:, TIME <= ONSET + 0.5 + HELD].any()
    assert telling[:, TIME > ONSET + 0.7 + HELD].all()
    unsure = invented()
    assert not told_over_time(
        unsure._replace(bank=verdicts(unsure.bank.selected, 0.99 * SURE))
    ).any()


def test_the_method_works_from_the_bin_on_above_which_all_are_good():
    outcome = invented()
    assert works_from(outcome) == 0.0
    bad = np.flatnonzero((outcome.peak > 2.0) & (outcome.peak < 2.5))[:5]
    assert works_from(invented(wrong=bad)) == 2.5
    assert works_from(invented(wrong=np.flatnonzero(outcome.peak > 4.2))) == np.inf
    counts = [t.runs for _, t in by_peak(outcome)]
    assert sum(counts) == len(TRUE)
    assert by_peak(outcome)[0][0] == "below 1.5"
    few = Outcome(
        *(a[:4] for a in outcome[:6]), *(Verdicts(*(b[:4] for b in v)) for v in outcome[6:])
    )
    assert [(name, t.runs) for name, t in by_peak(few)] == [("all", 4)]


def test_times_and_probabilities_are_those_of_the_main_case():
    found = result(**{MAIN: invented(after=1.5, wrong=(5,))})
    bank = times(found, BANK)
    assert np.isinf(bank[5])
    is_none = TRUE == 15
    np.testing.assert_allclose(bank[is_none], 0.0)
    np.testing.assert_allclose(np.delete(bank, 5)[~np.delete(is_none, 5)], 1.6, atol=0.01)
    stated, observed = reliability(found)
    np.testing.assert_allclose(stated, 0.99, rtol=1e-6)
    late = np.mean(TIME[TIME > ONSET] > ONSET + 1.5)
    share = (15 * late + 1) / 16 * (1 - 1 / 320) * np.ones(1)
    np.testing.assert_allclose(observed, share, atol=2e-3)
    assert false_names(found.outcomes[MAIN], SWITCHED) <= 1 / 320


def test_findings_follow_the_figures():
    def of(found):
        return {f.claim: f.verdict for f in full_vehicle_findings(found)}

    good = of(result())
    bad_main = invented(wrong=range(60))
    bad = of(
        result(**{MAIN: bad_main, STRAIGHT: invented(), OPPOSITE: bad_main, NO_EFFECT: bad_main})
    )
    for part, verdicts_ in (
        ("all four tyres", (HOLDS, FAILS)),
        ("what is told", (HOLDS, FAILS)),
        ("while driving straight", (HOLDS, "in part")),
        ("switched models", (FAILS, FAILS)),
        ("needs the sign", (FAILS, HOLDS)),
        ("no effect", (HOLDS, FAILS)),
    ):
        claim = next(c for c in good if part in c)
        for verdict, wanted in zip((good[claim], bad[claim]), verdicts_, strict=True):
            assert wanted in verdict, claim


def test_report_of_a_whole_and_of_a_quick_study():
    whole = result()
    few = conditions(QUICK)
    quick = whole._replace(
        settings=QUICK, conditions=few, outcomes={n: whole.outcomes[n] for n in few}
    )
    for found in (whole, quick):
        assert [f.name for f in full_vehicle_figures(found)] == [
            f"vehicle_{n}" for n in ("record", "confusion", "peaks", "detection", "conditions")
        ]
        assert len(full_vehicle_tables(found)) == 3
        assert all(full_vehicle_in_words(found.settings))
        numbers = full_vehicle_numbers(found)
        assert set(numbers["conditions"]) == set(found.conditions)
        assert numbers["works_from"] == 0.0
        assert len(full_vehicle_findings(found)) == (5 if found is quick else 11)
    assert 0.25 < lost_stiffness() < 0.4


def test_every_combination_has_its_runs_and_a_run_keeps_its_numbers():
    settings = SolmazSettings(runs=200)
    every = conditions(settings)
    main = list(pieces(every[MAIN], settings))
    true = np.concatenate([p.true for p in main])
    assert np.bincount(true).tolist() == [every[MAIN].runs] * 16
    assert {len(p.true) for p in main} == {64}
    fewer = next(iter(pieces(replace(every[MAIN], runs=4), settings)))
    np.testing.assert_array_equal(fewer.speed, main[0].speed)
    np.testing.assert_array_equal(fewer.runs.soft, SOFT[fewer.true])
    speeds = np.concatenate([p.speed for p in main])
    assert 18.0 <= speeds.min() < 18.5
    assert 24.5 < speeds.max() <= 25.0
    assert len({p.seed for p in main}) == len(main)
    other = next(iter(pieces(every["friction 0.5"], settings)))
    assert (other.runs.friction == 0.5).all()
    assert not np.allclose(other.speed, main[0].speed)
    assert len({c.number for c in every.values()}) == len(every)


def test_a_spin_and_a_roll_over_are_lost_runs():
    calm = LateralSignals(*np.zeros((8, 3, 10)))
    slip, roll = np.zeros((3, 10)), np.zeros((3, 10))
    slip[1, 4], roll[2, 5] = -0.3, 0.5
    found = lost_control(calm._replace(side_slip=slip, roll=roll))
    assert found.tolist() == [False, True, True]


@pytest.fixture
def drives(monkeypatch):
    """Counts simulated pieces; signals and verdicts are invented."""
    count = []

    def drive(runs, duration, seed):
        count.append(seed)
        n, samples = len(runs.maneuvers), round(duration * RATE)
        wave = 2.0 * np.sin(np.arange(samples) / RATE) * np.ones((n, 1))
        four = np.ones((n, samples, 4))
        return LateralSignals(
            0.01 * wave, 20 + 0 * wave, wave, 0.1 * wave, *2 * [0 * wave], four, four
        )

    def told(sample, believed, lanes):
        n, samples = np.shape(sample.steer)
        found = verdicts(
            np.tile(np.arange(16), n // 16)[:, None] * np.ones((1, samples // 10), int)
        )
        return {
            f"{who} {name}": a
            for who in (BANK, SWITCHED)
            for name, a in zip(Verdicts._fields, found, strict=True)
        }

    monkeypatch.setattr(study, "drive_cornering", drive)
    monkeypatch.setattr(study, "told", told)
    monkeypatch.setattr(study, "which_tires_are_soft", lambda *a: result().shown)
    return count


def test_a_study_is_resumed_from_its_store(tmp_path, drives):
    seen = []
    first = full_vehicle(QUICK, Store(tmp_path), lambda done, total: seen.append((done, total)))
    driven = len(drives)
    assert driven == 3
    assert seen[-1] == (3, 3)
    again = full_vehicle(QUICK, Store(tmp_path), lambda done, total: None)
    assert len(drives) == driven
    np.testing.assert_array_equal(again.outcomes[MAIN].peak, first.outcomes[MAIN].peak)
    assert first.time[-1] == study.QUICK_DURATION
    assert tally(first.outcomes[MAIN]).right.value == 1.0
    assert len(first.record.t) == round(study.QUICK_DURATION * RATE)
