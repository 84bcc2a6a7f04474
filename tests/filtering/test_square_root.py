"""The square-root filter: the plain one where both are exact, and better where digits run out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from models import COV, MEAN, F, H, Q, R, Sensors, Track, dense_posterior, linear_model, sample

from wheelhop.filtering import (
    Gaussian,
    InteractingParams,
    cubature,
    dense,
    drive,
    gaussian,
    interacting,
    moment_match,
    scaled,
    smallmat,
    unscented,
    unscented_smoother,
)
from wheelhop.filtering.square_root import (
    SquareRootGaussian,
    condition,
    square_root_unscented,
    square_root_unscented_smoother,
    triangularise,
)
from wheelhop.filtering.square_root import moment_match as root_moment_match

RULES = {"cubature": cubature, "scaled": scaled(), "uneven": scaled(0.5, 2.0, 1.0)}


def bent_model():
    """Nonlinear both ways, driven in one direction that turns with the state."""

    def transition(x, p):
        del p
        return Track(
            x.position + 0.1 * x.velocity,
            x.velocity - 0.1 * jnp.sin(x.position) * (1.0 + x.bias),
            0.99 * x.bias,
        )

    def process_cov(x, p):
        h = (0.1 * jnp.cos(x.position), 0.3 + 0.05 * x.bias, 0.0 * x.bias)
        return tuple(tuple(p * h[i] * h[j] for j in range(i + 1)) for i in range(3))

    return linear_model()._replace(
        transition=transition,
        observation=lambda x, p: Sensors(x.position + 0.1 * x.velocity**2, x.velocity * x.bias),
        process_cov=process_cov,
    )


MODELS = {"linear": linear_model(), "bent": bent_model()}


def prior(cov=COV):
    return gaussian(Track(*MEAN), jnp.asarray(cov))


def measurements(ys):
    return Sensors(jnp.asarray(ys[:, 0]), jnp.asarray(ys[:, 1]))


def gapped(seed, steps=40):
    _, ys = sample(seed, steps)
    ys[5] = np.nan
    ys[20 % steps, 0] = np.nan
    ys[21 % steps, 1] = np.nan
    return ys


def assert_close(found, expected, atol):
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, atol=atol, rtol=0)


@pytest.mark.parametrize(
    ("model", "rule"), [("linear", "scaled"), ("bent", "cubature"), ("bent", "uneven")]
)
def test_filter_and_smoother_equal_the_plain_ones_to_1e_11(model, rule, as_users_compile):
    ys = measurements(gapped(0))
    plain, root = (make(MODELS[model], RULES[rule]) for make in (unscented, square_root_unscented))

    def run(filter, state):
        work = jax.jit(lambda s: drive.run(filter, s, ys, 1.0), compiler_options=as_users_compile)
        return work(state)

    expected = run(plain, prior())
    found = run(root, root.init(prior(), 1.0))
    assert_close(found.state.gaussian, expected.state, 1e-11)
    assert_close(found.info, expected.info, 1e-11)
    smoothed = square_root_unscented_smoother(MODELS[model], RULES[rule])(found.state, 1.0)
    assert_close(
        smoothed.gaussian,
        unscented_smoother(MODELS[model], RULES[rule])(expected.state, 1.0),
        1e-11,
    )


def test_smoother_equals_one_dense_solve_of_the_whole_record():
    _, ys = sample(1, 15)
    filter, smoother = (
        make(linear_model()) for make in (square_root_unscented, square_root_unscented_smoother)
    )
    states = drive.run(
        filter, filter.init(prior(), 1.0), measurements(ys), 1.0, keep=lambda s, i: s
    )
    mean, cov = dense(smoother(states, 1.0).gaussian)
    posterior, spread, _ = dense_posterior(ys)
    np.testing.assert_allclose(np.ravel(mean), posterior, atol=1e-10)
    for k in range(15):
        block = slice(3 * k, 3 * k + 3)
        np.testing.assert_allclose(cov[k], spread[block, block], atol=1e-10)


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 6),
    rank=st.integers(0, 6),
    columns=st.integers(1, 9),
    single=st.booleans(),
)
def test_triangularise_keeps_the_gram_over_dimension_rank_and_units(seed, n, rank, columns, single):
    """Rows in units from 1e-6 to 1e6; the error is counted in each row's own length."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n, rank)) @ rng.normal(size=(rank, columns))
    a = (10.0 ** rng.uniform(-6, 6, n))[:, None] * a
    a = a.astype(np.float32 if single else np.float64)
    lower, _ = triangularise([jnp.asarray(row) for row in a])
    dtype = lower[0][0].dtype
    assert dtype == a.dtype
    assert all(row[-1] >= 0 for row in lower)
    factor = np.array([[*map(float, row), *[0.0] * (n - len(row))] for row in lower])
    exact = a.astype(float)
    length = np.linalg.norm(exact, axis=1)
    length[length == 0] = 1.0
    error = (factor @ factor.T - exact @ exact.T) / np.outer(length, length)
    eps = np.finfo(a.dtype).eps
    deficient = min(rank, columns) < n
    assert np.abs(error).max() < (4 * eps**0.75 if deficient else 30 * eps)


def test_gradient_of_a_gram_through_its_factor_is_exact_with_dependent_rows():
    """d <S, A A^T> with A = E C, where two rows of E are parallel and one is zero."""
    rng = np.random.default_rng(6)
    pattern = np.array([[1.0, 0, 0], [2.0, 0, 0], [0, 0, 0], [1.0, 1.0, 0], [0, 1.0, 1.0]])
    c, s = rng.normal(size=(3, 7)), rng.normal(size=(5, 5))
    s = s + s.T

    @jax.jit
    def total(c):
        lower, _ = triangularise(list(pattern @ c))
        return jnp.sum(s * smallmat.to_dense(smallmat.gram(smallmat.rows_of(lower))))

    expected = 2 * pattern.T @ s @ pattern @ c
    np.testing.assert_allclose(jax.grad(total)(jnp.asarray(c)), expected, atol=1e-9)


def test_explained_rows_are_flagged_and_zero_rows_are_not():
    row = jnp.array([1.0, 2.0, 3.0])
    assert bool(triangularise([row, 2.0 * row])[1])
    assert not bool(triangularise([row, 0.0 * row])[1])
    assert not bool(triangularise([row, row + jnp.array([1e-9, 0.0, 0.0])])[1])


@jax.jit
def likelihood_and_slopes(factors, cov, ys):
    """Of the bent model with its prior and noise multiplied; slopes by factor and measurement."""
    filter = square_root_unscented(bent_model())

    def total(u, ys):
        mean = Track(*(m * f for m, f in zip(MEAN, u[:3], strict=True)))
        start = Gaussian(mean, smallmat.from_dense(u[3] * cov))
        return drive.log_likelihood(filter, filter.init(start, u[4]), ys, u[4])

    return jax.jit(jax.value_and_grad(total, argnums=(0, 1)))(factors, ys)


@pytest.mark.parametrize("known", [None, 2, 0])
def test_gradient_equals_finite_differences(known):
    """With rank-one process noise, missing entries, and a component that is known exactly."""
    cov, ys = jnp.asarray(COV), measurements(gapped(2, 12))
    if known is not None:
        cov = cov.at[known].set(0.0).at[:, known].set(0.0)
    _, (gradient, by_sample) = likelihood_and_slopes(jnp.ones(5), cov, ys)
    for k, unit in enumerate(np.eye(5)):
        above, below = (
            float(likelihood_and_slopes(jnp.asarray(1 + h * unit), cov, ys)[0])
            for h in (1e-5, -1e-5)
        )
        difference = (above - below) / 2e-5
        assert float(gradient[k]) == pytest.approx(difference, rel=1e-6, abs=1e-8)
        assert abs(difference) > 1e-4
    assert np.isfinite(by_sample.a).all()
    assert float(by_sample.a[5]) == float(by_sample.a[8]) == 0.0
    assert abs(float(by_sample.a[4])) > 0.0


def precise_model(variance):
    base = linear_model()
    return base._replace(
        observation_cov=lambda p: jax.tree.map(lambda r: variance * r, base.observation_cov(p))
    )


def worst_error_in_sigmas(make, variance, seed):
    """Of the float32 filter against a float64 one, whitened by the latter's covariance."""
    rng = np.random.default_rng(seed)
    x, ys = rng.multivariate_normal(MEAN, COV), []
    for _ in range(200):
        x = F @ x + rng.normal() * np.array([0.1, 0.3, 0.0])
        ys.append(H @ x + np.sqrt(variance) * rng.multivariate_normal(np.zeros(2), R))
    ys = np.array(ys, np.float32)
    filter = make(precise_model(variance))
    trajectory = drive.run(filter, filter.init(prior(), 1.0), measurements(ys), 1.0)
    assert not np.any(trajectory.info.flags.nonfinite)
    found = np.stack([np.asarray(m, float) for m in trajectory.state.mean], axis=-1)
    mean, cov, worst = MEAN, COV, 0.0
    for y, m in zip(ys.astype(float), found, strict=True):
        mean, cov = F @ mean, F @ cov @ F.T + Q
        gain = np.linalg.solve(H @ cov @ H.T + variance * R, H @ cov).T
        keep = np.eye(3) - gain @ H
        mean = mean + gain @ (y - H @ mean)
        cov = keep @ cov @ keep.T + variance * gain @ R @ gain.T
        worst = max(worst, np.sqrt((m - mean) @ np.linalg.solve(cov, m - mean)))
    return worst


@pytest.mark.parametrize(("variance", "within"), [(1e-6, 0.1), (1e-8, 1.0)])
def test_precise_sensors_in_float32_need_the_square_root(float32, variance, within):
    """Sensors 1e-6 and 1e-8 of the prior variance: ten times the plain filter's accuracy."""
    roots = [worst_error_in_sigmas(square_root_unscented, variance, seed) for seed in range(3)]
    plain = [worst_error_in_sigmas(unscented, variance, seed) for seed in range(3)]
    assert max(roots) < within
    assert max(plain) > 5 * max(roots)


def test_20000_float32_steps_of_a_stiff_model_over_a_ladder_of_sensors(float32):
    """Modes of 0.02 and 0.9999, a constant, rank-one noise: definite at every rung and step."""
    stiff = np.array([[0.02, 0.0, 0.5], [0.1, 0.9999, 0.0], [0.0, 0.0, 1.0]])
    rows = stiff.tolist()
    model = linear_model()._replace(
        transition=lambda x, p: Track(
            *(sum(f * v for f, v in zip(r, x, strict=True)) for r in rows)
        ),
        observation_cov=lambda p: tuple(
            tuple(p * r for r in row[: i + 1]) for i, row in enumerate(R)
        ),
        process_cov=lambda x, p: tuple(
            tuple(q.tolist() for q in row[: i + 1]) for i, row in enumerate(Q)
        ),
    )
    filter = square_root_unscented(model)
    ladder = 10.0 ** -np.arange(0.0, 13.0, 2.0)
    y = Sensors(jnp.zeros(()), jnp.zeros(()))

    def one(variance):
        def body(state, _):
            state, info = filter.step(state, y, variance)
            return state, (info.flags.nonfinite, state.factor)

        return jax.lax.scan(body, filter.init(prior(), variance), None, length=20_000)[1]

    nonfinite, factor = jax.jit(jax.vmap(one))(jnp.asarray(ladder, jnp.float32))
    assert not np.any(nonfinite)
    pivots = np.stack([np.asarray(row[-1], float) for row in factor], axis=-1)
    assert pivots.min() > 0.0
    for rung, variance in enumerate(ladder[:4]):
        cov = COV
        for _ in range(20_000):
            cov = stiff @ cov @ stiff.T + Q
            gain = np.linalg.solve(H @ cov @ H.T + variance * R, H @ cov).T
            keep = np.eye(3) - gain @ H
            cov = keep @ cov @ keep.T + variance * gain @ R @ gain.T
        np.testing.assert_allclose(pivots[rung, -1], np.diag(np.linalg.cholesky(cov)), rtol=0.02)


def stacked_beliefs():
    rng = np.random.default_rng(4)
    rows = [[jnp.asarray(rng.normal(size=4)) for _ in range(i + 1)] for i in range(3)]
    for row in rows:
        row[-1] = jnp.abs(row[-1])
    mean = Track(*jnp.asarray(rng.normal(size=(3, 4))))
    return SquareRootGaussian(mean, tuple(tuple(row) for row in rows))


def test_mixture_equals_the_plain_moment_match():
    weights = jnp.array([0.1, 0.2, 0.3, 0.4])
    found = root_moment_match(weights, stacked_beliefs()).gaussian
    assert_close(found, moment_match(weights, stacked_beliefs().gaussian), 1e-12)


def test_a_mixture_ignores_a_lost_member_in_value_and_gradient():
    weights = jnp.array([0.2, 0.0, 0.5, 0.3])
    lost = jax.tree.map(lambda a: a.at[1].set(jnp.nan), stacked_beliefs())

    def total(weights, stacked):
        mixed = root_moment_match(weights, stacked).gaussian
        return sum(jnp.sum(leaf) for leaf in jax.tree.leaves(mixed))

    assert float(total(weights, lost)) == pytest.approx(float(total(weights, stacked_beliefs())))
    slopes = jax.jit(jax.grad(total, argnums=(0, 1)))(weights, lost)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes))
    assert abs(float(slopes[0][0])) > 0.0


def test_members_of_an_imm_equal_plain_members():
    ys = measurements(gapped(5, 25))
    params = InteractingParams(
        jnp.array([0.3, 1.0, 4.0]),
        jnp.array([[0.9, 0.1, 0.0], [0.1, 0.8, 0.1], [0.0, 0.2, 0.8]]),
        jnp.array([0.0, 0.6, 0.4]),
    )
    plain, root = (interacting(make(bent_model())) for make in (unscented, square_root_unscented))
    expected = drive.run(plain, plain.init(prior(), params), ys, params)
    found = drive.run(root, root.init(prior(), params), ys, params)
    assert_close(found.state.combined.gaussian, expected.state.combined, 1e-11)
    assert_close(found.state.log_probabilities, expected.state.log_probabilities, 1e-10)
    assert_close(found.info.log_likelihood, expected.info.log_likelihood, 1e-10)


def test_lanes_of_arrays_equal_vmap():
    """Entries [runs] give every run its own numbers, with no vmap."""
    runs = 4
    filter = square_root_unscented(bent_model())
    scale = jnp.linspace(0.5, 2.0, runs)
    y = Sensors(jnp.linspace(-1.0, 1.0, runs), jnp.array([0.1, jnp.nan, 0.3, -0.2]))
    state = jax.tree.map(lambda a: a * jnp.ones(runs), filter.init(prior(), scale))
    lanes, separate = (
        step(*step(state, y, scale)[:1], y, scale)
        for step in (jax.jit(filter.step), jax.jit(jax.vmap(filter.step)))
    )
    assert_close(lanes, separate, 1e-13)


def test_another_measurement_update_takes_the_place_of_conditioning():
    def wider(predicted, factor, moments, noise, y, guarded):
        noise = jax.tree.map(lambda r: 4.0 * r, noise)
        return condition(predicted, factor, moments, noise, y, guarded)

    base = linear_model()
    scaled_noise = base._replace(
        observation_cov=lambda p: jax.tree.map(lambda r: 4.0 * r, base.observation_cov(p))
    )
    y = Sensors(jnp.asarray(0.4), jnp.asarray(-0.7))
    found = square_root_unscented(base, measurement_update=wider)
    expected = square_root_unscented(scaled_noise)
    start = found.init(prior(), 1.0)
    assert_close(jax.jit(found.step)(start, y, 1.0), jax.jit(expected.step)(start, y, 1.0), 1e-15)


def test_a_known_state_and_divergence():
    """Zero prior covariance is finite in value and slope; an infinite state is flagged."""
    filter = square_root_unscented(linear_model())
    y = Sensors(jnp.asarray(0.1), jnp.asarray(0.2))

    @jax.jit
    def total(mean):
        start = filter.init(Gaussian(mean, prior(np.zeros((3, 3))).cov), 1.0)
        state, info = filter.step(start, y, 1.0)
        return info.log_likelihood + state.mean.position

    assert np.isfinite(total(prior().mean))
    assert all(np.isfinite(g) for g in jax.jit(jax.grad(total))(prior().mean))
    start = filter.init(gaussian(Track(np.inf, 0.0, 0.0), jnp.asarray(COV)), 1.0)
    assert bool(jax.jit(filter.step)(start, y, 1.0)[1].flags.nonfinite)


def test_small_alpha_is_refused_in_float32(float32):
    filter = square_root_unscented(linear_model(), scaled(alpha=1e-3))
    y = Sensors(jnp.asarray(0.0), jnp.asarray(0.0))
    with pytest.raises(ValueError, match=r"use alpha >= 0\.1 or run in float64"):
        filter.step(filter.init(prior(), 1.0), y, 1.0)


def test_an_indefinite_even_part_is_flagged():
    """A negative central weight and a strong parabola: even part plus noise below zero."""
    filter = square_root_unscented(
        linear_model()._replace(
            transition=lambda x, p: Track(3.0 * x.position**2, x.velocity, x.bias),
        ),
        scaled(0.5, 0.0, 0.0),
    )
    y = Sensors(jnp.asarray(0.0), jnp.asarray(0.0))
    _, info = jax.jit(filter.step)(filter.init(prior(), 1e-6), y, 1e-6)
    assert bool(info.flags.guarded)
