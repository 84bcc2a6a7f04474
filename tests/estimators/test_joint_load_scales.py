"""Springs and dampers found from a_x and a_y: moments, scales, wrong struts, refusals."""

import warnings
from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from load_drive import (
    CAR,
    CHASSIS,
    SAMPLES,
    drive,
    least_squares_moments,
    nees,
    recorder,
    rms,
    sample_of,
)

from wheelhop.errors import DivergenceError, InputError, InputWarning
from wheelhop.estimators import joint_load
from wheelhop.estimators.joint_load import CHUNK, wheel_loads
from wheelhop.estimators.joint_load_checks import checked_horizontal
from wheelhop.estimators.joint_load_model import JointLoadBelief, shown_accelerations
from wheelhop.estimators.joint_load_params import JointLoadTuning, joint_load_params
from wheelhop.estimators.joint_load_scales import (
    Scales,
    scaled_load_model,
    scaled_load_prior,
    scales_of,
    tell_doubts,
)

MASS = float(CHASSIS.body_mass + CHASSIS.wheel_mass.sum())
ONE = JointLoadTuning(load_walks=(5e3,))


def told(turning=False):
    columns = drive(turning=turning).measured
    return columns["a_x"], columns["a_y"]


def found_with(spring=1.0, damper=1.0, horizontal=True, turning=False):
    """Loads of a drive without wheel accelerometers, the struts believed these times as stiff."""
    return _found_with(spring, damper, horizontal, turning)


@cache
def _found_with(spring, damper, horizontal, turning):
    strut, sample = CAR.strut, sample_of(drive(turning=turning).measured, wheel=False)
    other = replace(strut.damper, damping=damper * strut.damper.damping)
    car = replace(CAR, strut=replace(strut, stiffness=spring * strut.stiffness, damper=other))
    return wheel_loads(sample, 1e-3, car, ONE, horizontal=told(turning) if horizontal else None)


@pytest.mark.parametrize("turning", [False, True])
def test_a_x_and_a_y_tell_the_moments_that_the_struts_balance(turning):
    truth = drive(turning=turning).truth
    params = joint_load_params(CAR, 1e-3)
    params = replace(params, told=1.0, a_x=truth.a_x, a_y=truth.a_y)
    shown = truth.compression, truth.compression_rate, truth.load
    s, w, loads = (jnp.asarray(a.T) for a in shown)
    zero = jnp.zeros(SAMPLES)
    body, _ = shown_accelerations(s, w, JointLoadBelief(*s, *w, *loads, zero, zero, zero), params)
    roll, pitch = least_squares_moments(np.asarray(body).T, truth.strut)
    needed_roll, needed_pitch = least_squares_moments(truth.body_acceleration, truth.strut)
    # the tyres work against the air, which no accelerometer tells
    drag = 0.5 * 1.2 * float(CAR.drag_area) * truth.speed**2 * float(params.lever)
    off = pitch - drag - needed_pitch
    assert abs(off[100:450].mean()) < 150.0
    if turning:
        # left, then right; told 1.8 % off
        assert needed_roll.max() > 3e3
        assert needed_roll.min() < -2e3
        assert rms(roll - needed_roll) < 0.03 * rms(needed_roll)
    else:
        # nose down; 2.3 %, most of it ripple of the road
        assert needed_pitch[700:].mean() > 5e3
        assert rms(off[700:]) < 0.035 * rms(needed_pitch[700:])
        assert abs(off[1000:].mean()) < 50.0


def damper_by_hand(w):
    """Force of the car's dampers at compression speeds [4, samples], as its law is written."""
    law = CAR.strut.damper
    fading = 1.0 + np.asarray(law.digression)[:, None] * np.sqrt(w * w + 1e-6)
    uneven = 1.0 - np.asarray(law.asymmetry)[:, None] * np.tanh(w / np.asarray(law.knee)[:, None])
    return np.asarray(law.damping)[:, None] * w * uneven / fading


def test_scales_multiply_the_springs_and_dampers_of_the_model():
    draw = np.random.default_rng(3)
    s, w = 0.05 * draw.uniform(-1, 1, (4, 50)), draw.uniform(-1, 1, (4, 50))
    params, zero = joint_load_params(CAR, 1e-3), jnp.zeros(50)
    loads = jnp.asarray(5e3 + 1e3 * draw.uniform(-1, 1, (4, 50)))
    belief = JointLoadBelief(*s, *w, *loads, zero, zero, zero)
    places = jnp.asarray(s), jnp.asarray(w), belief
    plain = np.array(shown_accelerations(*places, params))
    # short of the stops these springs are linear
    strut = CAR.strut
    assert np.abs(s).max() < min(np.min(strut.bump_clearance), np.min(strut.rebound_clearance))
    assert not np.any(strut.cubic_stiffness)
    spring = np.asarray(strut.stiffness)[:, None] * s
    damper = damper_by_hand(w)
    x, y, m = (np.asarray(a)[:, None] for a in (params.x, params.y, CHASSIS.wheel_mass))
    for scale in ((1.0, 1.0), (2.0, 1.0), (1.0, 2.0), (0.5, 3.0)):
        more = (scale[0] - 1.0) * spring + (scale[1] - 1.0) * damper
        up = more.sum(0) / float(CHASSIS.body_mass)
        roll = (y * more).sum(0) / float(params.roll_inertia)
        pitch = -(x * more).sum(0) / float(params.pitch_inertia)
        gained = np.stack([up + roll * y - pitch * x, -more / m])
        shown = shown_accelerations(*places, params, tuple(jnp.asarray(one) for one in scale))
        np.testing.assert_allclose(np.array(shown) - plain, gained, rtol=1e-9, atol=1e-9)
        known = replace(params, scale=jnp.asarray(scale))
        np.testing.assert_allclose(shown_accelerations(*places, known), shown, rtol=1e-12)


@pytest.mark.parametrize(("spring", "turning"), [(1 / 1.5, False), (2.0, False), (2.0, True)])
def test_springs_that_are_not_what_is_believed_are_found(spring, turning):
    load, right = drive(turning=turning).truth.load, found_with(turning=turning)
    found, misled = (found_with(spring, 1.0, how, turning) for how in (True, False))
    # 1.3 % and 3.3 % at most, as with the right belief
    off = np.abs(found.scale * [spring, 1.0] - 1.0)
    assert np.all(off < np.minimum([0.03, 0.06], 2.0 * found.scale_sigma * [spring, 1.0]))
    # 2 N at most, sigma 400 N: what was believed no longer matters; it did by 300 N and more
    assert rms((found.load - right.load)[300:]) < 6.0
    assert rms((misled.load - right.load)[300:]) > 150.0
    # the transfer, which slowly changing errors spoil: 0.05 to 0.26 of what is off without
    after, before = (rms((f.load - load)[1000:].mean(0)) for f in (found, misled))
    assert after < (0.4 if turning else 0.25) * before
    assert np.mean(np.abs(found.load - load)[300:] < 2 * found.sigma[300:]) > 0.9


def test_dampers_half_as_strong_as_believed_are_found():
    found, misled = (found_with(1.0, 2.0, how) for how in (True, False))
    # 3.7 % and 3.0 %
    assert np.all(np.abs(found.scale * [1.0, 2.0] - 1.0) < 0.06)
    # 4 N
    assert rms((found.load - found_with().load)[300:]) < 10.0
    assert rms((misled.load - found_with().load)[300:]) > 100.0


def test_on_its_own_model_the_scales_are_found():
    # what would be added for the doubt of the model is not in the record
    none = dict.fromkeys(("patch_tilt", "tilt_per_walk", "spring_doubt", "damper_doubt"), 0.0)
    exact = JointLoadTuning(load_walks=(1e3,), **none)
    params = joint_load_params(CAR, 1e-3, exact, *exact.load_walks)
    stiffer = {"ln_spring": jnp.log(1.4), "ln_damper": jnp.log(0.8)}
    start = scaled_load_prior(params).mean._replace(**stiffer)
    t = 1e-3 * np.arange(SAMPLES)
    a_x = -2.5 * (np.tanh((t - 0.4) / 0.05) - np.tanh((t - 1.2) / 0.05))
    # the loads of a car that brakes: 3 N in a step of their walk of 32 N
    transfer = -MASS * a_x * float(params.lever) / (2 * float(CHASSIS.front_arm + CHASSIS.rear_arm))
    gain = np.zeros((SAMPLES, len(start)))
    gain[1:, 8:12] = np.diff(transfer)[:, None] * np.array([1, 1, -1, -1])
    sample, state = recorder(scaled_load_model(), params, start)(0, gain, (a_x, 0.0 * a_x))
    noise = 0.05 * np.random.default_rng(0).standard_normal((2, SAMPLES))
    found = wheel_loads(sample, 1e-3, CAR, exact, horizontal=(a_x + noise[0], noise[1]))
    # 0.9 and 0.5 of sigma; over 24 seeds 2.8 at most
    sigma = found.scale_sigma / found.scale
    assert np.all(np.abs(np.log(found.scale) - state[-1, 15:]) < 4.0 * sigma)
    assert np.all(sigma < 0.03)
    # 4.0, and 3.8 to 5.3 over 24 seeds
    assert 3.0 < nees(found, state[:, 8:12])[100:].mean() < 6.0
    # of the filter that no moments are told
    assert 11.0 < found.nis[100:].mean() < 13.0


def test_the_member_that_foretells_the_record_says_the_scales():
    last, variance = np.log([[1.5, 0.8], [1.2, 1.1], [9.0, 9.0]]), np.full((3, 2), 1e-4)
    last[2, 0] = np.nan
    found = scales_of(last, variance, np.array([-500.0, -500.0 + np.log(3.0), 0.0]), (0.03, 0.2))
    apart = 0.25 * 0.75 * (last[0] - last[1]) ** 2
    np.testing.assert_allclose(found.value, np.exp(0.25 * last[0] + 0.75 * last[1]))
    np.testing.assert_allclose(found.ln_sigma, np.sqrt(1e-4 + apart + np.array([0.03**2, 0.2**2])))
    with pytest.raises(DivergenceError, match="springs"):
        scales_of(last[2:], variance[2:], np.zeros(1), (0.03, 0.2))
    for k, name in enumerate(("springs", "dampers")):
        far = np.ones(2)
        far[k] = 0.2
        with pytest.warns(InputWarning, match=f"{name} seem 0.2 times"):
            tell_doubts(Scales(far, 0.1 * far), 1.0)
    with pytest.warns(InputWarning, match="a_x and a_y do not fit"):
        tell_doubts(found, 2.5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tell_doubts(found, 1.3)


def test_a_doubt_of_the_scales_is_in_the_loads_and_in_the_mass():
    sure = replace(ONE, spring_doubt=0.0, damper_doubt=0.0)
    sample = sample_of(drive().measured, wheel=False)
    without, found = wheel_loads(sample, 1e-3, CAR, sure, horizontal=told()), found_with()
    np.testing.assert_allclose(found.load, without.load, rtol=1e-9)
    strut, s = CAR.strut, drive().truth.compression
    spring = found.scale[0] * np.asarray(strut.stiffness) * s
    damper = found.scale[1] * damper_by_hand(found.compression_rate.T).T
    expected = np.einsum("ti,tj->tij", 0.03 * spring, 0.03 * spring)
    expected += np.einsum("ti,tj->tij", 0.1 * damper, 0.1 * damper)
    added = found.covariance - without.covariance
    # 10 to 100 N, apart by what the compression is not known to
    deviation = np.sqrt(np.einsum("tii->ti", expected))
    assert deviation[1000:].mean() > 20.0
    off = np.sqrt(np.einsum("tii->ti", added)) - deviation
    assert rms(off[300:]) < 0.1 * rms(deviation[300:])
    np.testing.assert_allclose(
        added.sum((1, 2))[300:], expected.sum((1, 2))[300:], rtol=0.2, atol=900.0
    )
    assert np.all(found.body_mass_sigma > without.body_mass_sigma)


def test_the_moments_of_a_drive_are_those_of_the_tyres_horizontal_forces():
    truth, found, without = drive().truth, found_with(), found_with(horizontal=False)
    assert (without.scale, without.scale_sigma) == (None, None)
    assert found.scale.shape == found.scale_sigma.shape == (2,)
    # 2.8 %; m a_x is another 6 % more, the part of the weight that the dive turns forward
    force = -found.pitch_moment[700:].mean() / float(joint_load_params(CAR, 1e-3).lever)
    assert abs(force / truth.longitudinal.sum(1)[700:].mean() - 1.0) < 0.05


def test_gaps_of_a_x_and_a_y_are_bridged():
    line = np.linspace(-3.0, 2.0, 11)
    broken = np.where(np.isin(np.arange(11), (3, 4, 8)), np.nan, line)
    np.testing.assert_allclose(checked_horizontal("a_x", broken, 11, 0.01), line, atol=1e-12)
    a_x, a_y = (signal.copy() for signal in told())
    a_x[600:605] = a_x[1100:1108] = a_x[-4:] = a_y[:3] = np.nan
    sample, so_far = sample_of(drive().measured, wheel=False), []
    found = wheel_loads(
        sample, 1e-3, CAR, ONE, on_progress=lambda *now: so_far.append(now), horizontal=(a_x, a_y)
    )
    assert so_far == [(k * CHUNK, 2 * SAMPLES) for k in range(1, 7)]
    # 0.25 N and 1.4e-4
    np.testing.assert_allclose(found.load, found_with().load, atol=2.0)
    np.testing.assert_allclose(found.scale, found_with().scale, atol=1e-3)


@pytest.mark.parametrize("name", ["a_x", "a_y"])
@pytest.mark.parametrize(
    ("signal", "problem"),
    [
        (np.zeros(SAMPLES - 1), "shape"),
        (np.where(np.arange(SAMPLES) // 200 == 3, np.nan, 0.0), "missing for 0.2 s from 0.6 s on"),
        (np.where(np.arange(SAMPLES) < 150, np.nan, 0.0), "missing for 0.15 s from 0 s on"),
        (np.full(SAMPLES, np.nan), "it has no sample"),
        (np.where(np.arange(SAMPLES) == 9, np.inf, 0.0), "it reaches inf"),
        (np.linspace(0.0, -30.1, SAMPLES), "beyond 30 m/s"),
    ],
)
def test_a_x_and_a_y_that_cannot_be_used_are_refused(monkeypatch, name, signal, problem):
    # nothing is filtered
    monkeypatch.setattr(joint_load, "run_in_chunks", None)
    given = tuple(signal if name == one else np.zeros(SAMPLES) for one in ("a_x", "a_y"))
    with pytest.raises(InputError, match=f"^{name}: .*{problem}"):
        wheel_loads(sample_of(drive().measured), 1e-3, CAR, ONE, horizontal=given)


@pytest.mark.slow
def test_in_single_precision(float32):
    del float32
    car = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), CAR)
    with jax.enable_x64(True):
        double, sample = found_with(), sample_of(drive().measured, wheel=False)
    found = wheel_loads(sample, 1e-3, car, ONE, horizontal=told())
    # 0.11 N, 26 N at one sample, 2e-6
    assert rms(found.load - double.load) < 1.0
    np.testing.assert_allclose(found.load, double.load, atol=60.0)
    np.testing.assert_allclose(found.scale, double.scale, rtol=1e-4)
