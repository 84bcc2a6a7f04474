"""Robust updates: their Gaussian limits, their optima, their densities, and what they save."""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, R, Sensors, Track, linear_model, sample
from scipy.optimize import minimize
from scipy.stats import binom, chi2, multivariate_t

from wheelhop.filtering import drive, extended, gaussian, smallmat, unscented
from wheelhop.filtering.linearisation import linearise
from wheelhop.filtering.robust import gated, huber, student_t
from wheelhop.filtering.update import condition

UPDATES = {
    "gated": gated(),
    "gated entrywise": gated(entrywise=True),
    "student": student_t(),
    "huber": huber(),
}
LIMITS = {
    "gated": gated(1 - 1e-15),
    "gated entrywise": gated(1 - 1e-15, entrywise=True),
    "student": student_t(1e14),
    "huber": huber(float("inf")),
}
CONVERGED = {"student": student_t(iterations=40), "huber": huber(iterations=30)}
RUNS, STEPS = 200, 60


def prior():
    return gaussian(Track(*MEAN.tolist()), jnp.array(COV.tolist()))


def measurements(ys):
    return Sensors(jnp.asarray(ys[..., 0]), jnp.asarray(ys[..., 1]))


@lru_cache
def compiled(update):
    filter = extended(linear_model(), measurement_update=update)
    return jax.jit(lambda belief, ys, params: drive.run(filter, belief, measurements(ys), params))


def run(update, ys, params=1.0):
    return compiled(update)(prior(), ys, params)


@lru_cache
def compiled_update(update):
    def one(y, scale):
        belief = prior()
        factor, _ = smallmat.cholesky(belief.cov)
        moments = linearise(lambda x: linear_model().observation(x, 1.0), belief.mean, factor)
        return update(belief, factor, moments, linear_model().observation_cov(scale), y, False)

    return jax.jit(one)


def one_update(update, y):
    """The update alone, of the prior by both sensors of the linear model."""
    return compiled_update(update)(Sensors(*(jnp.asarray(v, float) for v in y)), 1.0)


def contaminated(share, runs=RUNS):
    """Records where a share of the samples carries errors of 30 standard deviations."""
    rng = np.random.default_rng(11)
    xs, ys = zip(*(sample(500 + k, STEPS) for k in range(runs)), strict=True)
    bad = rng.random((runs, STEPS)) < share
    wild = 30 * np.sqrt(np.diag(R)) * rng.normal(size=(runs, STEPS, 2))
    return np.array(xs), np.array(ys) + wild * bad[..., None], bad


@jax.jit
def _means(ys):
    both = UPDATES | {"plain": condition}
    return {name: jax.vmap(lambda y, u=u: run(u, y).state.mean)(ys) for name, u in both.items()}


@jax.jit
def _plain_means(ys):
    return jax.vmap(lambda y: run(condition, y).state.mean)(ys)


def rms(mean, xs):
    return float(np.sqrt(np.mean((np.stack(tuple(mean), -1) - xs)[..., :2] ** 2)))


@pytest.mark.parametrize("name", LIMITS)
def test_limit_of_no_outliers_is_the_plain_update(name):
    _, ys = sample(0, 20)
    ys[3, 0] = ys[7] = np.nan
    ys[12] += 3.0
    robust, plain = run(LIMITS[name], ys), run(condition, ys)
    for a, b in zip(jax.tree.leaves(robust), jax.tree.leaves(plain), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-10)


@pytest.mark.parametrize("name", UPDATES)
def test_reports_what_was_seen(name):
    """Innovation, covariance and NIS are those of the plain update, outlier or not."""
    for y in [(0.5, -0.3), (80.0, 2.0), (np.nan, 50.0)]:
        _, info = one_update(UPDATES[name], y)
        _, plain = one_update(condition, y)
        for a, b in zip(jax.tree.leaves(info[:2]), jax.tree.leaves(plain[:2]), strict=True):
            np.testing.assert_array_equal(a, b)
        assert float(info.nis) == float(plain.nis)
        assert int(info.flags.missing) == int(plain.flags.missing)


def test_gate_takes_out_the_sample_or_the_entry_alone():
    y = (60.0, -0.3)
    belief, info = one_update(UPDATES["gated"], y)
    without, _ = one_update(condition, (np.nan, np.nan))
    assert int(info.flags.rejected) == 2
    np.testing.assert_array_equal(jax.tree.leaves(belief), jax.tree.leaves(without))
    belief, info = one_update(UPDATES["gated entrywise"], y)
    without, _ = one_update(condition, (np.nan, -0.3))
    assert int(info.flags.rejected) == 1
    np.testing.assert_array_equal(jax.tree.leaves(belief), jax.tree.leaves(without))


def test_gate_knows_how_many_entries_are_present():
    """A NIS of 12.5 passes the gate of two entries, and not that of one."""
    _, plain = one_update(condition, (np.nan, 1.0))
    deviation = np.sqrt(12.5 * float(plain.innovation_cov[1][1]))
    expected = 1.0 - float(plain.innovation.b)
    _, info = one_update(UPDATES["gated"], (np.nan, expected + deviation))
    assert chi2.isf(0.001, 1) < 12.5 < chi2.isf(0.001, 2)
    assert int(info.flags.rejected) == 1
    assert int(info.flags.missing) == 1
    _, info = one_update(gated(threshold=13.0), (np.nan, expected + deviation))
    assert int(info.flags.rejected) == 0


@pytest.mark.parametrize("entrywise", [False, True])
def test_gate_rejects_the_stated_share_of_clean_data(entrywise):
    probability = 0.99
    _, ys, _ = contaminated(0.0)
    flags = jax.vmap(lambda y: run(gated(probability, entrywise=entrywise), y).info.flags)(
        jnp.asarray(ys)
    )
    tests = RUNS * STEPS * (2 if entrywise else 1)
    rejected = int(np.sum(flags.rejected)) // (1 if entrywise else 2)
    low, high = binom.ppf([1e-4, 1 - 1e-4], tests, 1 - probability)
    assert low <= rejected <= high


@pytest.mark.parametrize("y", [(0.2, -0.4), (9.0, 1.0), (-40.0, 70.0)])
def test_huber_is_the_optimum_of_its_convex_cost(y):
    threshold = 1.345
    h = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, -1.0]])
    whitening = np.linalg.inv(np.linalg.cholesky(R))

    def cost(x):
        z = whitening @ (np.array(y) - h @ x)
        force = np.clip(z, -threshold, threshold)
        pull = np.linalg.solve(COV, x - MEAN)
        value = 0.5 * (x - MEAN) @ pull + force @ (z - force / 2)
        return value, pull - (whitening @ h).T @ force

    best = minimize(cost, MEAN, jac=True, method="BFGS", options={"gtol": 1e-11}).x
    belief, _ = one_update(CONVERGED["huber"], y)
    np.testing.assert_allclose(np.stack(tuple(belief.mean)), best, atol=1e-8)
    default, _ = one_update(UPDATES["huber"], y)
    np.testing.assert_allclose(np.stack(tuple(default.mean)), best, atol=2e-3)


@pytest.mark.parametrize("y", [(0.2, -0.4), (5.0, 1.0), (-40.0, 70.0), (np.nan, 9.0)])
def test_student_reaches_the_fixed_point_of_its_equations(y):
    """The variational equations, written with inverses, solved by plain repetition."""
    dof = 4.0
    here = np.isfinite(y)
    h = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, -1.0]])[here]
    r, measured = R[np.ix_(here, here)], np.array(y)[here]
    weight = 1.0
    for _ in range(2000):
        cov = np.linalg.inv(np.linalg.inv(COV) + weight * h.T @ np.linalg.solve(r, h))
        mean = cov @ (np.linalg.solve(COV, MEAN) + weight * h.T @ np.linalg.solve(r, measured))
        residual = measured - h @ mean
        e = np.trace(np.linalg.solve(r, np.outer(residual, residual) + h @ cov @ h.T))
        weight = (dof + here.sum()) / (dof + e)
    belief, _ = one_update(CONVERGED["student"], y)
    np.testing.assert_allclose(np.stack(tuple(belief.mean)), mean, atol=1e-9)
    np.testing.assert_allclose(smallmat.to_dense(belief.cov), cov, atol=1e-9)
    default, _ = one_update(UPDATES["student"], y)
    np.testing.assert_allclose(np.stack(tuple(default.mean)), mean, atol=0.03)


def test_student_likelihood_is_the_density_of_scipy():
    for y in [(0.2, -0.4), (30.0, 4.0)]:
        _, info = one_update(UPDATES["student"], y)
        s = np.asarray(smallmat.to_dense(info.innovation_cov))
        expected = multivariate_t.logpdf(np.array(tuple(info.innovation)), shape=s, df=4.0)
        assert float(info.log_likelihood) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", UPDATES)
def test_likelihood_is_a_normalised_density(name):
    """One entry missing: integrate over the other, far into both tails."""
    _, info = one_update(condition, (np.nan, 0.0))
    deviation = float(jnp.sqrt(info.innovation_cov[1][1]))
    edge = {"gated": gated, "gated entrywise": gated}.get(name)
    border = np.sqrt(chi2.isf(0.001, 1)) if edge else 1.0

    def density(white):
        y = jnp.asarray(white) * deviation - info.innovation.b
        log = jax.vmap(lambda b: one_update(UPDATES[name], (np.nan, b))[1].log_likelihood)(y)
        return np.exp(np.asarray(log)) * deviation

    nodes, weights = np.polynomial.legendre.leggauss(200)
    inner = 0.5 * border * (nodes + 1)
    total = 0.0
    for sign in (-1, 1):
        total += 0.5 * border * weights @ density(sign * inner)
        # outside, white = border exp(t), so that a power-law tail decays
        span = 30.0
        t = 0.5 * span * (nodes + 1)
        outer = border * np.exp(t)
        total += 0.5 * span * weights @ (outer * density(sign * outer))
    assert total == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("name", UPDATES)
def test_shrinking_the_noise_to_reject_everything_is_not_rewarded(name):
    _, ys, _ = contaminated(0.05, runs=4)

    @jax.jit
    def total(scale):
        one = jax.vmap(lambda y: run(UPDATES[name], y, scale).info.log_likelihood)
        return jnp.sum(one(jnp.asarray(ys)))

    values = [float(total(s)) for s in (1e-6, 1e-4, 1e-2, 1.0)]
    assert values == sorted(values)


def test_outliers_cost_little_and_their_absence_less():
    xs, ys, bad = contaminated(0.1)
    known = np.where(bad[..., None], np.nan, ys)
    found = {k: rms(v, xs) for k, v in _means(jnp.asarray(ys)).items()}
    best = rms(_plain_means(jnp.asarray(known)), xs)
    assert found["plain"] > 5.0 * best
    assert found["gated"] < 1.05 * best
    assert found["student"] < 1.05 * best
    assert found["gated entrywise"] < 1.2 * best
    assert found["huber"] < 1.2 * best

    xs, ys, _ = contaminated(0.0)
    found = {k: rms(v, xs) for k, v in _means(jnp.asarray(ys)).items()}
    for name in UPDATES:
        assert found[name] < 1.03 * found["plain"]


@pytest.mark.parametrize("name", UPDATES)
def test_gradient_equals_finite_differences(name):
    @jax.jit
    @jax.value_and_grad
    def total(knobs, y):
        filled = (jnp.where(jnp.isfinite(v), jnp.nan_to_num(v) + knobs[0], jnp.nan) for v in y)
        belief, info = compiled_update(UPDATES[name])(Sensors(*filled), knobs[1])
        return info.log_likelihood + belief.mean.bias + 2.0 * belief.cov[2][1]

    at = jnp.array([0.1, 1.3])
    for y in [(0.5, -0.3), (np.nan, 1.2), (25.0, 0.4), (-30.0, 60.0), (np.nan, np.nan)]:
        slope = total(at, jnp.array(y))[1]
        for k, step in enumerate(1e-5 * np.eye(2)):
            up, down = (total(at + sign * step, jnp.array(y))[0] for sign in (1, -1))
            assert float(slope[k]) == pytest.approx(float(up - down) / 2e-5, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", UPDATES)
def test_lanes_equal_single_runs_and_covariances_stay_positive(name):
    _, ys, _ = contaminated(0.1, runs=3)
    alone = [run(UPDATES[name], y) for y in ys]
    belief = jax.tree.map(lambda a: jnp.full(3, a), prior())
    lanes = compiled(UPDATES[name])(belief, np.swapaxes(ys, 0, 1), 1.0)
    for k in range(3):
        one = jax.tree.map(lambda a, k=k: a[:, k], lanes)
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(alone[k]), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-11)
    cov = np.asarray(smallmat.to_dense(lanes.state.cov))
    assert np.linalg.eigvalsh(cov).min() > 0


@pytest.mark.parametrize("name", UPDATES)
def test_absurd_readings_in_float32(name, float32):
    _, ys = sample(6, 10)
    ys[4] = [3e37, 1.0]
    ys[5] = [-1e25, 1e25]
    trajectory = run(UPDATES[name], ys.astype(np.float32))
    assert {leaf.dtype for leaf in jax.tree.leaves(trajectory.state)} == {jnp.dtype("float32")}
    assert not np.any(trajectory.info.flags.nonfinite)
    assert np.max(np.abs(trajectory.state.mean.position)) < 10.0


def test_unscented_and_extended_filters_take_a_robust_update():
    _, ys = sample(7, 10)
    ys[5] += 40.0
    without = ys.copy()
    without[5] = np.nan
    plain = run(condition, without).state.mean.bias
    for filter in (
        unscented(linear_model(), measurement_update=gated()),
        extended(linear_model(), measurement_update=gated()),
    ):
        trajectory = drive.run(filter, prior(), measurements(ys), 1.0)
        assert trajectory.info.flags.rejected.tolist() == [0] * 5 + [2] + [0] * 4
        np.testing.assert_allclose(trajectory.state.mean.bias, plain, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: gated(1.0), "probability=1"),
        (lambda: gated(threshold=0.0), "threshold=0"),
        (lambda: student_t(0.0), "dof=0"),
        (lambda: student_t(iterations=0), "iterations=0"),
        (lambda: huber(-1.0), "threshold=-1"),
    ],
)
def test_bad_settings_are_named(make, field):
    with pytest.raises(ValueError, match=field):
        make()
