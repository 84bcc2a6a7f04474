"""The paper's simulation in the Solmaz study: sensors, limits, judgements on invented runs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigvals
from scipy.optimize import brentq

from wheelhop.cli.reproduce_options import ReproduceOptions
from wheelhop.cli.reproduce_solmaz import settings_of
from wheelhop.errors import InputError
from wheelhop.estimators.failure_modes import mode_names
from wheelhop.io.report import FAILS, HOLDS, IN_PART
from wheelhop.studies.solmaz.paper import (
    BIAS,
    BIASED,
    CLEAN,
    CORRECTED,
    NOISY,
    OBSERVER,
    PRINTED,
    Paper,
    Track,
    sensor_samples,
)
from wheelhop.studies.solmaz.paper_claims import (
    errors,
    paper_findings,
    selection,
    selection_times,
)
from wheelhop.studies.solmaz.paper_figures import paper_figures
from wheelhop.studies.solmaz.paper_limits import guard_at, inner_steer_deficit, mode_limits
from wheelhop.studies.solmaz.paper_tables import paper_numbers, paper_tables
from wheelhop.studies.solmaz.settings import (
    QUICK,
    SPEED,
    SolmazSettings,
    sensor_noise,
    validate_settings,
)
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE

G = 9.80665
RUNS = 20
TIME = np.arange(1, 2001) / 100
SETTINGS = SolmazSettings(runs=RUNS)


def track(right_from=5.5, noisy_until=21.0, error=0.0, biased=True):
    """A method that is right from a time on; with noise until another; its signals off by a share.

    Wrong means model 16, and with noise straight ahead model 1.
    """
    selected = np.full((NOISY + RUNS, len(TIME)), 15)
    selected[NOISY:, TIME < 5.0] = 0
    selected[:, right_from <= TIME + 1e-9] = 7
    selected[NOISY:, noisy_until < TIME] = 15
    if not biased:
        selected[BIASED] = 15
    slip = np.zeros(selected.shape) if biased else BIAS / SPEED * np.tile(TIME, (NOISY + RUNS, 1))
    a, rate = signals()
    cost = np.tile(np.arange(16.0), (len(TIME), 1))
    none = np.zeros(len(TIME), int)
    return Track(selected, slip, (1 + error) * a, (1 + error) * rate, cost, none)


def signals():
    driven = TIME >= 5.0
    return 2.0 * driven * np.sin(TIME), 0.1 * driven * np.sin(TIME)


def invented(**changes):
    a, rate = signals()
    good = {name: track() for name in (PRINTED, CORRECTED, OBSERVER)}
    nothing = np.zeros(len(TIME))
    return Paper(SETTINGS, TIME, nothing, nothing, rate, a, good | changes)


def verdicts(result):
    return [f.verdict for f in paper_findings(result)]


def test_findings_follow_the_numbers():
    good = paper_findings(invented())
    assert [f.verdict for f in good[:7]] == [HOLDS] * 7
    assert "0.50 s after the onset for the first time" in good[0].measured
    assert "in 100% of 20 runs" in good[3].measured

    late = invented(**{PRINTED: track(right_from=6.5)})
    assert verdicts(late)[0] == FAILS
    assert verdicts(invented(**{PRINTED: track(error=0.2)}))[1] == FAILS
    assert verdicts(invented(**{PRINTED: track(error=0.04)}))[1] == HOLDS

    lost = paper_findings(invented(**{PRINTED: track(noisy_until=12.0)}))
    assert lost[3].verdict == FAILS
    assert "0% of the runs name it in the end" in lost[3].measured
    assert lost[4].verdict == HOLDS

    drifting = paper_findings(invented(**{PRINTED: track(biased=False)}))
    assert drifting[5].verdict == FAILS
    assert "drift by 1.500 mrad/s" in drifting[5].measured
    assert "off by 30 mrad" in drifting[5].measured
    assert drifting[6].verdict == HOLDS
    assert verdicts(invented(**{OBSERVER: track(biased=False)}))[6] == FAILS


def test_equations_are_judged_by_what_they_say():
    result = invented()
    right_turns, law, models = paper_findings(result)[7:]
    # the angles of Eq. 2 are wrong whatever the signals are
    assert right_turns.verdict == IN_PART
    assert verdicts(invented(**{PRINTED: track(error=0.2)}))[7] == FAILS
    assert law.verdict == HOLDS
    fast = result._replace(lateral_acceleration=2.5 * result.lateral_acceleration)
    assert verdicts(fast)[8] == FAILS
    assert "models 5 (FL+RL+RR), 9 (FR+RL+RR), 13 (RL+RR), 14 (RL), 15 (RR)" in models.measured


def test_selection_times():
    right = np.zeros(len(TIME), bool)
    assert np.isnan(selection_times(TIME, right)).all()
    right[(TIME > 5.295) & (TIME < 6.0)] = True
    first, held = selection_times(TIME, right)
    assert first == pytest.approx(0.3)
    assert np.isnan(held)
    right[TIME > 7.995] = True
    assert selection_times(TIME, right) == pytest.approx((0.3, 3.0))


def test_shares_count_samples_after_the_first_second_of_steering():
    found = selection(invented(**{PRINTED: track(right_from=7.0, noisy_until=13.0)}), PRINTED)
    # 1401 samples from 6 s to 20 s
    assert found.clean == pytest.approx(1301 / 1401)
    np.testing.assert_allclose(found.noisy, 601 / 1401)
    assert (found.straight, found.straight_right, found.at_end) == (1.0, 0.0, 0.0)
    off, size = errors(invented(**{PRINTED: track(error=0.1)}), PRINTED)["yaw rate"]
    assert off == pytest.approx(0.1 * size)


def test_limits_of_the_models_are_those_of_the_linear_car():
    limits = mode_limits(SPEED)
    loads = 1300 * G / 5.0 * np.array([1.3, 1.3, 1.2, 1.2])

    def system(name, v):
        soft = [corner in name.split("+") for corner in ("FL", "FR", "RL", "RR")]
        k2, k3 = np.where(soft, 4500, 5650), np.where(soft, 12, 15)
        c = (1 - loads / k2) * loads * k3
        arm = np.array([1.2, 1.2, -1.3, -1.3])
        # forces c (delta - beta - arm r / v)
        return np.array(
            [
                [-c.sum() / (1300 * v), -1 - (c @ arm) / (1300 * v * v)],
                [-(c @ arm) / 1200, -(c @ arm**2) / (1200 * v)],
            ]
        )

    for name, critical, growth in zip(
        mode_names(), limits.critical_speed, limits.growth, strict=True
    ):
        assert growth == pytest.approx(eigvals(system(name, SPEED)).real.max(), rel=1e-9)
        if np.isfinite(critical):
            neutral = brentq(lambda v, n=name: np.linalg.det(system(n, v)), 5.0, 90.0)
            assert critical == pytest.approx(neutral, rel=1e-9)
        else:
            assert eigvals(system(name, 150.0)).real.max() < 0
    # F_z = k1 k2 on the outer wheel of the front axle: physics of Eq. 7
    a = guard_at(SOFT_TIRE, front=True)
    assert loads[0] + 1300 * 1.3 * 0.7 / (2.5 * 1.5) * a == pytest.approx(4500)
    assert a == pytest.approx(3.75, abs=0.01)
    assert limits.guard[-1] == guard_at(NOMINAL_TIRE, front=True)
    assert limits.guard[7] == a
    # delta - delta^2 T / 2L against delta + delta^2 T / 2L
    assert inner_steer_deficit(-0.02) == pytest.approx(0.02**2 * 1.5 / 2.5)
    assert inner_steer_deficit(0.02) == pytest.approx(-(0.02**2) * 1.5 / 2.5)


def test_sensors_are_perfect_biased_and_noisy():
    truth = {n: np.sin(TIME) for n in ("time", "steer", "lateral_acceleration", "yaw_rate")}
    many = SolmazSettings(runs=8)
    y = sensor_samples(truth, many)
    assert y.steer.shape == (NOISY + 8, 2000)
    np.testing.assert_array_equal(y.lateral_acceleration[CLEAN], np.sin(TIME))
    np.testing.assert_allclose(y.lateral_acceleration[BIASED] - np.sin(TIME), BIAS)
    np.testing.assert_array_equal(y.yaw_rate[:NOISY], np.tile(np.sin(TIME), (2, 1)))
    off = np.asarray(y.yaw_rate[NOISY:]) - np.sin(TIME)
    assert np.std(off) == pytest.approx(0.002, rel=0.05)
    a, _ = sensor_noise(many, 2000)
    assert np.std(a) == pytest.approx(0.05, rel=0.05)
    assert abs(np.corrcoef(a[0], off[0])[0, 1]) < 0.1
    # a run is its own, whatever the number of runs
    np.testing.assert_array_equal(sensor_noise(replace(many, runs=2), 2000)[0], a[:2])
    assert np.all(sensor_noise(replace(many, seed=1), 2000)[0] != a)


def test_figures_tables_and_numbers_agree():
    result = invented(**{PRINTED: track(right_from=5.3)})
    figures = {f.name: f for f in paper_figures(result)}
    assert list(figures) == ["figure_5", "figure_6", "figure_7", "noise_and_bias"]
    for figure in figures.values():
        assert len({len(column) for column in figure.columns.values()}) == 1
        assert set(figure.units) <= set(figure.columns)
    panels = figures["figure_7"].figure.axes
    assert len(panels) == 4
    assert [t.get_text() for t in panels[2].texts] == ["model 8 from 5.30 s on"]
    assert figures["figure_7"].columns["selected"][-1] == 8
    five = figures["figure_5"].columns
    at = (np.isclose(five["load"], 3e3)) & (np.isclose(five["slip_angle"], np.radians(4)))
    expected = (1 - 3000 / 4500) * 3000 * np.arctan(12 * np.radians(4))
    np.testing.assert_allclose(five["soft"][at], expected)
    np.testing.assert_array_equal(five["soft"][five["load"] > 4500], 0.0)
    assert np.all(five["soft"] <= five["sound"])

    methods, models = paper_tables(result)
    assert methods.columns["first right [s]"] == ["0.30", "0.50", "0.50"]
    assert models.columns["critical speed [km/h]"][12:] == ["57", "112", "112", "none"]
    numbers = paper_numbers(result)
    assert numbers["methods"][PRINTED]["first_right_after_onset_s"] == pytest.approx(0.3)
    assert numbers["models"]["none"]["critical_speed"] is None


def test_settings_and_options_out_of_range_are_refused():
    options = ReproduceOptions(None, None, 0.2, None, 7, None, 3, "float64", False)
    assert settings_of(options) == SolmazSettings(runs=7, noise=0.2, seed=3)
    assert settings_of(replace(options, quick=True, runs=None)) == replace(QUICK, noise=0.2, seed=3)
    with pytest.raises(InputError, match="--duration"):
        settings_of(replace(options, duration=4.0))
    for change, name in (
        ({"runs": 1}, "--runs"),
        ({"noise": -0.1}, "--noise"),
        ({"amplitude": 0.3}, "amplitude"),
        ({"yaw_rate_noise": 2.0}, "yaw_rate_noise"),
    ):
        with pytest.raises(InputError, match=name):
            validate_settings(SolmazSettings(**change))
