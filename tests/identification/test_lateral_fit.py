"""Tyre coefficients from records of cornering that SciPy integrated, of a model in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from wheelhop.errors import InputError, InputWarning
from wheelhop.estimators.lateral import LateralSample
from wheelhop.identification.lateral import _parameters, _task, fit_tires
from wheelhop.identification.lateral_loss import Own, loss
from wheelhop.identification.lateral_records import LateralNoise, cornering
from wheelhop.identification.lateral_step import compiled_advance, first
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE, ArctangentTire
from wheelhop.vehicle.two_track import SOLMAZ_CAR, Wheels

M, J, LV, LH, T, H, G = 1300.0, 1200.0, 1.2, 1.3, 1.5, 0.7, 9.80665
L, V, DT = LV + LH, 120 / 3.6, 0.01
TIME = np.arange(600) * DT
NOISE = LateralNoise(0.05, 0.002)
NOMINAL, SOFT = (1.0, 5650.0, 15.0), (1.0, 4500.0, 12.0)


def steer(t, amplitude):
    """Two lane changes, there and back."""
    there, back = (t - 0.2) / 2.5, (t - 3.2) / 2.5
    first = np.where((there > 0) & (there < 1), np.sin(2 * np.pi * there), 0.0)
    return amplitude * (first - np.where((back > 0) & (back < 1), np.sin(2 * np.pi * back), 0.0))


def arctangent(tires):
    def forces(slips, loads):
        each = zip(slips, loads, tires, strict=True)
        return [(k1 - f / k2) * f * np.arctan(k3 * a) for a, f, (k1, k2, k3) in each]

    return forces


def magic(slips, loads):
    """Pacejka's formula of 1987: BCD = a_3 sin(2 atan(F_z / a_4))."""
    c, peak, e = 1.3, 1.05, -0.5
    total = []
    for a, f in zip(slips, loads, strict=True):
        d = peak * f
        b = 6.0e4 * np.sin(2 * np.arctan(f / 5000.0)) / (c * d)
        total.append(d * np.sin(c * np.arctan(b * a - e * (b * a - np.arctan(b * a)))))
    return total


def truth(forces, amplitude):
    """A record without noise; loads by Eq. 7 of the model's own lateral acceleration."""

    def motion(x, t):
        beta, r = x
        d = float(steer(t, amplitude))
        both = d * d * T / 2 / L
        speeds = V - T / 2 * r, V + T / 2 * r
        front = [np.arctan((V * beta + LV * r) / s) for s in speeds]
        rear = [np.arctan((V * beta - LH * r) / s) for s in speeds]
        slips = [d + both - front[0], d - both - front[1], -rear[0], -rear[1]]
        a = 0.0
        for _ in range(60):
            shift_f, shift_r = M * LH * H / L / T * a, M * LV * H / L / T * a
            f, r_ = M * LH * G / 2 / L, M * LV * G / 2 / L
            s = forces(slips, [f - shift_f, f + shift_f, r_ - shift_r, r_ + shift_r])
            last, a = a, sum(s) / M
            if abs(a - last) < 1e-12:
                break
        return a / V - r, ((s[0] + s[1]) * LV - (s[2] + s[3]) * LH) / J, a

    span = (TIME[0], TIME[-1])
    found = solve_ivp(
        lambda t, x: motion(x, t)[:2],
        span,
        (0.0, 0.0),
        t_eval=TIME,
        rtol=1e-8,
        atol=1e-10,
        max_step=0.05,
    )
    a = np.array([motion(x, t)[2] for x, t in zip(found.y.T, TIME, strict=True)])
    return LateralSample(steer(TIME, amplitude), np.full(len(TIME), V), a, found.y[1])


def noisy(record, seed, noise=NOISE):
    rng = np.random.default_rng(seed)
    return LateralSample(
        steer=record.steer.copy(),
        speed=record.speed.copy(),
        lateral_acceleration=record.lateral_acceleration + noise[0] * rng.normal(size=len(TIME)),
        yaw_rate=record.yaw_rate + noise[1] * rng.normal(size=len(TIME)),
    )


def fitted(records, **options):
    return fit_tires(records, SOLMAZ_CAR, DT, **{"starts": 2, "noise": NOISE} | options)


@pytest.fixture(scope="module")
def sound():
    return truth(arctangent([NOMINAL] * 4), 0.02)


@pytest.mark.parametrize(("start", "found"), [(SOFT_TIRE, NOMINAL), (NOMINAL_TIRE, SOFT)])
def test_records_without_noise_give_the_papers_coefficients(sound, start, found):
    record = sound if found == NOMINAL else truth(arctangent([SOFT] * 4), 0.02)
    seen = []
    fit = fitted(record, start=start, on_progress=lambda *told: seen.append(told))
    np.testing.assert_allclose(fit.values, found[1:], rtol=1e-3)
    assert fit.names == ("k2", "k3")
    assert fit.tires.rear_left.k1 == 1.0
    stiffness = (1 - M * LH * G / 2 / L / found[1]) * M * LH * G / 2 / L * found[2]
    np.testing.assert_allclose(fit.cornering_stiffness[0], stiffness, rtol=1e-3)
    assert fit.problems == ()
    assert fit.loss < 0.01
    assert seen[-1][0] == len(seen) == fit.iterations
    np.testing.assert_allclose(seen[-1][2], fit.loss, rtol=1e-3)


def test_noisy_records_give_them_within_the_stated_uncertainty(sound):
    """The squared error in units of its covariance is chi square over many seeds."""
    seeds, squares = 20, []
    for seed in range(seeds):
        fit = fitted(noisy(sound, seed))
        error = np.log(fit.values / NOMINAL[1:])
        squares.append(error @ np.linalg.solve(fit.covariance, error))
    low, high = chi2.ppf([0.001, 0.999], 2 * seeds)
    assert low < sum(squares) < high
    # white errors: blocks of time say the same as samples
    ratio = fit.uncertainty.robust_errors / fit.uncertainty.standard_errors
    assert (np.abs(np.log(ratio)) < np.log(2.5)).all()
    np.testing.assert_allclose(fit.rms[0], NOISE, rtol=0.1)
    assert abs(fit.loss - 1.0) < 0.1


def test_the_gradient_agrees_with_central_differences_both_ways(sound):
    record = noisy(sound, 0)
    record.yaw_rate[100:140] = np.nan
    _, assigned = _parameters(("k2", "k3"), "one")
    ready = cornering(record, DT, NOISE, "measured")
    own = Own(0.1, 0.5, 0.2, 0.01, 0.005)
    task = _task(ready, Wheels(*[NOMINAL_TIRE] * 4), assigned, NOISE, own, SOLMAZ_CAR)
    x = jnp.array([0.1, -0.05, 0.02, 0.03, 0.5, -0.4, 0.3])
    both = jax.jit(jax.value_and_grad(lambda x: loss(x[:2], x[None, 2:], task, "measured")))
    value, backward = both(x)
    step = 1e-5
    moved = [[both(x.at[k].add(side * step))[0] for side in (1, -1)] for k in range(7)]
    central = np.diff(np.array(moved)[:, ::-1], axis=1)[:, 0] / (2 * step)
    np.testing.assert_allclose(backward, central, rtol=1e-6)
    state = first(x[:2], task, ready.blocks)._replace(trial=(x[:2], x[None, 2:]))
    state = jax.tree.map(lambda a: jnp.stack([a, a]), state)
    judged = jax.tree.map(lambda a: a[0], compiled_advance("measured")(state, task))
    forward = 2 * (judged.sums.scores.sum((0, 1)) + x)
    np.testing.assert_allclose(forward, backward, rtol=1e-9)
    np.testing.assert_allclose(judged.loss, value, rtol=1e-12)


def test_missing_samples_and_offsets_do_not_move_the_fit(sound):
    record = noisy(sound, 3)
    record.lateral_acceleration[50:200] = np.nan
    record.steer[200:210] = np.nan
    shifted = record._replace(
        steer=record.steer - 0.004,
        lateral_acceleration=record.lateral_acceleration + 0.2,
        yaw_rate=record.yaw_rate + 0.01,
    )
    fit = fitted(shifted, own=Own(0.1, 0.5, 0.3, 0.02, 0.01))
    error = np.log(fit.values / NOMINAL[1:])
    assert error @ np.linalg.solve(fit.covariance, error) < chi2.ppf(0.999, 2)
    np.testing.assert_allclose(fit.own.acceleration_offset, 0.2, atol=0.02)
    np.testing.assert_allclose(fit.own.yaw_rate_offset, 0.01, atol=1e-3)
    np.testing.assert_allclose(fit.own.steer_offset, -0.004, atol=3e-4)
    with pytest.warns(InputWarning, match="times the stated noise"):
        ignored = fitted(shifted)
    assert np.abs(np.log(ignored.values / NOMINAL[1:])).max() > 10 * np.abs(error).max()


def test_a_magic_formula_tyre_gives_the_nearest_arctangent():
    """No other coefficients within a few per cent leave smaller errors."""
    record = truth(magic, 0.012)
    with pytest.warns(InputWarning, match="robust"):
        fit = fitted(record, noise=LateralNoise(1e-3, 4e-5))
    assert (fit.rms < 0.1 * fit.measured_rms).all()
    assert (fit.rms < fit.start_rms).all()
    for k in (0, 1):
        for factor in (0.97, 1.03):
            moved = fit.values * np.where(np.arange(2) == k, factor, 1.0)
            other = truth(arctangent([(1.0, *moved)] * 4), 0.012)
            e = np.array([other[c] - record[c] for c in (2, 3)]) / [[1e-3], [4e-5]]
            assert np.sqrt(np.mean(e * e)) > fit.loss


def test_axles_of_their_own_are_told_apart_and_mild_cornering_is_confessed():
    front, rear = (1.0, 5000.0, 13.0), (1.0, 5800.0, 15.5)
    record = truth(arctangent([front, front, rear, rear]), 0.02)
    fit = fitted(noisy(record, 1), layout="axles")
    assert fit.names == ("front.k2", "front.k3", "rear.k2", "rear.k3")
    expected = np.array([*front[1:], *rear[1:]])
    error = np.log(fit.values / expected)
    assert error @ np.linalg.solve(fit.covariance, error) < chi2.ppf(0.999, 4)
    mild = truth(arctangent([NOMINAL] * 4), 0.002)
    with pytest.warns(InputWarning, match="hardly determine"):
        weak = fitted(noisy(mild, 2), layout="axles")
    # what they still tell is the cornering stiffness
    load = np.repeat([M * LH * G / 2 / L, M * LV * G / 2 / L], 2)
    stiffness = (1 - load / 5650) * load * 15
    assert (np.abs(weak.cornering_stiffness - stiffness) < 4 * weak.stiffness_errors).all()
    assert (weak.stiffness_errors < 0.05 * stiffness).all()


def test_records_that_cannot_be_used_are_refused_by_name(sound):
    def refused(record, match, **options):
        with pytest.raises(InputError, match=match):
            fitted(record, **options)

    def broken(**entries):
        return sound._replace(**entries)

    flat = np.zeros(len(TIME))
    gap = sound.steer.copy()
    gap[300:330] = np.nan
    refused([], "there are none")
    refused(LateralSample(*(entry[:100] for entry in sound)), "too short")
    refused(broken(steer=flat), "steer: no cornering")
    refused(broken(lateral_acceleration=flat, yaw_rate=flat), "no cornering: lateral acceleration")
    refused(broken(speed=flat), "falls to 0 m/s")
    refused(broken(steer=np.degrees(sound.steer) * 16), "Give it in rad")
    refused(broken(steer=gap), "a gap of 0.3 s")
    refused(broken(yaw_rate=flat[:-1]), "shapes")
    refused(broken(yaw_rate=flat + np.nan, lateral_acceleration=flat + np.nan), "neither")
    hole = sound.lateral_acceleration.copy()
    hole[100:200] = np.nan
    refused(broken(lateral_acceleration=hole), "loads='model'", loads="measured")
    refused(sound, "loads", loads="both")
    refused(sound, "layout", layout="sides")
    refused(sound, "free", free=("k4",))
    refused(sound, "starts", starts=0)
    refused(sound, "static load", start=ArctangentTire(1.0, 3000.0, 15.0))
    refused(sound, "own.steer_offset", own=Own(steer_offset=-1.0))


def test_loads_of_the_measured_acceleration_agree(sound):
    fit = fitted(sound, loads="measured")
    np.testing.assert_allclose(fit.values, NOMINAL[1:], rtol=1e-3)
    assert fit.problems == ()


def test_records_of_unequal_length_are_filled_up_with_what_does_not_count(sound):
    record = noisy(sound, 4)
    record.speed[10:12] = np.nan
    ready = cornering([record, LateralSample(*(a[:333] for a in sound))], DT, NOISE, "model")
    assert ready.drive.steer.shape == (2, 600)
    assert (ready.blocks, ready.interval[0], ready.interval[1]) == (6, 0.0, DT)
    np.testing.assert_array_equal(ready.counted.sum(1), [[598, 598], [333, 333]])
    np.testing.assert_allclose(ready.drive.speed, V)
    np.testing.assert_array_equal(ready.drive.yaw_rate[1, :333], sound.yaw_rate[:333])
