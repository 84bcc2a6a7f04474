"""The four wheel loads jointly: model against the simulator, honesty, drives, refusals."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from load_drive import (
    CAR,
    CHASSIS,
    HEAVY,
    SAMPLES,
    drive,
    least_squares_moments,
    lost,
    nees,
    recorder,
    rms,
    sample_of,
)
from scipy.stats import chi2

from wheelhop.errors import InputError
from wheelhop.estimators import joint_load
from wheelhop.estimators.joint_load import CHUNK, wheel_loads
from wheelhop.estimators.joint_load_mixture import bank_weights, tilted_variance
from wheelhop.estimators.joint_load_model import (
    JointLoadBelief,
    joint_load_model,
    joint_load_prior,
    shown_accelerations,
)
from wheelhop.estimators.joint_load_params import JointLoadTuning, joint_load_params
from wheelhop.staging import staged_jit
from wheelhop.vehicle.equilibrium import static_equilibrium
from wheelhop.vehicle.full_vehicle import Surroundings
from wheelhop.vehicle.linearise import static_gain
from wheelhop.vehicle.load_record import LARGEST_BODY, LARGEST_WHEEL, VehicleLoadSample

WEIGHT = 9.80665 * float(CHASSIS.body_mass + CHASSIS.wheel_mass.sum())
FEW = JointLoadTuning(load_walks=(1e3, 5e3))
LIKE_MODEL = JointLoadTuning(load_walks=(1e3,), patch_tilt=0.0, tilt_per_walk=0.0)


def at_rest(noise=0.0, seed=0, samples=SAMPLES):
    draw = np.random.default_rng(seed).standard_normal((12, samples))
    sigma = np.repeat([0.5, 5e-4, 0.5], 4)[:, None]
    return VehicleLoadSample(*(noise * sigma * draw))


def test_the_model_sees_what_the_simulated_vehicle_shows():
    truth, params = drive().truth, joint_load_params(CAR, 1e-3, FEW)
    moments = least_squares_moments(truth.body_acceleration, truth.strut)
    s, w, loads = (
        jnp.asarray(a.T) for a in (truth.compression, truth.compression_rate, truth.load)
    )
    belief = JointLoadBelief(*s, *w, *loads, *map(jnp.asarray, moments), jnp.zeros(SAMPLES))
    body, wheel = shown_accelerations(s, w, belief, params)
    # two moments fit two of the four; heave and twist are the model's
    np.testing.assert_allclose(body.T, truth.body_acceleration, atol=1e-6)
    masses = np.asarray(CHASSIS.wheel_mass)
    missing = (truth.wheel_acceleration - np.asarray(wheel.T)) * masses
    # the braking force along the slope of the ground under a wheel, which the model cannot know
    slope = np.gradient(truth.elevation, 1e-3, axis=0) / truth.speed[:, None]
    along_slope = truth.longitudinal * slope
    braking = slice(700, None)
    assert rms(along_slope[braking]) > 10.0
    assert rms((missing - along_slope)[braking]) < 7.0
    # and has in the variance of the loads, by the intensity that the bank believes in on class B
    mean = np.asarray(jnp.stack(belief, 1))
    variance = tilted_variance(mean, np.full(SAMPLES, 2e3**2), params)
    share = missing[braking] ** 2 / variance[braking]
    assert 0.4 < share.mean() < 1.2
    # what it knows is most of the tilt's effect: the body's own lean
    upright = (loads.T - truth.strut) - masses * (9.80665 + truth.wheel_acceleration)
    assert np.abs(missing[braking].mean(0)).max() < 0.5 * np.abs(upright[braking].mean(0)).max()


def test_loads_compress_the_struts_as_in_the_simulated_vehicle():
    """d compression / d load with s'' = 0 and no horizontal force: inertias, places and springs."""
    params, pressure = joint_load_params(CAR, 1e-3, FEW), jnp.full(4, 250e3)
    flat = jax.tree.map(jnp.asarray, Surroundings())
    rest = staged_jit(static_equilibrium)(CAR, pressure, flat)

    def relative(s, loads):
        zero = jnp.zeros(())
        belief = JointLoadBelief(*s, *[zero] * 4, *loads, zero, zero, zero)
        body, wheel = shown_accelerations(s, jnp.zeros(4), belief, params)
        return wheel - body

    by_place, by_load = jax.jit(jax.jacfwd(relative, (0, 1)))(rest.compression, rest.load)
    found = -np.linalg.solve(by_place, by_load)
    expected = static_gain(rest, CAR, flat)
    np.testing.assert_allclose(found, expected, atol=2e-3 * float(np.abs(expected).max()))


@cache
def sampler(dt):
    """Records drawn from the filter's own model, with its own noise: seed, samples -> y, x."""
    params = joint_load_params(CAR, dt, LIKE_MODEL, *LIKE_MODEL.load_walks)
    # from rest: the loads of the model wander off without end, so the record is short
    start = joint_load_prior(params).mean
    record = recorder(joint_load_model(), params, start)
    return lambda seed, samples: record(seed, np.zeros((samples, len(start))))


def test_on_its_own_model_the_covariance_is_honest():
    sample, state = sampler(1e-3)(8, SAMPLES)
    found = wheel_loads(sample, 1e-3, CAR, LIKE_MODEL)
    # samples 50 ms apart: their errors are nearly independent
    square = nees(found, state[:, 8:12])[100::50]
    low, high = chi2.ppf([0.005, 0.995], 4 * len(square)) / len(square)
    assert low < square.mean() < high
    low, high = chi2.ppf([0.005, 0.995], 12 * (SAMPLES - 100)) / (SAMPLES - 100)
    assert low < found.nis[100:].mean() < high
    error = found.load - state[:, 8:12]
    assert 0.93 < np.mean(np.abs(error[100:]) < 2 * found.sigma[100:]) < 0.975


@pytest.mark.slow
def test_over_runs_on_its_own_model_the_covariance_is_honest():
    squares = []
    for seed in range(24):
        sample, state = sampler(2e-3)(seed, 500)
        found = wheel_loads(sample, 2e-3, CAR, LIKE_MODEL)
        # 100 ms apart, several correlation times of the errors
        squares.append(nees(found, state[:, 8:12])[100::50])
    square = np.concatenate(squares)
    low, high = chi2.ppf([0.005, 0.995], 4 * square.size) / square.size
    assert low < square.mean() < high


def test_a_drive_of_the_full_vehicle_with_wheel_accelerometers():
    truth = drive().truth
    told = []
    found = wheel_loads(
        sample_of(drive().measured), 1e-3, CAR, FEW, on_progress=lambda *so_far: told.append(so_far)
    )
    assert told == [(k * CHUNK, 2 * SAMPLES) for k in range(1, 7)]
    error = (found.load - truth.load)[300:]
    assert rms(error) < 45.0
    # 0.989 and 2.2 on this one drive: with two filters in place of four a little too careful
    assert 0.96 < np.mean(np.abs(error) < 2 * found.sigma[300:]) < 0.998
    assert 1.6 < nees(found, truth.load)[300:].mean() < 3.0
    total = (found.total - truth.load.sum(1))[300:]
    assert np.mean(np.abs(total) < 2 * found.total_sigma[300:]) > 0.92
    assert abs(found.body_mass[-1] / float(CHASSIS.body_mass) - 1.0) < 0.005
    assert set(found.freedom) == {12}
    # the load transfer itself: front wheels by more than the error
    assert (found.load[-300:, :2] - found.load[300:500, :2].mean(0)).mean() > 200.0


def test_a_drive_without_wheel_accelerometers_is_less_sure():
    truth = drive().truth
    found = wheel_loads(sample_of(drive().measured, wheel=False), 1e-3, CAR, FEW)
    error = (found.load - truth.load)[300:]
    assert rms(error) < np.std(truth.load[300:], axis=0).mean()
    assert 0.90 < np.mean(np.abs(error) < 2 * found.sigma[300:]) < 0.98
    assert set(found.freedom) == {8}


def test_a_payload_that_nobody_told_of_is_found():
    truth, one = drive(heavy=True).truth, replace(FEW, load_walks=(5e3,))
    found = wheel_loads(sample_of(drive(heavy=True).measured), 1e-3, CAR, one)
    error = (found.load - truth.load)[300:]
    assert rms(error) < 45.0
    assert np.mean(np.abs(error) < 2 * found.sigma[300:]) > 0.92
    off = found.body_mass[-1] - float(HEAVY.chassis.body_mass)
    assert abs(off) < 2 * found.body_mass_sigma[-1]
    assert found.body_mass_sigma[-1] < 5.0


def test_at_rest_the_loads_are_the_weight():
    found = wheel_loads(at_rest(), 1e-3, CAR, FEW, uninitialised=True)
    np.testing.assert_allclose(found.total[-1], WEIGHT, rtol=1e-3)
    np.testing.assert_allclose(found.load[-1], joint_load_params(CAR, 1e-3).static_load, rtol=2e-3)


def test_at_100_hz_it_finds_the_loads_from_nothing():
    # sigma points too far out see the dampers past their knee and never come back
    sample = at_rest(1.0, samples=400)
    found = wheel_loads(sample, 1e-2, CAR, replace(FEW, load_walks=(1e3,)), uninitialised=True)
    error = (found.load - np.asarray(joint_load_params(CAR, 1e-2).static_load))[50:]
    assert rms(error) < 60.0
    assert np.mean(np.abs(error) < 2 * found.sigma[50:]) > 0.92


@pytest.mark.slow
def test_pieces_of_a_record_join_without_a_seam(monkeypatch):
    sample = sample_of(drive().measured)
    pieces = wheel_loads(sample, 1e-3, CAR, FEW)
    monkeypatch.setattr(joint_load, "CHUNK", SAMPLES - 7)
    padded = wheel_loads(sample, 1e-3, CAR, FEW)
    monkeypatch.setattr(joint_load, "CHUNK", SAMPLES)
    whole = wheel_loads(sample, 1e-3, CAR, FEW)
    for found in (pieces, padded):
        np.testing.assert_allclose(found.load, whole.load, rtol=1e-9)
        np.testing.assert_allclose(found.covariance, whole.covariance, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
def test_in_single_precision(float32):
    del float32
    car = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), CAR)
    found = wheel_loads(at_rest(1.0), 1e-3, car, replace(FEW, load_walks=(3e3,)))
    error = found.total[500:] - WEIGHT
    assert np.mean(np.abs(error) < 3 * found.total_sigma[500:]) > 0.95


def test_the_bank_believes_the_filter_that_foretells():
    weights = bank_weights(
        np.array([[0.0] * 1000 + [-1.0] * 1000, [-1.0] * 1000 + [0.0] * 1000]), 1e-2
    )
    np.testing.assert_allclose(weights.sum(0), 1.0)
    assert weights[0, 999] > 0.999
    assert weights[1, -1] > 0.999


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"a_s_FL": np.zeros(7)}, "sample"),
        ({"compression_RL": np.full(SAMPLES, 40.0)}, "compression_RL"),
        ({"a_u_RR": np.full(SAMPLES, np.inf)}, "a_u_RR"),
        # those of a log
        ({"a_u_RR": np.full(SAMPLES, 1.01 * LARGEST_WHEEL)}, "a_u_RR: .*beyond 2000 m"),
        ({"a_s_FR": np.full(SAMPLES, 1.01 * LARGEST_BODY)}, "a_s_FR: .*beyond 200 m"),
        ({"compression_FL": np.full(SAMPLES, 0.31)}, "compression_FL: .*beyond 0.3 m"),
        ({"compression_FR": np.full(SAMPLES, np.nan)}, "compression_FR"),
        (lost("a_s", "a_u"), "a_s_FL"),
    ],
)
def test_a_record_that_cannot_be_used_is_refused(change, field):
    with pytest.raises(InputError, match=field):
        wheel_loads(at_rest()._replace(**change), 1e-3, CAR)


def test_settings_that_cannot_be_used_are_refused():
    for dt in (0.0, 0.5, float("nan")):
        with pytest.raises(InputError, match="dt"):
            wheel_loads(at_rest(), dt, CAR)
    with pytest.raises(InputError, match="load_walks"):
        wheel_loads(at_rest(), 1e-3, CAR, JointLoadTuning(load_walks=()))
    with pytest.raises(InputError, match="compression"):
        wheel_loads(at_rest(), 1e-3, CAR, replace(FEW, compression=0.0))
    with pytest.raises(InputError, match="patch_tilt"):
        wheel_loads(at_rest(), 1e-3, CAR, replace(FEW, patch_tilt=-0.01))
