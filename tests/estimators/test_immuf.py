"""The corrected Brancati & Tufano estimator: its noise model, its consistency, its limits."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

from wheelhop.errors import DivergenceError, InputError
from wheelhop.estimators.estimate_immuf import estimate_by_immuf
from wheelhop.estimators.immuf import (
    CornerState,
    Tuning,
    corner_model,
    immuf_params,
    member_filter,
    member_params,
    prior,
    substeps_for,
)
from wheelhop.evaluation.consistency import nees
from wheelhop.filtering import drive, independent, smallmat
from wheelhop.vehicle.parameters import BRANCATI_TABLE_3, brancati_suv, with_suspension
from wheelhop.vehicle.quarter_car import Accelerations, RelativeState, simulate
from wheelhop.vehicle.record import CornerRecord
from wheelhop.vehicle.road import class_level
from wheelhop.vehicle.road.shape_filter import CUTOFF
from wheelhop.vehicle.scenario import road_rise_of_class
from wheelhop.vehicle.tire import stiffness_from_pressure

CAR = brancati_suv()
DT, SPEED = 0.002, 60 / 3.6


def state_at(pressure):
    return CornerState(0.0, 0.0, 0.0, 0.0, jnp.log(stiffness_from_pressure(pressure, CAR.tire)))


@pytest.mark.parametrize("milliseconds", [2, 4, 10, 20])
def test_road_noise_equals_van_loans_integral_at_every_rate(milliseconds):
    """Q from the matrix exponential of the linear quarter car driven by white road velocity."""
    dt = 1e-3 * milliseconds
    params = member_params(CAR, class_level("B"), SPEED, dt, Tuning(velocity_walk=0.0))
    model = corner_model(substeps_for(dt))
    found = np.asarray(smallmat.to_dense(model.process_cov(state_at(180e3), params)))
    k_t = float(stiffness_from_pressure(180e3, CAR.tire))
    s, m_s, m_u = CAR.suspension, CAR.sprung_mass, CAR.unsprung_mass
    a = np.array(
        [
            [0, 0, 1, -1],
            [0, 0, 0, 1],
            [-s.stiffness / m_s, 0, -s.damping / m_s, s.damping / m_s],
            [s.stiffness / m_u, -k_t / m_u, s.damping / m_u, -s.damping / m_u],
        ]
    )
    drive_cov = np.zeros((4, 4))
    drive_cov[1, 1] = np.pi * class_level("B") * SPEED
    block = expm(np.block([[-a, drive_cov], [np.zeros((4, 4)), a.T]]) * dt)
    exact = block[4:, 4:].T @ block[:4, 4:]
    sigma = np.sqrt(np.diag(exact))
    scale = np.outer(sigma, sigma)
    assert np.max(np.abs(found[:4, :4] - exact) / scale) < 2e-3
    assert np.linalg.eigvalsh(found[:4, :4] / scale).min() > -1e-12


@pytest.mark.parametrize("rate", [50, 100, 200])
def test_slow_logs_are_filtered_too(rate):
    """A 50 Hz log runs; with the pressure known its innovations are as large as stated."""
    samples, substeps = 8 * rate, 5000 // rate
    road, noise = jax.random.split(jax.random.key(rate))
    travel = jnp.full((samples, substeps), SPEED / (rate * substeps))
    rise = road_rise_of_class(road, class_level("B"), travel)
    zero = jnp.zeros(())
    k_t = stiffness_from_pressure(180e3, CAR.tire)
    truth = simulate(RelativeState(zero, zero, zero, zero), k_t, rise, 1 / rate, CAR)
    a_s, a_u = np.asarray(truth.accelerations) + 0.5 * np.asarray(
        jax.random.normal(noise, (2, samples))
    )
    t = np.arange(1, samples + 1) / rate
    record = CornerRecord(t, a_s, a_u, np.full(samples, SPEED))
    known = Tuning(prior_pressure_sigma=100.0, stiffness_walk=0.0)
    result = estimate_by_immuf(record, CAR, classes=("B",), tuning=known)
    assert np.isfinite(result.pressure).all()
    assert result.nis[rate:].mean() == pytest.approx(2.0, abs=4 * 2 / np.sqrt(7 * rate))


def simulate_run(key, pressure, level, start, samples=1000):
    road, noise = jax.random.split(key)
    rise = road_rise_of_class(road, level, jnp.full((samples, 10), SPEED * DT / 10))
    k_t = stiffness_from_pressure(pressure, CAR.tire)
    truth = simulate(start, k_t, rise, DT, CAR)
    v = 0.5 * jax.random.normal(noise, (2, samples))
    return truth, Accelerations(truth.accelerations.a_s + v[0], truth.accelerations.a_u + v[1])


def test_with_the_stiffness_known_the_filter_is_consistent():
    """128 runs on the matched class: NEES of the motion in its 99.9 % band at every second.

    The truth is simulated ten times finer than the filter steps.
    """
    runs, level = 128, class_level("B")
    tuning = Tuning(stiffness_walk=0.0, velocity_walk=0.0)
    # the shape filter is white 1 + alpha^2 above the class line at high frequency
    params = member_params(CAR, level * (1 + CUTOFF**2), SPEED, DT, tuning)
    sigma = CornerState(0.005, 0.002, 0.05, 0.2, 1e-6)
    belief = independent(state_at(200e3), sigma)
    filter = member_filter(DT)

    def one(key):
        start_key, run_key = jax.random.split(key)
        draws = jax.random.normal(start_key, (4,))
        start = RelativeState(*(s * n for s, n in zip(sigma[:4], draws, strict=True)))
        truth, ys = simulate_run(run_key, 200e3, level, start)
        beliefs, infos = drive.run(filter, belief, ys, params)
        fixed = jnp.full((len(ys.a_s),), belief.mean.ln_k_t)
        return nees(beliefs, CornerState(*truth.state, fixed)), infos.nis

    values, nis = jax.jit(jax.vmap(one))(jax.random.split(jax.random.key(0), runs))
    low, high = chi2.ppf([0.0005, 0.9995], 4 * runs) / runs
    at_seconds = np.asarray(values)[:, 99::300].mean(axis=0)
    assert np.all((at_seconds > low) & (at_seconds < high)), at_seconds
    assert float(nis.mean()) == pytest.approx(2.0, rel=0.01)


def make_record(pressure=200e3, road_class="B", samples=3000, seed=0):
    zero = jnp.zeros(())
    _, ys = simulate_run(
        jax.random.key(seed),
        pressure,
        class_level(road_class),
        RelativeState(zero, zero, zero, zero),
        samples,
    )
    t = DT * np.arange(1, samples + 1)
    return CornerRecord(t, np.asarray(ys.a_s), np.asarray(ys.a_u), np.full(samples, SPEED))


@pytest.mark.parametrize("road_class", ["A", "B", "C", "D"])
def test_the_true_class_wins_on_every_exact_class_road(road_class):
    result = estimate_by_immuf(make_record(road_class=road_class), CAR)
    share = result.mode_probabilities[500:].mean(axis=0)
    assert result.modes[int(np.argmax(share))] == road_class
    np.testing.assert_allclose(result.mode_probabilities.sum(axis=1), 1.0, atol=1e-9)


def test_a_gap_widens_sigma_and_leaves_the_estimate_finite():
    record = make_record()
    gapped = replace(record, a_s=record.a_s.copy(), a_u=record.a_u.copy())
    gapped.a_s[1500:2000] = np.nan
    gapped.a_u[1500:2000] = np.nan
    result = estimate_by_immuf(gapped, CAR)
    assert np.isfinite(result.pressure).all()
    assert result.pressure_sigma[1999] > result.pressure_sigma[1499]
    assert np.all(result.missing[1500:2000] == 2)
    np.testing.assert_allclose(
        result.pressure[:1500], estimate_by_immuf(record, CAR).pressure[:1500], rtol=1e-9
    )


def test_float32_gives_the_same_estimate_within_a_tenth_of_sigma():
    record = make_record()
    double = estimate_by_immuf(record, CAR)
    with jax.enable_x64(False):
        single = estimate_by_immuf(record, CAR)
    deviation = np.abs(single.pressure - double.pressure) / double.pressure_sigma
    assert deviation.max() < 0.1
    assert not single.guarded.any()


def test_the_papers_table_3_can_be_one_set_per_class():
    cars = [with_suspension(CAR, BRANCATI_TABLE_3[c]) for c in "ABCD"]
    result = estimate_by_immuf(make_record(samples=600), CAR, cars=cars)
    assert np.isfinite(result.pressure).all()
    with pytest.raises(InputError, match="2 sets for 4 classes"):
        immuf_params(cars[:2], SPEED, DT)


def test_progress_is_told_to_the_end():
    seen = []
    estimate_by_immuf(make_record(samples=700), CAR, on_progress=lambda *a: seen.append(a))
    assert seen[-1] == (700, 700)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_slow_sampling_takes_more_integrator_steps():
    assert substeps_for(0.002) == 1
    assert substeps_for(0.005) == 2
    assert substeps_for(0.02) == 5


def test_prior_is_the_tuned_pressure():
    belief = prior(CAR, Tuning(prior_pressure=200e3, prior_pressure_sigma=10e3))
    k_t = float(jnp.exp(belief.mean.ln_k_t))
    assert k_t == pytest.approx(float(stiffness_from_pressure(200e3, CAR.tire)))
    spread = float(jnp.sqrt(belief.cov[4][4])) * k_t
    upper = float(stiffness_from_pressure(210e3, CAR.tire))
    assert spread == pytest.approx(upper - k_t)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"noise_a_s": 0.0}, r"tuning\.noise_a_s: 0 m/s\^2"),
        ({"stay": 1.2}, r"tuning\.stay: 1\.2"),
        ({"stiffness_walk": -1.0}, r"tuning\.stiffness_walk"),
        ({"prior_pressure": 180.0}, r"tuning\.prior_pressure: 180 Pa"),
    ],
)
def test_tuning_out_of_range_is_named(changes, message):
    with pytest.raises(InputError, match=message):
        immuf_params(CAR, SPEED, DT, Tuning(**changes))


def test_a_second_record_compiles_nothing():
    traced = []

    def listen(event, duration, **kwargs):
        if event == "/jax/core/compile/jaxpr_trace_duration" and kwargs.get("fun_name") == "piece":
            traced.append(event)

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        first = make_record(samples=450, seed=1)
        estimate_by_immuf(first, CAR)
        assert traced
        traced.clear()
        estimate_by_immuf(make_record_like(first), CAR)
        assert not traced
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)


def make_record_like(record):
    """Another record of the same length, made without JAX."""
    return replace(record, a_s=record.a_s[::-1].copy(), a_u=record.a_u[::-1].copy())


def test_divergence_is_raised_with_the_time():
    record = make_record(samples=600)
    a_u = record.a_u.copy()
    a_u[300] = 1e200
    record = replace(record, a_u=a_u)
    with pytest.raises(DivergenceError, match=r"t = 0\.60"):
        estimate_by_immuf(record, CAR)
