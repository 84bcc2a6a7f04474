"""The Monte Carlo and the single drives of the study, on records that cost nothing."""

import json
from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest

from tests.estimators.level_candidate import GAIN, LEVEL, level_candidate
from wheelhop.errors import InputError
from wheelhop.estimators.candidate import Records
from wheelhop.estimators.candidates import PRIOR_PRESSURE, PRIOR_SIGMA
from wheelhop.estimators.tuning import Tuned, TuningSettings
from wheelhop.io.report import FAILS, HOLDS, IN_PART
from wheelhop.studies.brancati import monte_carlo as campaign
from wheelhop.studies.brancati import plant as plants
from wheelhop.studies.brancati.claims import gain_text, over_all, verdict_of
from wheelhop.studies.brancati.claims_drives import case_findings
from wheelhop.studies.brancati.claims_monte_carlo import monte_carlo_findings
from wheelhop.studies.brancati.contenders import (
    CONTENDERS,
    FLOOR,
    TunedFilter,
    candidates,
    filter_keys,
    floor_track,
    true_stiffness,
    tune_all,
)
from wheelhop.studies.brancati.monte_carlo import TRAINING, kept_times, monte_carlo, sample_drives
from wheelhop.studies.brancati.plant import RATE, Driven, Plant
from wheelhop.studies.brancati.scenarios import CASES, FIRST, case_drives, judge_cases
from wheelhop.studies.brancati.study import (
    QUICK,
    ConventionResult,
    Validation,
    validate_validation,
)
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.tire import pressure_from_stiffness, pressure_slope, stiffness_from_pressure

CAR = brancati_suv()
PLANT = Plant(duration=1.0)


def fake_drives(plant, drives, on_progress=None, fleet=4):
    """What `drive_all` returns, measured as the level filter does; counts its calls."""
    del on_progress, fleet
    fake_drives.calls += 1
    t = np.arange(1, plant.samples + 1) / RATE
    pressure = np.array(
        [
            np.interp(t, np.cumsum(d.loss), [d.pressure, d.end_pressure or d.pressure])
            for d in drives
        ]
    )
    truth = np.asarray(stiffness_from_pressure(pressure, CAR.tire))
    noise = np.stack(
        [
            np.random.default_rng([plant.seed, d.number]).normal(size=(2, plant.samples))
            for d in drives
        ]
    )
    y = GAIN * (truth - LEVEL)
    measured = Accelerations(y + noise[:, 0], -y + noise[:, 1])
    speed = np.array([[d.speed] * plant.samples for d in drives])
    return Driven(Records(measured, speed, 1.0 / RATE), pressure, 0.0 * y, y)


@pytest.fixture
def plant(monkeypatch):
    fake_drives.calls = 0
    monkeypatch.setattr(campaign, "drive_all", fake_drives)
    return PLANT


@pytest.fixture(scope="module")
def filters():
    candidate = level_candidate(walk=1.0, p0=2e4)
    nothing = float("nan")
    tuned = Tuned(
        candidate.default, candidate.default, np.ones(1), 1.0, nothing, nothing, TuningSettings()
    )
    return [TunedFilter(candidate, tuned)]


def test_scenarios_depend_on_their_own_number_alone_and_fill_table_4():
    many = sample_drives(range(400), seed=3)
    assert sample_drives([7], seed=3) == [many[7]]
    assert sample_drives([7], seed=4) != [many[7]]
    speeds, pressures = np.array([(d.speed, d.pressure) for d in many]).T
    assert 40 / 3.6 <= speeds.min() < 41 / 3.6
    assert 79 / 3.6 < speeds.max() <= 80 / 3.6
    assert 130e3 <= pressures.min() < 132e3
    assert 228e3 < pressures.max() <= 230e3
    shares = [np.mean([d.road == c for d in many]) for c in "ABCD"]
    np.testing.assert_allclose(shares, 0.25, atol=0.07)
    assert np.mean(pressures) == pytest.approx(PRIOR_PRESSURE, abs=5e3)
    assert np.std(pressures) == pytest.approx(PRIOR_SIGMA, rel=0.1)


def test_results_do_not_depend_on_the_size_of_a_fleet(plant, filters):
    small = monte_carlo(plant, CAR, filters, 10, fleet=4)
    large = monte_carlo(plant, CAR, filters, 10, fleet=128)
    for name in small.tracks:
        for a, b in zip(small.tracks[name], large.tracks[name], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12)
    again = monte_carlo(plant, CAR, filters, 10, fleet=4)
    for name in small.tracks:  # to the bit from the same seed
        assert np.array_equal(again.tracks[name].stiffness, small.tracks[name].stiffness)


def test_finished_fleets_are_not_run_again_and_damaged_ones_are(plant, filters, tmp_path):
    first = monte_carlo(plant, CAR, filters, 10, tmp_path, fleet=4)
    assert fake_drives.calls == 3
    monte_carlo(plant, CAR, filters, 10, tmp_path, fleet=4)
    assert fake_drives.calls == 3
    file = sorted(tmp_path.glob("*.npz"))[1]
    file.write_bytes(file.read_bytes()[:100])
    again = monte_carlo(plant, CAR, filters, 10, tmp_path, fleet=4)
    assert fake_drives.calls == 4
    np.testing.assert_array_equal(again.tracks["level"].sigma, first.tracks["level"].sigma)
    other = replace(plant, noise=0.7)
    monte_carlo(other, CAR, filters, 10, tmp_path, fleet=4)
    assert fake_drives.calls == 7


def test_figures_are_those_of_the_runs(plant, filters):
    found = monte_carlo(plant, CAR, filters, 6, fleet=8)
    assert set(found.tracks) == {"level", FLOOR}
    assert found.t[-1] == pytest.approx(1.0)
    pressures = np.array([d.pressure for d in sample_drives(range(6), plant.seed)])
    np.testing.assert_allclose(found.pressure, pressures)
    floor = found.figures[FLOOR]
    assert floor.final_rmse.value == pytest.approx(np.sqrt(np.mean((pressures - 180e3) ** 2)))
    assert found.figures["level"].final_rmse.value < 0.2 * floor.final_rmse.value


def test_the_floor_is_the_middle_of_the_range():
    track = floor_track(CAR, 2, 3)
    np.testing.assert_allclose(pressure_from_stiffness(track.stiffness, CAR.tire), 180e3)
    np.testing.assert_allclose(track.sigma * float(pressure_slope(CAR.tire)), 100e3 / np.sqrt(12))


def test_kept_times_end_with_the_last_sample():
    t = kept_times(Plant(duration=2.0), 40)
    assert t[-1] == pytest.approx(2.0)
    np.testing.assert_allclose(np.diff(t), 0.05)


def test_repetitions_of_all_cases_share_their_roads():
    drives = case_drives(CASES, 3, 10.0)
    assert len(drives) == 3 * len(CASES)
    assert {d.number for d in drives} == {FIRST, FIRST + 1, FIRST + 2}
    leak = next(d for d in drives if d.end_pressure is not None)
    assert (leak.pressure, leak.end_pressure, leak.loss) == (230e3, 180e3, (5.0, 1.5))
    assert sorted({d.payload for d in drives}) == [0.0, 140.0, 430.0]
    change = next(d for d in drives if d.then is not None)
    assert (change.road, change.then, change.change) == ("A", "D", 5.0)


def test_cases_are_judged_on_their_own_drives(filters):
    cases = [c for c in CASES if c.figure in (7, 8)]
    driven = fake_drives(PLANT, case_drives(cases, 3, 1.0))
    found = judge_cases(PLANT, CAR, filters, cases, 3, driven)
    assert [r.case.figure for r in found] == [7, 8]
    for result in found:
        np.testing.assert_allclose(result.truth, 220e3)
        error = result.courses["level"].pressure[-1] - 220e3
        assert abs(error) < 5e3
        assert result.figures[FLOOR].final_bias == pytest.approx(-40e3)


def test_tunings_are_kept_and_read_again(tmp_path):
    candidate = level_candidate()
    drives = sample_drives(range(4), 0)
    data = fake_drives(PLANT, drives), list(range(4))
    settings = TuningSettings("nll", 2, 0.3, 0.0)
    first = tune_all([candidate], CAR, data, data, settings, store=tmp_path, made_of={"a": 1})
    (file,) = tmp_path.glob("*.json")
    content = json.loads(file.read_text())
    content["tuning"]["walk"] = 123.0
    file.write_text(json.dumps(content))
    again = tune_all([candidate], CAR, data, data, settings, store=tmp_path, made_of={"a": 1})
    assert again[0].tuned.tuning["walk"] == 123.0
    other = tune_all([candidate], CAR, data, data, settings, store=tmp_path, made_of={"a": 2})
    assert other[0].tuned.tuning == first[0].tuned.tuning


def test_every_contender_is_made_for_every_convention():
    cars = dict.fromkeys("ABCD", CAR)
    for convention in ("iso8608", "brancati2022"):
        made = candidates(cars, convention)
        assert len(made) == len(CONTENDERS)
        assert len({c.name for c in made}) == len(made)
        for candidate, contender in zip(made, CONTENDERS, strict=True):
            # without classes, the modes are what changes
            over_all = 4 if candidate.knobs else 3
            assert len(candidate.modes) == (over_all if contender.parent is None else 1)


def test_truth_is_the_papers_line():
    driven = fake_drives(PLANT, sample_drives(range(2), 0))
    expected = 264.7e3 * (1.0 + 0.7 * (driven.pressure - 250e3) / 250e3)
    np.testing.assert_allclose(true_stiffness(driven, CAR), expected)


def test_seeds_reach_the_filters_own_draws_and_differ_from_roads_and_sensors():
    numbers = [0, 1, 2]

    def bits(keys):
        return np.asarray(jax.random.key_data(keys))

    assert not np.array_equal(bits(filter_keys(numbers, 0)), bits(filter_keys(numbers, 1)))
    drives = sample_drives(numbers, 0)
    for use in (0, 1):
        others = bits(plants._keys(PLANT, drives, use))
        assert not (bits(filter_keys(numbers, PLANT.seed)) == others).all(axis=1).any()
    assert np.array_equal(bits(filter_keys([2], 0))[0], bits(filter_keys(numbers, 0))[2])


def test_training_runs_are_no_runs_of_the_monte_carlo_nor_single_drives():
    assert TRAINING > 999_999
    assert FIRST > TRAINING + 100_000


def test_a_filter_that_loses_a_run_is_judged_on_the_others(plant, filters, monkeypatch):
    def lose_one(part, car, chosen, numbers, seed):
        kept = filtered(part, car, chosen, numbers, seed)
        kept["stiffness_0"] = kept["stiffness_0"].copy()
        kept["stiffness_0"][1] = np.nan
        return kept

    filtered = campaign._filtered
    monkeypatch.setattr(campaign, "_filtered", lose_one)
    found = monte_carlo(plant, CAR, filters, 6, fleet=8)
    assert found.figures["level"].lost == 1
    assert found.figures[FLOOR].lost == 0
    assert np.isfinite(found.figures["level"].final_rmse.value)
    assert np.isfinite(found.gain("level", FLOOR).value)


def test_gains_are_paired(plant, filters):
    found = monte_carlo(plant, CAR, filters, 12, fleet=16)
    gain = found.gain("level", FLOOR)
    floor, level = (found.figures[n].final_rmse.value for n in (FLOOR, "level"))
    assert gain.value == pytest.approx(floor - level)
    assert 0 < gain.low < gain.value < gain.high
    assert found.gain("level", "level") == (0.0, 0.0, 0.0)
    assert gain_text(gain).startswith(f"{gain.value / 1e3:.1f} kPa better (+")
    assert "worse" in gain_text(found.gain(FLOOR, "level"))


def partly(kind, **fields):
    """An instance that holds only what claims read."""
    made = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    return made


def study_of(filters, named, cases=CASES, repetitions=3):
    """What claims need of a validation, with one filter that finds the truth."""
    chosen = [replace_name(filters[0], n) for n in named]
    plant = replace(PLANT, duration=6.0)
    driven = fake_drives(plant, case_drives(cases, repetitions, plant.duration))
    campaign_of = partial(
        monte_carlo, plant, CAR, driven=fake_drives(plant, sample_drives(range(6), 0))
    )
    result = partly(
        ConventionResult,
        convention="iso8608",
        filters=chosen,
        second=[],
        second_monte_carlo=None,
        monte_carlo=campaign_of(chosen, 6),
        untuned_monte_carlo=campaign_of([f.untuned() for f in chosen[:2]], 6),
        cases=judge_cases(plant, CAR, chosen, cases, repetitions, driven),
    )
    return partly(Validation, conventions={"iso8608": result})


def replace_name(filter, name):
    return replace(filter, candidate=replace(filter.candidate, name=name))


@pytest.fixture(scope="module")
def good_study(filters):
    return study_of(filters, ["printed", "corrected", "printed, A", "corrected, A", "likelihood"])


def verdicts(findings):
    return {f.claim: f.verdict for f in findings}


def test_a_filter_that_finds_the_truth_meets_the_claims_of_accuracy(good_study):
    assert over_all(good_study) == ["printed", "corrected", "likelihood"]
    found = verdicts(case_findings(good_study))
    for words in (
        "On a class A road the estimate",
        "On a class D road the estimate",
        "followed without significant delay",
        "below 5 %",
        "measured road",
    ):
        assert next(v for claim, v in found.items() if words in claim) == HOLDS
    # it has one mode only
    for words in ("the mode of class A", "the mode of class D", "mode 1 is most trusted"):
        assert next(v for claim, v in found.items() if words in claim) == FAILS
    runs = verdicts(monte_carlo_findings(good_study))
    assert next(v for claim, v in runs.items() if "guessing" in claim) == HOLDS
    assert next(v for claim, v in runs.items() if "single class A" in claim) == FAILS


def test_findings_name_every_filter_with_its_numbers(good_study):
    for finding in (*case_findings(good_study), *monte_carlo_findings(good_study)):
        assert "printed" in finding.measured
        assert "corrected" in finding.measured
        assert finding.why.endswith((".", ")"))


def test_verdicts():
    assert verdict_of([True, True]) == HOLDS
    assert verdict_of([True, False]) == IN_PART
    assert verdict_of([False, False]) == FAILS


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"runs": 1}, "--runs: 1"),
        ({"duration": 1.0}, "--duration: 1 s"),
        ({"noise": -1.0}, "--noise"),
        ({"repetitions": 1}, "--repetitions"),
        ({"training": 1}, "--training"),
        ({"conventions": ("iso",)}, "--convention: 'iso' is unknown"),
        ({"second_objective": "rms"}, "second_objective: 'rms'"),
    ],
)
def test_bad_settings_are_refused_by_name(change, words):
    with pytest.raises(InputError, match=words):
        validate_validation(replace(QUICK, **change))


def test_a_measured_road_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="--measured-road"):
        validate_validation(replace(QUICK, measured=tmp_path / "none.txt"))
