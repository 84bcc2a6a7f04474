"""Campaigns: reproducible, resumable, honest about their own statistics."""

from dataclasses import replace

import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.evaluation.errors import error_statistics
from wheelhop.montecarlo import campaign
from wheelhop.montecarlo.campaign import finished_runs, run_campaign
from wheelhop.montecarlo.run import report_times
from wheelhop.montecarlo.scenarios import CampaignSettings, draw_scenario
from wheelhop.montecarlo.summary import summarise_campaign
from wheelhop.vehicle.parameters import brancati_suv

CAR = brancati_suv()
SMALL = CampaignSettings(runs=6, duration=0.5, substeps=4)


def never(*args):
    raise AssertionError("a run was started")


@pytest.fixture(scope="module")
def result():
    return run_campaign(SMALL, CAR)


def test_shapes_and_finiteness(result):
    assert result.error.shape == (6, 25)
    for values in result:
        assert np.isfinite(values).all()
    assert np.all((result.pressure >= 130e3) & (result.pressure <= 230e3))
    assert np.all((result.speed >= 40 / 3.6) & (result.speed <= 80 / 3.6))


def test_summary_is_taken_from_the_last_sample_of_every_run(result):
    statistics = error_statistics(result.error, result.sigma)
    summary = summarise_campaign(result, statistics, SMALL)
    final = result.error[:, -1]
    assert summary["final_rms_error_Pa"] == pytest.approx(np.sqrt(np.mean(final**2)))
    assert summary["final_median_abs_error_Pa"] == pytest.approx(np.median(np.abs(final)))
    guess = np.sqrt(np.mean((180e3 - result.pressure) ** 2))
    assert summary["rms_error_of_the_prior_Pa"] == pytest.approx(guess)
    weights = [np.sum(result.road_class == k) for k in range(4)]
    squares = [summary["final_rms_error_by_class_Pa"].get(c, 0.0) ** 2 for c in "ABCD"]
    assert np.average(squares, weights=weights) == pytest.approx(np.mean(final**2))
    assert len(report_times(SMALL)) == result.error.shape[1]


def test_chunks_do_not_change_results_and_finished_ones_are_not_run_again(
    result, tmp_path, monkeypatch
):
    monkeypatch.setattr(campaign, "CHUNK", 4)
    first = run_campaign(SMALL, CAR, tmp_path)
    for found, expected in zip(first, result, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert sorted(p.name for p in tmp_path.glob("*.npz")) == [
        "runs-0000000.npz",
        "runs-0000004.npz",
    ]
    monkeypatch.setattr(campaign, "run_many", never)
    again = run_campaign(SMALL, CAR, tmp_path)
    np.testing.assert_array_equal(again.error, first.error)


def test_an_interrupted_campaign_resumes_where_it_stopped(result, tmp_path, monkeypatch):
    monkeypatch.setattr(campaign, "CHUNK", 4)

    def interrupt(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_campaign(SMALL, CAR, tmp_path, on_progress=interrupt)
    assert [p.name for p in tmp_path.glob("*.npz")] == ["runs-0000000.npz"]
    resumed = run_campaign(SMALL, CAR, tmp_path)
    np.testing.assert_allclose(resumed.error, result.error, rtol=1e-9)


def test_a_store_of_another_campaign_is_refused(tmp_path):
    run_campaign(replace(SMALL, runs=2), CAR, tmp_path)
    with pytest.raises(InputError, match="another campaign"):
        run_campaign(replace(SMALL, runs=2, seed=1), CAR, tmp_path)


def test_a_run_depends_on_seed_and_number_alone():
    many = replace(SMALL, runs=1000)
    assert float(draw_scenario(SMALL, 3).pressure) == float(draw_scenario(many, 3).pressure)
    other = replace(SMALL, seed=1)
    assert float(draw_scenario(SMALL, 3).pressure) != float(draw_scenario(other, 3).pressure)


def test_level_spread_moves_the_road_off_its_centre():
    exact = [float(draw_scenario(SMALL, k).level) for k in range(30)]
    assert set(np.round(np.log(np.array(exact) / 1e-6) / np.log(4), 9)) <= {0.0, 1.0, 2.0, 3.0}
    spread = replace(SMALL, level_spread=0.5)
    classes = np.array(
        [np.log(float(draw_scenario(spread, k).level) / 1e-6) / np.log(4) for k in range(60)]
    )
    assert classes.min() > -0.5
    assert classes.max() < 3.5
    assert np.abs(classes - np.round(classes)).max() > 0.3


def test_damaged_and_foreign_chunks_are_run_again(tmp_path):
    two = replace(SMALL, runs=2)
    first = run_campaign(two, CAR, tmp_path)
    assert finished_runs(tmp_path, two, CAR) == 2
    chunk = tmp_path / "runs-0000000.npz"
    chunk.write_bytes(chunk.read_bytes()[:100])
    assert finished_runs(tmp_path, two, CAR) == 0
    np.testing.assert_array_equal(run_campaign(two, CAR, tmp_path).error, first.error)

    other = replace(two, seed=5)
    (tmp_path / "campaign.json").unlink()
    assert finished_runs(tmp_path, other, CAR) == 0
    assert not np.array_equal(run_campaign(other, CAR, tmp_path).error, first.error)
    (tmp_path / "campaign.json").write_text("{")
    with pytest.raises(InputError, match="another campaign"):
        run_campaign(other, CAR, tmp_path)


def test_the_filter_follows_the_convention_of_the_road():
    """The paper's smoother roads are recognised as well as the standard's."""
    settings = CampaignSettings(runs=12, duration=2.0, convention="brancati2022")
    result = run_campaign(settings, CAR)
    assert result.true_class_probability[:, 50:].mean() > 0.6
    assert result.nis.mean() == pytest.approx(1.9, abs=0.15)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"runs": 1}, "--runs: 1 has no spread"),
        ({"duration": -1.0}, "duration: -1 s"),
        ({"classes": ("A", "Q")}, "'Q' is not an ISO 8608 class"),
        ({"convention": "printed"}, "'printed' is unknown"),
        ({"pressure": (230e3, 130e3)}, "pressure"),
    ],
)
def test_bad_settings_are_named_before_anything_runs(changes, message, monkeypatch):
    monkeypatch.setattr(campaign, "run_many", never)
    with pytest.raises(InputError, match=message):
        run_campaign(replace(SMALL, **changes), CAR)


@pytest.mark.slow
def test_100_runs_of_the_paper_are_overconfident_as_the_readme_says():
    """The joint state cannot be honest: the README's limits, kept true."""
    result = run_campaign(CampaignSettings(), CAR)
    final = result.error[:, -1]
    assert np.sqrt(np.mean(final**2)) == pytest.approx(28.0e3, rel=0.05)
    assert np.mean(np.abs(final) < result.sigma[:, -1]) == pytest.approx(0.32, abs=0.06)
    assert result.true_class_probability.mean() == pytest.approx(0.83, abs=0.03)
