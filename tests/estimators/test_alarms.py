"""Low-pressure alarms over Gaussian beliefs whose errors an estimator would make."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.estimators.alarm_events import alarm_count, alarm_events, detection_times
from wheelhop.estimators.alarms import AlarmSettings, alarm_params, run_alarms
from wheelhop.estimators.pressure import StiffnessBelief
from wheelhop.vehicle.tire import Tire

TIRE = Tire(264.7e3, 250e3, 0.7)
PLACARD = 230e3
DT, WALK = 0.5, 0.008
AT_10_S = 0.022**2 * np.ones((4, 4)) + 0.0092**2 * np.eye(4)
BIAS = 0.02**2 * np.ones((4, 4)) + 0.005**2 * np.eye(4)
BEGIN = 200.0
T = DT * np.arange(1, 801)


def ln_law(pressure):
    return np.log(264.7e3 * (1.0 + 0.7 * (pressure - 250e3) / 250e3))


def beliefs(pressure, runs, seed, bias=True):
    """Means [runs, time, 4] and covariances of an estimator that assumes a random walk."""
    rng = np.random.default_rng(seed)
    noise = AT_10_S * 10.0 / DT
    root, spread = np.linalg.cholesky(noise), np.linalg.cholesky(BIAS)
    truth = ln_law(np.asarray(pressure))
    lasting = rng.standard_normal((runs, 4)) @ spread.T if bias else np.zeros((runs, 4))
    cov, mean = 0.09 * np.eye(4), np.full((runs, 4), ln_law(PLACARD))
    means, covs = [], []
    for now in truth:
        cov = cov + WALK**2 * DT * np.eye(4)
        gain = np.linalg.solve(cov + noise, cov).T
        cov = cov - gain @ cov
        measured = now + lasting + rng.standard_normal((runs, 4)) @ root.T
        mean = mean + (measured - mean) @ gain.T
        means.append(mean)
        covs.append(0.5 * (cov + cov.T))
    return np.stack(means, 1), np.stack(covs)


def course(wheels, loss, seconds=0.0, begin=BEGIN):
    """Pressures [time, 4] that lose a share of the placard from `begin` on."""
    share = np.clip((T - begin) / seconds, 0, 1) if seconds else (begin < T) * 1.0
    pressure = np.full((len(T), 4), PLACARD)
    pressure[:, wheels] *= 1.0 - loss * share[:, None]
    return pressure


PARAMS = {"wheels": 4, "dt": DT, "belief_walk": WALK, "bias": BIAS}
_many = jax.jit(jax.vmap(run_alarms, (StiffnessBelief(0, None), None)))
_one = jax.jit(run_alarms)


def run_many(means, covs, **options):
    params = alarm_params(TIRE, PLACARD, **(PARAMS | options))
    return jax.tree.map(np.asarray, _many(StiffnessBelief(means, covs), params))


def run_one(mean, cov, tire=TIRE, placard=PLACARD, **options):
    params = alarm_params(tire, placard, **(PARAMS | options))
    return jax.tree.map(np.asarray, _one(StiffnessBelief(mean, cov), params))


def exact(pressure):
    """A drive without errors, its covariance that of the settled estimator."""
    covs = beliefs(np.full((60, 4), PLACARD), 1, 0)[1]
    mean = ln_law(np.asarray(pressure))
    return mean, np.broadcast_to(covs[-1], (*mean.shape, 4))


def test_fewer_than_one_false_alarm_in_a_hundred_hours():
    # drives of 400 s, each with a lasting bias of its own; two wheels at once are one alarm
    seeds = (1, 11, 21, 31)
    alarms = [run_many(*beliefs(course([], 0.0), 450, seed=seed)).alarm for seed in seeds]
    hours = sum(a.shape[0] * a.shape[1] for a in alarms) * DT / 3600
    assert hours == 200
    assert sum(a.any(axis=(1, 2)).sum() for a in alarms) / hours < 1 / 100


@pytest.mark.parametrize(
    ("wheels", "loss", "share"),
    [([2], 0.15, 1.0), ([0, 3], 0.15, 0.99), ([0, 1, 3], 0.15, 0.97), ([0, 1, 2, 3], 0.2, 0.8)],
)
def test_losses_are_found_within_a_minute(wheels, loss, share):
    # four low tyres have no sound one to compare with: a common drift of 2 % limits them
    means, covs = beliefs(course(wheels, loss), 450, seed=2)
    alarm = run_many(means, covs).alarm
    found = detection_times(T, alarm, BEGIN)
    late = found[:, wheels].max(axis=1) > 60.0
    assert np.mean(~late) >= share
    others = np.delete(alarm, wheels, axis=2)
    assert others.any(axis=1).mean() < 0.02 if others.size else True


def test_pressure_and_loss_lie_within_their_stated_deviations():
    pressure = course([1], 0.2, 60.0)
    means, covs = beliefs(pressure, 450, seed=3)
    output = run_many(means, covs)
    for index in (200, -1):
        z = (output.pressure[:, index] - pressure[index]) / output.pressure_sd[:, index]
        # up to a common bias every wheel's error is its own: 450 drives, 4 wheels
        assert 0.6 < np.mean(z**2) < 1.15
        assert np.abs(z.mean()) < 0.2
    np.testing.assert_allclose(1.0 - output.pressure / PLACARD, output.loss, atol=1e-12)
    assert (output.exceedance[:, -1, 1, 0] > output.exceedance[:, -1, 1, 2]).all()


def test_a_tyre_pumped_up_accuses_no_other():
    output = run_one(*exact(course([0], -0.15)))
    assert not output.alarm.any()


def test_an_alarm_waits_and_stays_until_the_tyre_is_surely_sound():
    pressure = course([0], 0.25)
    pressure[480:, 0] = PLACARD
    mean, cov = exact(pressure)
    quick = run_one(mean, cov, settings=AlarmSettings(hold=0.0, clear_hold=0.0))
    slow = run_one(mean, cov, settings=AlarmSettings(hold=4.0, clear_hold=20.0))
    on, off = (np.flatnonzero(np.diff(a.alarm[:, 0].astype(int))) for a in (quick, slow))
    assert len(on) == len(off) == 2
    assert (off[0] - on[0]) * DT == pytest.approx(3.5)
    assert (off[1] - on[1]) * DT == pytest.approx(19.5)
    # what is raised above one bound is cleared below another
    assert quick.probability[on[0] + 1, 0] > AlarmSettings().probability
    assert quick.probability[on[1] + 1, 0] < 0.5
    assert (quick.probability[on[1] - 5 : on[1], 0] > 0.5).all()


def test_missing_beliefs_hold_the_alarms():
    mean, cov = (np.array(a) for a in exact(course([0], 0.2)))
    full = run_one(mean, cov)
    assert full.alarm[-1].tolist() == [True, False, False, False]
    mean[500:600], cov[500:600] = np.nan, np.nan
    mean[:300, 3] = np.nan
    output = run_one(mean, cov)
    assert not output.valid[500:600].any()
    assert output.valid[299].tolist() == [True, True, True, False]
    for held in (output.alarm, output.pressure, output.rate):
        assert (held[500:600] == held[499]).all()
    assert (np.diff(output.pressure_sd[500:600], axis=0) > 0).all()
    assert np.isfinite(output.pressure).all()
    assert not output.alarm[:400].any()
    assert (output.alarm[600:] == full.alarm[600:]).all()


def test_the_units_of_pressure_do_not_matter():
    mean, cov = beliefs(course([1], 0.2, 40.0), 1, seed=4)
    ours = run_one(mean[0], cov)
    params = alarm_params(TIRE, PLACARD, **PARAMS)
    tenfold = replace(
        params,
        reference=params.reference - np.log(1e3),
        placard=10 * params.placard,
        pressure_per_ln=10 * params.pressure_per_ln,
        puncture_rate=10 * params.puncture_rate,
    )
    theirs = _one(StiffnessBelief(mean[0] - np.log(1e3), cov), tenfold)
    assert (np.asarray(theirs.alarm) == ours.alarm).all()
    np.testing.assert_allclose(theirs.loss, ours.loss, atol=1e-9)
    np.testing.assert_allclose(theirs.puncture, ours.puncture, atol=1e-9)
    np.testing.assert_allclose(theirs.pressure, 10 * ours.pressure, rtol=1e-9)


def test_many_drives_equal_one_by_one():
    means, covs = beliefs(course([2], 0.15), 450, seed=5)
    together = run_many(means, covs)
    for run in (0, 449):
        alone = run_one(means[run], covs)
        assert (alone.alarm == together.alarm[run]).all()
        np.testing.assert_allclose(alone.pressure, together.pressure[run], rtol=1e-9)


def test_single_precision_finds_the_same():
    means, covs = beliefs(course([0, 1], 0.2, 30.0), 1, seed=6)
    double = run_one(means[0], covs)
    with jax.enable_x64(False):
        single = run_one(means[0].astype("f4"), covs.astype("f4"), bias=BIAS.astype("f4"))
    assert single.pressure.dtype == np.float32
    np.testing.assert_allclose(single.pressure, double.pressure, rtol=2e-4)
    np.testing.assert_allclose(single.pressure_sd, double.pressure_sd, rtol=2e-3)
    assert (single.alarm != double.alarm).sum() <= 2


def test_one_wheel_alone_is_judged_by_itself():
    mean, cov = exact(course([0], 0.25))
    params = alarm_params(TIRE, PLACARD, wheels=1, dt=DT, belief_walk=WALK)
    output = run_alarms(
        StiffnessBelief(jnp.asarray(mean[:, :1]), jnp.asarray(cov[:, :1, :1])), params
    )
    assert 0.0 < detection_times(T, np.asarray(output.alarm), BEGIN)[0] < 60.0


@pytest.mark.parametrize(
    ("begin", "seconds", "loss", "kind"),
    [
        (BEGIN, 40.0, 0.27, "puncture"),
        (BEGIN, 0.0, 0.27, "puncture"),
        (60.0, 1200.0, 0.5, "unclear"),
        (0.0, 0.0, 0.17, "slow leak"),
    ],
)
def test_events_say_which_wheel_when_and_how(begin, seconds, loss, kind):
    output = run_one(*exact(course([2], loss, seconds, begin)))
    (event,) = alarm_events(T, output)
    assert (event.wheel, event.index, event.kind) == ("RL", 2, kind)
    assert event.time > begin
    assert np.isnan(event.end)
    assert event.worst >= event.loss > 0.07
    assert event.level == max((x for x in (0.15, 0.20, 0.25) if x <= event.worst), default=0.0)
    assert "rear left" in event.words
    assert (kind if kind != "unclear" else "loss of pressure") in event.words
    assert f"{event.time:.0f} s" in event.words


def test_a_rate_is_followed():
    output = run_one(*exact(course([1], 0.3, 600.0, begin=60.0)))
    # the model expects a rate to fade, so it stays a little below a lasting one
    ratio = output.rate[-1] / (-0.3 * PLACARD / 600.0)
    assert 0.8 < ratio[1] < 1.05
    assert np.abs(ratio[[0, 2, 3]]).max() < 0.1


def test_counts_and_detection_times():
    alarm = np.zeros((2, 10, 2), bool)
    alarm[0, 4:6, 0] = alarm[0, 8:, 0] = alarm[1, 0:3, 1] = True
    t = np.arange(10.0)
    assert alarm_count(alarm) == 3
    assert detection_times(t, alarm, 2.0).tolist() == [[2.0, np.inf], [np.inf, 0.0]]


def test_what_cannot_be_judged_is_refused():
    for options, field in (
        ({"dt": 0.0}, "dt"),
        ({"belief_walk": 0.0}, "belief_walk"),
        ({"bias": np.eye(3)}, "bias"),
        ({"settings": AlarmSettings(probability=1.5)}, "probability"),
        ({"settings": AlarmSettings(clear_probability=0.99)}, "clear_probability"),
        ({"settings": AlarmSettings(test_level=15.0)}, "test_level"),
    ):
        with pytest.raises(InputError, match=field):
            alarm_params(TIRE, PLACARD, **(PARAMS | options))
    with pytest.raises(InputError, match="placard"):
        alarm_params(TIRE, 2.3, **PARAMS)
    output = run_one(*exact(course([], 0.0)))
    with pytest.raises(InputError, match="names"):
        alarm_events(T, output, ("left", "right"))
