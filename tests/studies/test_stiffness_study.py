"""The stiffness study: its truth, its judgements on invented results, its store and its report."""

import json
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.cli.reproduce_options import ReproduceOptions
from wheelhop.cli.reproduce_stiffness import settings_of
from wheelhop.errors import InputError
from wheelhop.evaluation.bounds import bound, deviation, pooled
from wheelhop.evaluation.spectra import IsoRoad, corner_spectrum
from wheelhop.filtering import Filter
from wheelhop.filtering.interface import Info
from wheelhop.io.report import FAILS, HOLDS, IN_PART
from wheelhop.studies.frame import Store
from wheelhop.studies.stiffness import (
    axle_pairs,
    claims,
    continuous,
    exact_classes,
    parts,
    several_wheels,
)
from wheelhop.studies.stiffness.axle_pairs import AxlePairs, PairTrack
from wheelhop.studies.stiffness.claims_classes import class_findings
from wheelhop.studies.stiffness.claims_pairs import median_ratio, pair_findings, pair_nees
from wheelhop.studies.stiffness.continuous import Continuous, Track
from wheelhop.studies.stiffness.exact_classes import CASES, ROAD_CHANGES, ExactClasses, lag
from wheelhop.studies.stiffness.frame import QUICK, StiffnessSettings
from wheelhop.studies.stiffness.pair_truth import WHEELBASE, pair_drives, simulated_pair
from wheelhop.studies.stiffness.report import write_stiffness_study
from wheelhop.studies.stiffness.runs import (
    DRAWN,
    Estimator,
    Reading,
    corner_rate,
    followed,
    kept_times,
    ln_sigma,
)
from wheelhop.studies.stiffness.several_wheels import PAIRS, SeveralWheels
from wheelhop.studies.stiffness.study import stiffness_study, validate_settings
from wheelhop.studies.stiffness.truth import Drives, levels, simulated, speeds, uniform
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import Accelerations

CAR = brancati_suv()
LINEAR = replace(
    CAR, suspension=replace(CAR.suspension, cubic_stiffness=0.0, quadratic_damping=0.0)
)
RUNS = 100


@contextmanager
def no_bar(label, unit):
    yield lambda done, total: None


# truth


def test_the_simulated_car_has_the_spectrum_of_an_iso_road():
    settings = StiffnessSettings(runs=16)
    shape, level, speed = (16, 4000), 16e-6, 16.0
    drives = Drives(np.full(shape, 180e3), np.full(shape, level), np.full(16, speed))
    measured = simulated("spectrum", LINEAR, drives, settings)
    spectrum = corner_spectrum(LINEAR, 180e3, IsoRoad(level), speed)
    step = spectrum.frequency[1] - spectrum.frequency[0]
    exact = 2.0 * step * np.einsum("fii->i", spectrum.density).real
    found = [np.mean(a[:, 500:] ** 2) for a in measured]
    np.testing.assert_allclose(found, exact, rtol=0.08)
    # independent of how many runs there are
    few = simulated("spectrum", LINEAR, Drives(*(a[:16] for a in drives)), settings)
    np.testing.assert_array_equal(few.a_u, measured.a_u)


def test_a_run_depends_on_its_own_number_name_and_seed():
    small, large = StiffnessSettings(runs=3), StiffnessSettings(runs=40)
    np.testing.assert_array_equal(speeds("x", small), speeds("x", large)[:3])
    assert not np.any(speeds("x", small) == speeds("y", small))
    assert not np.any(speeds("x", small) == speeds("x", replace(small, seed=1)))
    many = StiffnessSettings(runs=400)
    assert 40 / 3.6 <= speeds("x", many).min() < speeds("x", many).max() <= 80 / 3.6
    drawn = np.log2(levels("x", many) / 8e-6)
    assert -4 <= drawn.min() < -3.8
    assert 3.8 < drawn.max() <= 4
    assert np.std(drawn) * np.log(2) == pytest.approx(DRAWN.prior_level_sigma, rel=0.06)
    pressure = uniform("p", many, 130e3, 230e3)
    assert np.std(pressure) == pytest.approx(DRAWN.prior_pressure_sigma, rel=0.06)


def counter():
    """A filter that counts samples and adds up the speeds."""

    def step(state, y, params):
        n, total = state
        zero = 0.0 * y.a_s
        return (n + 1.0 + zero, total + params), Info(*(zero for _ in Info._fields))

    return Filter(lambda prior, params: prior, step, None)


def test_followed_keeps_the_samples_that_its_times_say():
    zero = jnp.zeros(())
    estimator = Estimator(
        counter(), (zero, zero), zero, lambda params, v: params + v, lambda s, i: Reading(*s)
    )
    y = Accelerations(np.zeros((5, 100)), np.zeros((5, 100)))
    speed = np.arange(5.0)
    found = followed(estimator, y, speed, 25)
    np.testing.assert_allclose(found.ln_k_t, np.tile([25.0, 50, 75, 100], (5, 1)))
    np.testing.assert_allclose(found.variance, speed[:, None] * found.ln_k_t)
    np.testing.assert_allclose(kept_times(0.2, 25), [0.05, 0.1, 0.15, 0.2])


def test_the_filter_of_the_study_learns_on_a_known_kind_of_road():
    settings = StiffnessSettings(runs=3, longest=2.0, bound_runs=2)
    rows = {continuous.MAIN: continuous.ROWS[continuous.MAIN]}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(continuous, "ROWS", rows)
        result = continuous.continuous(settings, Store(None), lambda done, total: None)
    track = result.tracks[continuous.MAIN]
    assert track.error.shape == track.variance.shape == (3, 20)
    sigma = np.sqrt(track.variance)
    assert np.all(np.abs(track.error) < 4 * sigma)
    # what it states comes down to the bound, from the prior
    assert result.bound[0] < ln_sigma(DRAWN, CAR)
    np.testing.assert_allclose(np.sqrt(track.variance[:, -1].mean()), result.bound[-1], rtol=0.15)


@pytest.mark.parametrize(
    "make",
    [
        exact_classes.class_estimator,
        *(row.make for row in list(continuous.ROWS.values())[1:3]),
        lambda car, noise: axle_pairs.pair_estimator((car, car), 0.9, noise),
        lambda car, noise: several_wheels.four_estimator(several_wheels.vehicle(), noise),
    ],
)
def test_every_estimator_gives_finite_scalars(make):
    estimator = make(CAR, 0.5)
    state = estimator.filter.init(estimator.prior, estimator.params)
    reading = estimator.keep(state, None)
    assert all(jnp.shape(leaf) == () and jnp.isfinite(leaf) for leaf in jax.tree.leaves(reading))
    params = estimator.bind(estimator.params, jnp.asarray(20.0))
    same = jax.tree.map(lambda a, b: jnp.shape(a) == jnp.shape(b), params, estimator.params)
    assert all(jax.tree.leaves(same))


# judgements


def invented_classes(scale=0.9, late=0.0, delay=0.5):
    """Errors of `scale` times the bound; `late` [Pa] more in one run of one case."""
    rng = np.random.default_rng(0)
    t = np.arange(1, 101) / 10
    best = 6e3 * np.sqrt(2.0 / t) * np.linspace(0.8, 1.1, len(CASES))[:, None]
    error = scale * best[:, None] * rng.normal(size=(len(CASES), RUNS, len(t)))
    error = np.clip(error, -3 * best[:, None], 3 * best[:, None])
    error[3, 7, 60] += late
    change = {n: scale * 6e3 * rng.normal(size=(RUNS, len(t))) for n in ROAD_CHANGES}
    truth = np.interp(t, [5.0, 6.5], [230e3, 180e3])
    leak = np.interp(t - delay, t, truth) + 2e3 * rng.normal(size=(RUNS, len(t)))
    bounds = {n: 6e3 * np.ones(len(t)) for n in ROAD_CHANGES}
    return ExactClasses(t, error, best, change, bounds, truth, leak)


def test_class_findings_follow_the_numbers():
    good = class_findings(invented_classes(scale=0.7))
    assert [f.verdict for f in good] == [HOLDS] * 6
    some = class_findings(invented_classes(scale=1.2))
    assert some[0].verdict == IN_PART
    bad = class_findings(invented_classes(scale=3.0, delay=1.5))
    assert [f.verdict for f in bad[:2]] == [FAILS, FAILS]
    assert bad[5].verdict == FAILS
    assert "1.50 s" in bad[5].measured
    one = class_findings(invented_classes(scale=0.7, late=60e3))
    assert one[2].verdict == IN_PART
    assert f"1 of {12 * RUNS} runs" in one[2].measured


def test_a_bound_above_the_target_is_said():
    result = invented_classes()
    assert "above 7 kPa" not in class_findings(result)[0].why
    result = result._replace(bound=1.1 * result.bound)
    above = np.sum(result.bound[:, np.isclose(result.time, 2.0)] > 7e3)
    assert above > 0
    assert f"above 7 kPa in {above} of 12" in class_findings(result)[0].why


def test_lag_is_the_delay_that_was_put_in():
    result = invented_classes(delay=0.7)
    shift, left = lag(result.time, result.leak_truth, result.leak, 5.0)
    np.testing.assert_allclose(shift, 0.7, atol=0.101)
    assert shift.low <= shift.value <= shift.high
    assert left == pytest.approx(2e3, rel=0.05)


def invented_continuous(scale=1.0, honest=1.0):
    rng = np.random.default_rng(0)
    t = np.arange(1, 601) / 10
    best = 0.12 / np.sqrt(1 + t)
    error = scale * best * rng.normal(size=(RUNS, len(t)))
    variance = np.broadcast_to((honest * best) ** 2, error.shape)
    return Continuous(t, dict.fromkeys(continuous.ROWS, Track(error, variance)), best)


def test_continuous_findings_follow_the_numbers():
    near = invented_continuous()
    at_bound, honest = claims.continuous_findings(near)
    for t in continuous.REPORTED:
        ratio = claims.ratio_at(near, near.tracks[continuous.MAIN], t)
        assert ratio.low < 1.0 + 0.15
        assert ratio.high > 1.0 - 0.15
        assert ratio.low < ratio.value < ratio.high
    assert claims.continuous_findings(invented_continuous(0.8, 0.8))[0].verdict == HOLDS
    above, proud = claims.continuous_findings(invented_continuous(1.4))
    assert above.verdict == FAILS
    assert proud.verdict == FAILS
    assert at_bound.verdict in (HOLDS, IN_PART)
    assert "1.0" in honest.measured


def invented_wheels(scale=1.0):
    """Errors with a large part that all wheels share."""
    rng = np.random.default_rng(0)
    t = np.arange(1, 201) / 10
    own, shared = 0.009 * np.sqrt(10.0 / t), 0.03
    error = scale * own[:, None] * rng.normal(size=(RUNS, len(t), 4))
    error = error + scale * shared * rng.normal(size=(RUNS, len(t), 1))
    cov = own[:, None, None] ** 2 * np.eye(4) + shared**2 * np.ones((4, 4))
    bounds = dict.fromkeys(several_wheels.COMBINATIONS, own * np.sqrt(2))
    return SeveralWheels(t, error, np.broadcast_to(cov, (RUNS, len(t), 4, 4)), bounds)


def test_wheel_findings_follow_the_numbers():
    result = invented_wheels()
    between, honest = claims.wheels_findings(result)
    assert between.verdict == HOLDS
    np.testing.assert_allclose(claims.wheel_nees(result).mean(), 4.0, rtol=0.02)
    k = 99
    pairs = claims.wheel_errors(result, PAIRS)[:, k]
    np.testing.assert_allclose(np.sqrt(np.mean(pairs**2)), 0.009 * np.sqrt(2), rtol=0.06)
    np.testing.assert_allclose(claims.wheel_stated(result, PAIRS)[k], 0.009 * np.sqrt(2))
    mean = claims.wheel_stated(result, several_wheels.AGAINST_MEAN)[k]
    np.testing.assert_allclose(mean, 0.009 * np.sqrt(0.75))
    worse, proud = claims.wheels_findings(invented_wheels(2.0))
    assert worse.verdict == FAILS
    assert proud.verdict == FAILS
    assert honest.verdict in (HOLDS, IN_PART)


def test_bounds_of_differences_are_those_of_the_pooled_information():
    cars = several_wheels.vehicle()
    pressure = np.array([[140e3, 150e3, 200e3, 220e3]])
    times = np.array([2.0, 10.0])
    found = several_wheels._bounds(cars, pressure, np.array([8e-6]), np.array([16.0]), times, 0.5)
    wheels = several_wheels.WHEELS
    each = {
        w: corner_rate(c, p, 8e-6, 16.0, 0.5)
        for w, c, p in zip(wheels, cars, pressure[0], strict=True)
    }
    names = [f"k_t {w}" for w in wheels]
    prior = dict.fromkeys(names, ln_sigma(DRAWN, CAR)) | {"level": 1.6}
    best = bound(pooled(each), times, prior)
    pairs = [deviation(best, a, b) ** 2 for i, a in enumerate(names) for b in names[:i]]
    np.testing.assert_allclose(found[PAIRS], np.sqrt(np.mean(pairs, axis=0)), rtol=1e-6)
    lone = [deviation(best, a) ** 2 for a in names]
    np.testing.assert_allclose(
        found[several_wheels.ABSOLUTE], np.sqrt(np.mean(lone, axis=0)), rtol=1e-6
    )


def invented_pairs(scale=1.0):
    rng = np.random.default_rng(0)
    t = np.arange(1, 201) / 10
    best = 0.06 / np.sqrt(1 + t / 2)
    tracks = {}
    for coherence in axle_pairs.COHERENCES:
        error = scale * best[:, None] * rng.normal(size=(RUNS, len(t), 2))
        cov = np.broadcast_to(best[:, None, None] ** 2 * np.eye(2), (RUNS, len(t), 2, 2))
        tracks[coherence] = PairTrack(error, cov, best)
    return AxlePairs(t, tracks)


def test_pair_findings_follow_the_numbers():
    near = invented_pairs()
    assert [f.verdict for f in pair_findings(near)] == [HOLDS, HOLDS]
    track = near.tracks[0.9]
    assert median_ratio(near, track, 5.0) == pytest.approx(1.0, rel=0.2)
    np.testing.assert_allclose(pair_nees(track).mean(), 2.0, rtol=0.03)
    assert [f.verdict for f in pair_findings(invented_pairs(2.0))] == [FAILS, FAILS]


def test_the_rear_wheel_meets_the_front_wheels_road_after_the_delay():
    settings = StiffnessSettings(runs=3, substeps=4)
    drives = pair_drives(settings)
    drives = drives._replace(level=np.full(3, 100e-6))
    cars = (LINEAR, LINEAR)  # alike, and on one pressure: only the delay and the noise are left
    drives = drives._replace(pressure=np.full((3, 2), 180e3))
    measured = simulated_pair(cars, drives, 1.0, 2000, settings)
    for run in range(3):
        delay = drives.steps[run] / (4 * 500)
        assert delay == pytest.approx(WHEELBASE / drives.speed[run])
        front, rear = measured.front.a_u[run], measured.rear.a_u[run]
        shifts = np.arange(20, 200)
        fit = [np.corrcoef(front[: -k - 1], rear[k:-1])[0, 1] for k in shifts]
        assert shifts[np.argmax(fit)] == pytest.approx(500 * delay, abs=1)
        assert max(fit) > 0.95
    own = simulated_pair(cars, drives, 0.0, 2000, settings)
    np.testing.assert_array_equal(own.front.a_u, measured.front.a_u)
    k = round(500 * drives.steps[0] / 2000)
    assert abs(np.corrcoef(own.front.a_u[0][:-k], own.rear.a_u[0][k:])[0, 1]) < 0.3


# store, frame and report


def test_what_is_kept_is_not_computed_again_unless_it_is_another_or_damaged(tmp_path):
    calls = []

    def compute(value):
        calls.append(value)
        return {"a": np.full(3, value)}

    store = Store(tmp_path)
    for _ in range(2):
        assert store.arrays("x", {"runs": 3}, partial(compute, 1.0))["a"][0] == 1.0
    assert calls == [1.0]
    assert store.arrays("x", {"runs": 4}, partial(compute, 2.0))["a"][0] == 2.0
    assert len(list(tmp_path.glob("x-*.npz"))) == 1
    (file,) = tmp_path.glob("x-*.npz")
    file.write_bytes(file.read_bytes()[:40])
    assert store.arrays("x", {"runs": 4}, partial(compute, 3.0))["a"][0] == 3.0
    assert calls == [1.0, 2.0, 3.0]
    assert Store(None).arrays("x", {}, partial(compute, 4.0))["a"][0] == 4.0


def test_a_study_writes_figures_with_their_numbers_results_and_report(tmp_path):
    invented = {
        "exact_classes": invented_classes(),
        "continuous": invented_continuous(),
        "four_corners": invented_wheels(),
        "axle_pair": invented_pairs(),
    }
    chosen = [
        replace(part, run=lambda settings, store, advance, name=part.name: invented[name])
        for part in parts.PARTS
        if part.name in invented
    ]
    study = stiffness_study(QUICK, None, no_bar, chosen)
    names, findings = write_stiffness_study(study, tmp_path, {"command": "test"}, quick=True)
    for name in names:
        assert (tmp_path / name).stat().st_size > 0
    content = json.loads((tmp_path / "results.json").read_text())
    assert len(content["findings"]) == len(findings) == 12
    assert set(content["results"]) == set(invented)
    rms = content["results"]["continuous"]["filters"]["RML"]["rms"]["10 s"]
    expected = claims.rms(invented["continuous"].tracks["RML"].error)[99]
    assert rms["value"] == pytest.approx(expected)
    assert rms["low"] < rms["value"] < rms["high"]
    text = (tmp_path / "report.md").read_text()
    assert "quick run" in text
    assert all(f.claim in text for f in findings)


def test_settings_and_options_out_of_range_are_refused():
    options = ReproduceOptions(None, None, 0.2, None, 7, None, 3, "float64", False)
    assert settings_of(options) == StiffnessSettings(runs=7, noise=0.2, seed=3)
    assert settings_of(replace(options, quick=True, runs=None)).runs == QUICK.runs
    with pytest.raises(InputError, match="--duration"):
        settings_of(replace(options, duration=4.0))
    with pytest.raises(InputError, match="--runs"):
        validate_settings(StiffnessSettings(runs=1))
    with pytest.raises(InputError, match="--noise"):
        validate_settings(StiffnessSettings(noise=0.0))
