"""State and unknown input against one dense least-squares problem, and by Monte Carlo."""

from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, F, Q, Track
from scipy.linalg import block_diag, null_space
from scipy.signal import ss2tf
from scipy.stats import chi2

from wheelhop.filtering import (
    Gaussian,
    InteractingParams,
    LinearGaussian,
    dense,
    drive,
    gaussian,
    interacting,
    kalman,
    normalised_square,
)
from wheelhop.filtering.decoupling import UnknownInputModel, decoupled, strong_observability
from wheelhop.filtering.unknown_input import unknown_input


class Seen(NamedTuple):
    a: Any
    b: Any
    c: Any


class Force(NamedTuple):
    front: Any
    rear: Any


class Nothing(NamedTuple):
    pass


C = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, -1.0], [0.4, 0.2, 0.5]])
G = np.array([[0.3, 1.0], [1.0, -0.4], [0.2, 0.1]])
R = np.array([[0.5, 0.1, 0.0], [0.1, 0.4, -0.05], [0.0, -0.05, 0.3]])
SIZE = np.array([[4.0, 0.5], [0.5, 1.0]])
NOISE = np.array([0.1, 0.3, 0.0])  # Q = NOISE NOISE^T
FEEDTHROUGH = {
    "full": (G, np.array([[0.2, 0.7], [-0.6, 0.1], [0.3, 0.3]])),
    "none": (G, np.zeros((3, 2))),
    "deficient": (G, np.outer([0.5, 0.2, -0.3], [1.0, 0.7])),
    "both deficient": (np.outer([0.3, 1.0, 0.2], [0.4, -1.0]), np.outer([0.5, 0, -0.3], [1, 0.7])),
}
FILTER = unknown_input(Seen, Force)
STEPS = 10


def model(case, **changes):
    g, h = FEEDTHROUGH[case]
    return replace(UnknownInputModel(F, g, C, h, Q, R), **changes)


def prior():
    return gaussian(Track(*MEAN), jnp.asarray(COV))


def stacked(ys, kind=Seen):
    return kind(*(jnp.asarray(ys[..., i]) for i in range(ys.shape[-1])))


@jax.jit
def filtered(belief, ys, params):
    return drive.run(FILTER, FILTER.init(belief, params), ys, params)


def run(case, ys, size=SIZE, **changes):
    return filtered(prior(), stacked(ys), decoupled(model(case, **changes), size))


def square_wave(amplitude=1e3, steps=STEPS):
    """Inputs d_0..d_N."""
    k = np.arange(steps + 1)
    return amplitude * np.stack([np.sign(np.sin(0.7 * k + 0.1)), np.sign(np.sin(0.31 * k + 2))], 1)


def simulate(seed, case, ds):
    """x_1..x_N and y_1..y_N under the inputs d_0..d_N."""
    rng = np.random.default_rng(seed)
    g, h = FEEDTHROUGH[case]
    root = np.linalg.cholesky(R)
    x = MEAN + np.linalg.cholesky(COV) @ rng.normal(size=3)
    xs, ys = [], []
    for before, now in pairwise(ds):
        x = F @ x + g @ before + rng.normal() * NOISE
        xs.append(x)
        ys.append(C @ x + h @ now + root @ rng.normal(size=3))
    return np.array(xs), np.array(ys)


def split(h):
    """Basis of what h sees (orthogonal in SIZE^-1 to the rest) and of its null space."""
    blind = null_space(h)
    return SIZE @ null_space(blind.T) if blind.size else np.eye(2), blind


class Record:
    """All x_k, d_k as linear functions of independent unknowns (x_0, w_1..w_N, d_0..d_N)."""

    def __init__(self, case, steps):
        self.g, self.h = FEEDTHROUGH[case]
        self.columns = 3 + steps + 2 * (steps + 1)
        eye = np.eye(self.columns)
        self.x = [eye[:3]]
        self.d = [eye[3 + steps + 2 * k : 5 + steps + 2 * k] for k in range(steps + 1)]
        self.w = [eye[3 + k] for k in range(steps)]
        for k in range(steps):
            self.x.append(F @ self.x[k] + self.g @ self.d[k] + np.outer(NOISE, self.w[k]))

    def direct_prior(self, k):
        """What h sees of d_k, for d_k ~ N(0, SIZE): rows, mean, covariance."""
        u, s, _ = np.linalg.svd(self.h)
        image = u[:, : (s > 1e-9).sum()].T @ self.h
        return image @ self.d[k], np.zeros(len(image)), image @ SIZE @ image.T

    def delayed_prior(self, k):
        """What h does not see of d_k, likewise."""
        _, blind = split(self.h)
        weight = np.linalg.inv(SIZE)
        cov = np.linalg.inv(blind.T @ weight @ blind)
        return cov @ blind.T @ weight @ self.d[k], np.zeros(len(cov)), cov

    def solve(self, ys, undetermined=()):
        """Least squares with flat inputs; the inputs of `undetermined` samples have a prior."""
        facts = [(self.x[0], MEAN, COV)]
        facts.append((np.array(self.w), np.zeros(len(self.w)), np.eye(len(self.w))))
        facts.append(self.direct_prior(0))
        for k in undetermined:
            facts += [self.direct_prior(k), self.delayed_prior(k - 1)]
        for k, y in enumerate(ys, 1):
            here = np.isfinite(y)
            row = C @ self.x[k] + self.h @ self.d[k]
            facts.append((row[here], y[here], R[np.ix_(here, here)]))
        left, right = [], []
        for rows, value, cov in facts:
            root = np.linalg.cholesky(cov)
            left.append(np.linalg.solve(root, rows))
            right.append(np.linalg.solve(root, value))
        inverse = np.linalg.pinv(np.concatenate(left), rcond=1e-11)
        return inverse @ np.concatenate(right), inverse @ inverse.T


def check_against_dense(case, ys, trajectory, undetermined=()):
    mean, cov = dense(trajectory.state.belief)
    d_mean, d_cov = dense(trajectory.state.input)
    for k in range(1, len(ys) + 1):
        record = Record(case, k)
        found, spread = record.solve(ys[:k], [u for u in undetermined if u <= k])
        x, d = record.x[k], record.d[k if case == "full" else k - 1]
        size = np.abs(found).max()
        np.testing.assert_allclose(mean[k - 1], x @ found, atol=1e-9 * size)
        np.testing.assert_allclose(cov[k - 1], x @ spread @ x.T, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(d_mean[k - 1], d @ found, atol=1e-9 * size)
        np.testing.assert_allclose(d_cov[k - 1], d @ spread @ d.T, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("case", FEEDTHROUGH)
def test_state_and_input_equal_dense_least_squares_after_every_sample(case):
    _, ys = simulate(0, case, square_wave(20.0))
    check_against_dense(case, ys, run(case, ys))


@pytest.mark.parametrize("case", FEEDTHROUGH)
def test_a_missing_entry_that_leaves_the_input_determined_is_left_out(case):
    _, ys = simulate(1, case, square_wave(20.0))
    ys[3, 1] = np.nan
    trajectory = run(case, ys)
    check_against_dense(case, ys, trajectory)
    assert trajectory.info.flags.missing.tolist() == [k == 3 for k in range(STEPS)]
    assert not trajectory.info.flags.guarded.any()


@pytest.mark.parametrize("case", FEEDTHROUGH)
def test_the_input_of_a_sample_that_cannot_determine_it_has_its_prior(case):
    _, ys = simulate(2, case, square_wave(3.0))
    ys[3] = np.nan
    ys[6, :2] = np.nan
    trajectory = run(case, ys)
    check_against_dense(case, ys, trajectory, undetermined=(4, 7))
    assert trajectory.info.flags.guarded.tolist() == [k in (3, 6) for k in range(STEPS)]
    assert float(trajectory.info.log_likelihood[3]) == pytest.approx(0.0, abs=1e-12)
    assert float(trajectory.info.nis[3]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("case", FEEDTHROUGH)
def test_likelihood_is_that_of_the_record_whatever_its_inputs(case):
    """REML of the record, its volume counted in what each sample spends on the inputs."""
    steps = STEPS
    _, ys = simulate(3, case, square_wave(20.0))
    record = Record(case, steps)
    sees, blind = split(record.h)
    y = np.concatenate([C @ record.x[k] + record.h @ record.d[k] for k in range(1, steps + 1)])
    base = block_diag(COV, np.eye(steps))
    known, flat = y[:, : 3 + steps], y[:, 3 + steps :]
    cov = known @ base @ known.T + np.kron(np.eye(steps), R)
    first = flat[:, :2] @ sees
    cov += first @ np.linalg.inv(sees.T @ np.linalg.inv(SIZE) @ sees) @ first.T
    design = [flat[:, 2 * k : 2 * k + 2] @ blind for k in range(steps)]
    design += [flat[:, 2 * k : 2 * k + 2] @ sees for k in range(1, steps + 1)]
    design = np.concatenate(design, 1)
    e = ys.ravel() - known[:, :3] @ MEAN
    white = np.linalg.cholesky(cov)
    a, e = np.linalg.solve(white, design), np.linalg.solve(white, e)
    left = e - a @ np.linalg.lstsq(a, e, rcond=None)[0]
    seen = np.concatenate([C @ record.g @ blind, record.h @ sees], 1)
    volume = 2 * np.log(np.diag(white)).sum() + np.linalg.slogdet(a.T @ a)[1]
    volume -= steps * np.linalg.slogdet(seen.T @ seen)[1]
    expected = -0.5 * (left @ left + volume + steps * np.log(2 * np.pi))
    info = run(case, ys).info
    np.testing.assert_allclose(info.nis.sum(), left @ left, rtol=1e-9)
    np.testing.assert_allclose(info.log_likelihood.sum(), expected, rtol=1e-10)


@pytest.mark.parametrize("case", FEEDTHROUGH)
def test_unbiased_and_honest_over_500_runs_under_a_large_square_wave(case):
    runs, ds = 500, square_wave()
    records = [simulate(50 + k, case, ds) for k in range(runs)]
    xs, ys = map(np.array, zip(*records, strict=True))
    # no sample sees d_0 at once, so its size must be told
    params = decoupled(model(case), 1e6 * np.eye(2))
    last = jax.vmap(filtered, in_axes=(None, 0, None))(prior(), stacked(ys), params)
    state, info = jax.tree.map(lambda a: a[:, -1], last)
    truth = ds[-1 if case == "full" else -2]
    for belief, value in ((state.belief, xs[:, -1]), (state.input, truth)):
        mean, cov = dense(belief)
        error = np.asarray(mean) - value
        sizes = np.sqrt(np.diagonal(np.asarray(cov), axis1=1, axis2=2).mean(0))
        assert (np.abs(error.mean(0)) < 4 * sizes / np.sqrt(runs)).all()
        nees = np.einsum("ri,rij,rj->r", error, np.linalg.inv(cov), error)
        low, high = chi2.ppf([0.0005, 0.9995], error.shape[1] * runs) / runs
        assert low < nees.mean() < high
    low, high = chi2.ppf([0.0005, 0.9995], runs) / runs
    assert low < np.asarray(info.nis).mean() < high  # three entries, two inputs
    innovation = np.stack(info.innovation, 1)
    expected = np.asarray(dense(Gaussian(info.innovation, info.innovation_cov))[1])[0]
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.linalg.matrix_rank(expected, tol=1e-9) == 1
    np.testing.assert_allclose(np.cov(innovation.T) / scale, expected / scale, atol=0.25)


def test_without_feedthrough_it_is_the_recursion_of_the_literature():
    """Filipozzi et al. 2021, Eq. 19-26 (their G = 0, their H is G here), in NumPy.

    The input is Gillijns & De Moor's; Eq. 27 adds to it a part of the correction of the process
    noise, is unbiased too, and has the larger variance.
    """
    _, ys = simulate(4, "none", square_wave(20.0))
    state = run("none", ys).state
    x, p = MEAN, COV
    for k, y in enumerate(ys):
        x, p = F @ x, F @ p @ F.T + Q
        s = C @ p @ C.T + R
        phi = C @ G
        weight = np.linalg.inv(phi.T @ np.linalg.solve(s, phi)) @ phi.T @ np.linalg.inv(s)
        gain = p @ C.T @ np.linalg.inv(s)
        gain = gain + (G - gain @ phi) @ weight
        e = y - C @ x
        x = x + gain @ e
        p = gain @ s @ gain.T - p @ C.T @ gain.T - gain @ C @ p + p
        np.testing.assert_allclose(dense(state.belief)[0][k], x, atol=1e-10)
        np.testing.assert_allclose(dense(state.belief)[1][k], p, atol=1e-10)
        np.testing.assert_allclose(dense(state.input)[0][k], weight @ e, atol=1e-9)
        printed = np.linalg.pinv(G) @ gain
        excess = printed @ s @ printed.T - np.asarray(dense(state.input)[1])[k]
        assert np.linalg.eigvalsh(excess).min() > -1e-9
        assert np.trace(excess) > 1e-4


def test_without_inputs_it_is_the_kalman_filter():
    _, ys = simulate(5, "none", np.zeros((STEPS + 1, 2)))
    ys[4] = np.nan
    ys[8, 1] = np.nan
    filter = unknown_input(Seen, Nothing)
    params = decoupled(
        UnknownInputModel(F, np.zeros((3, 0)), C, np.zeros((3, 0)), Q, R), np.zeros((0, 0))
    )
    found = drive.run(filter, filter.init(prior(), params), stacked(ys), params)
    matrices = LinearGaussian(*map(jnp.asarray, (F, C, Q, R)))
    expected = drive.run(kalman(Seen), prior(), stacked(ys), matrices)
    for a, b in zip(jax.tree.leaves(found.info), jax.tree.leaves(expected.info), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-11)
    for a, b in zip(dense(found.state.belief), dense(expected.state), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_known_inputs_shift_state_and_measurement():
    _, ys = simulate(6, "deficient", square_wave(20.0))
    f, h = np.array([0.3, -0.2, 0.1]), np.array([5.0, 1.0, -2.0])
    plain = run("deficient", ys).state
    shift, shifts = np.zeros(3), []
    for _ in ys:
        shift = F @ shift + f
        shifts.append(shift)
    moved = run("deficient", ys + np.array(shifts) @ C.T + h, state_offset=f, observation_offset=h)
    np.testing.assert_allclose(
        dense(moved.state.belief)[0], dense(plain.belief)[0] + np.array(shifts), atol=1e-10
    )
    np.testing.assert_allclose(dense(moved.state.input)[0], dense(plain.input)[0], atol=1e-10)


@pytest.mark.parametrize("case", FEEDTHROUGH)
def test_units_of_the_input_do_not_matter(case):
    _, ys = simulate(7, case, square_wave(20.0))
    units = np.array([1e6, 1e-4])
    g, h = FEEDTHROUGH[case]
    plain = run(case, ys)
    scaled = run(case, ys, SIZE / np.outer(units, units), input_matrix=g * units,
                 feedthrough=h * units)  # fmt: skip
    np.testing.assert_allclose(scaled.info.log_likelihood, plain.info.log_likelihood, atol=1e-8)
    for a, b in zip(dense(scaled.state.belief), dense(plain.state.belief), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-8)
    found = np.asarray(dense(scaled.state.input)[0]) * units
    np.testing.assert_allclose(found, dense(plain.state.input)[0], atol=1e-8)


def test_size_of_the_input_has_no_effect_where_the_samples_determine_it():
    _, ys = simulate(8, "none", square_wave(20.0))
    one, other = (run("none", ys, size) for size in (SIZE, np.diag([1e8, 1e-4])))
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-8)


KNOBS = ("transition", "input_matrix", "observation", "feedthrough", "process_cov",
         "observation_cov", "prior covariance", "blind direction")  # fmt: skip


def turned(case, factors):
    """The model with every matrix scaled; the last factor turns the null space of H."""
    u = dict(zip(KNOBS, factors, strict=True))
    g, h = FEEDTHROUGH[case]
    base = UnknownInputModel(*map(jnp.asarray, (F, g, C, h, Q, R)))
    changed = replace(base, **{name: u[name] * getattr(base, name) for name in KNOBS[:6]})
    if case == "deficient":
        seen = jnp.stack([u["feedthrough"], 0.7 * u["feedthrough"] * u["blind direction"]])
        changed = replace(changed, feedthrough=jnp.array([[0.5], [0.2], [-0.3]]) * seen[None])
    return changed, jax.tree.map(lambda a: u["prior covariance"] * a, prior().cov)


def test_gradient_equals_finite_differences_that_prepare_the_model_anew():
    case = "deficient"
    _, ys = simulate(9, case, square_wave(3.0))
    ys[4, 0] = np.nan
    ys[6] = np.nan
    prepared = decoupled(turned(case, np.ones(len(KNOBS)))[0], SIZE)

    def total(params, cov):
        states = filtered(prior()._replace(cov=cov), stacked(ys), params)
        return states.info.log_likelihood.sum() + states.state.input.mean.front.sum()

    def fixed(factors):
        changed, cov = turned(case, factors)
        return total(replace(prepared, model=changed), cov)

    gradient = jax.jit(jax.grad(fixed))(jnp.ones(len(KNOBS)))
    for k, knob in enumerate(KNOBS):
        values = []
        for sign in (1, -1):
            changed, cov = turned(case, np.ones(len(KNOBS)) + sign * 1e-5 * np.eye(len(KNOBS))[k])
            values.append(float(total(decoupled(changed, SIZE), cov)))
        difference = (values[0] - values[1]) / 2e-5
        assert float(gradient[k]) == pytest.approx(difference, rel=1e-5, abs=1e-6), knob


def test_one_trace_serves_every_model_of_a_structure():
    @jax.jit
    @chex.assert_max_traces(n=1)
    def step(state, y, params):
        return FILTER.step(state, y, params)[0]

    chex.clear_trace_counter()
    first, second = (decoupled(model(case), SIZE) for case in ("deficient", "both deficient"))
    new = step(FILTER.init(prior(), first), Seen(*jnp.ones(3)), first)
    step(new, Seen(*jnp.zeros(3)), second)


@pytest.mark.parametrize("case", ["full", "none", "deficient"])
def test_a_step_keeps_the_structure_and_types_of_the_state(case):
    params = decoupled(model(case), SIZE)
    before = FILTER.init(prior(), params)
    after = jax.eval_shape(lambda s: FILTER.step(s, Seen(*jnp.ones(3)), params)[0], before)
    assert jax.tree.structure(before) == jax.tree.structure(after)
    for old, new in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True):
        assert (old.shape, old.dtype) == (new.shape, new.dtype)


@pytest.mark.parametrize("case", ["none", "deficient"])
def test_a_step_over_runs_equals_each_run(case):
    """Lanes: entries of state, measurement and matrices are [runs]."""
    _, ys = simulate(10, case, square_wave(20.0))
    ys[2, 0] = np.nan
    params = decoupled(model(case), SIZE)
    states = filtered(prior(), stacked(ys), params).state
    factors = jnp.linspace(0.8, 1.2, STEPS)[None, None]
    matrices = {
        name: getattr(params.model, name)[..., None] * factors
        for name in ("transition", "input_matrix", "process_cov")
    }
    each = replace(params, model=replace(params.model, **matrices))
    last = jax.tree.map(lambda a: 2 if a.ndim == 3 else None, each)
    together = jax.jit(FILTER.step)(states, stacked(ys), each)
    mapped = jax.jit(jax.vmap(FILTER.step, in_axes=(0, 0, last)))(states, stacked(ys), each)
    for a, b in zip(jax.tree.leaves(together), jax.tree.leaves(mapped), strict=True):
        assert a.shape == b.shape == (STEPS,)
        np.testing.assert_allclose(a, b, atol=1e-10)


@pytest.mark.parametrize("case", ["full", "deficient"])
def test_float32_runs_in_float32(case, float32):
    _, ys = simulate(11, case, square_wave(20.0))
    ys[5] = np.nan
    found = run(case, ys)
    assert {leaf.dtype for leaf in jax.tree.leaves(found.state)} == {jnp.dtype("float32")}
    with jax.enable_x64(True):
        expected = run(case, ys)
    for a, b in ((found.state.belief, expected.state.belief), (found.state.input,
                                                               expected.state.input)):  # fmt: skip
        np.testing.assert_allclose(dense(a)[0], dense(b)[0], atol=1e-3)
        np.testing.assert_allclose(dense(a)[1], dense(b)[1], rtol=1e-3, atol=1e-4)


def test_mixing_matches_the_moments_of_state_and_input():
    _, ys = simulate(12, "full", square_wave(3.0))
    params = [decoupled(model("full", process_cov=s * Q), SIZE) for s in (0.5, 30.0)]
    states = [
        jax.tree.map(lambda a: a[-1], filtered(prior(), stacked(ys), p).state) for p in params
    ]
    weights = np.array([0.3, 0.7])
    mixed = FILTER.mix(jnp.asarray(weights), jax.tree.map(lambda *a: jnp.stack(a), *states))

    def joint(state):
        mean = np.concatenate([state.belief.mean, state.direct.mean])
        corner = np.array(state.cross)
        x, d = dense(state.belief)[1], dense(state.direct)[1]
        return mean, np.block([[np.array(x), corner], [corner.T, np.array(d)]])

    means, covs = map(np.array, zip(*map(joint, states), strict=True))
    mean, cov = joint(mixed)
    centre = weights @ means
    spread = sum(
        w * (c + np.outer(m - centre, m - centre))
        for w, m, c in zip(weights, means, covs, strict=True)
    )
    np.testing.assert_allclose(mean, centre, atol=1e-12)
    np.testing.assert_allclose(cov, spread, atol=1e-12)
    assert float(mixed.input.mean.front) == pytest.approx(centre[3])


def test_members_of_an_imm_find_the_process_noise_under_an_unknown_input():
    _, ys = simulate(13, "deficient", square_wave(steps=200))
    ys[50] = np.nan
    members = [decoupled(model("deficient", process_cov=s * Q), 1e6 * np.eye(2)) for s in (1, 100)]
    members = jax.tree.map(lambda *a: jnp.stack(a), *members)
    imm = interacting(FILTER)
    stay = jnp.array([[0.99, 0.01], [0.01, 0.99]])
    params = InteractingParams(members, stay, jnp.array([0.5, 0.5]))
    last, info = drive.scan(imm, imm.init(prior(), params), stacked(ys), params,
                            keep=lambda state, info: info)  # fmt: skip
    assert float(jnp.exp(last.log_probabilities[0])) > 0.9
    assert not info.flags.nonfinite.any()


class Moved(NamedTuple):
    x: Any
    y: Any


class Push(NamedTuple):
    d: Any


def zero_at(zero):
    """One input, one measurement, H = 0, C G = 1, and the invariant zero where it is wanted."""
    f = np.array([[0.9, 0.3], [0.1, zero + 0.2]])
    g = np.array([[1.0], [0.5]])
    c = np.array([[1.0, 0.0]])
    # y = 0 holds x at 0 by d = -0.3 y, which moves y by the factor zero + 0.2 - 0.15
    f[1, 1] = zero + 0.15
    return UnknownInputModel(f, g, c, np.zeros((1, 1)), 0.01 * np.eye(2), np.eye(1))


@pytest.mark.parametrize(("zero", "stable"), [(0.8, True), (1.25, False)])
def test_a_hidden_state_is_reported_and_decides_whether_the_error_stays_bounded(zero, stable):
    system = zero_at(zero)
    report = strong_observability(system)
    assert not report.observable
    assert report.detectable is stable
    np.testing.assert_allclose(report.zeros, [zero], atol=1e-10)
    np.testing.assert_allclose(np.abs(report.hidden[:, 0]), [0.0, 1.0], atol=1e-10)
    numerator, _ = ss2tf(system.transition, system.input_matrix, system.observation, 0.0)
    np.testing.assert_allclose(np.roots(np.trim_zeros(numerator[0], "f")), [zero], atol=1e-10)

    class One(NamedTuple):
        y: Any

    filter = unknown_input(One, Push)
    params = decoupled(system, np.eye(1))
    start = filter.init(gaussian(Moved(0.0, 0.0), jnp.eye(2)), params)
    states = drive.run(filter, start, One(jnp.zeros(100)), params, keep=lambda s, i: s.belief)
    variance = np.asarray(states.cov[1][1])
    assert bool(variance[-1] < 2 * variance[10]) is stable


def test_strong_observability_agrees_with_the_rank_of_the_whole_record():
    """x_0 is free of the inputs iff rank [O T] = n + rank T over n samples (any scaling)."""
    rng = np.random.default_rng(0)
    seen = set()
    for trial in range(60):
        n, p, m = 3, 1 + trial % 2, 2 + (trial // 2) % 2
        f = rng.normal(size=(n, n))
        g, h, c = rng.normal(size=(n, p)), rng.normal(size=(m, p)), rng.normal(size=(m, n))
        h = h * (rng.random(h.shape) < 0.4)
        c = c * (rng.random(c.shape) < 0.5)
        f = f * (rng.random(f.shape) < 0.7)
        units = np.diag([1.0, 1e3, 1e-3])
        system = UnknownInputModel(units @ f @ np.linalg.inv(units), units @ g,
                                   c @ np.linalg.inv(units), h, np.eye(n), np.eye(m))  # fmt: skip
        try:
            report = strong_observability(system)
        except ValueError:
            continue
        seeing = np.concatenate([c @ np.linalg.matrix_power(f, k) for k in range(n + 1)])
        driving = np.zeros((m * (n + 1), p * (n + 1)))
        for i in range(n + 1):
            for j in range(i + 1):
                block = h if i == j else c @ np.linalg.matrix_power(f, i - j - 1) @ g
                driving[m * i : m * i + m, p * j : p * j + p] = block
        rank = np.linalg.matrix_rank
        free = rank(np.hstack([seeing, driving]), tol=1e-9) == n + rank(driving, tol=1e-9)
        assert report.observable == free
        seen.add(free)
    assert seen == {True, False}


def quarter_car(dt=0.002):
    """Momenta and deflection under wheel load and load transfer (Filipozzi et al. 2021)."""
    m_s, m_u, k, b = 450.0, 40.0, 30e3, 2e3
    slope = np.array([[-b / m_s, b / m_u, k], [b / m_s, -b / m_u, -k], [-1 / m_s, 1 / m_u, 0]])
    g = dt * np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    c = np.stack([slope[0] / m_s, [0, 0, 1], slope[2]])
    h = np.array([[0.0, -1 / m_s], [0.0, 0.0], [0.0, 0.0]])
    f = np.eye(3) + dt * slope + 0.5 * dt**2 * slope @ slope
    return UnknownInputModel(f, g, c, h, np.diag([1.0, 1.0, 1e-8]), np.diag([1e-2, 1e-6, 1e-4]))


def test_a_quarter_car_hides_its_common_motion():
    report = strong_observability(quarter_car())
    assert not report.observable
    assert not report.detectable
    np.testing.assert_allclose(report.zeros, [1.0], atol=1e-9)
    expected = np.array([450.0, 40.0, 0.0])
    cosine = report.hidden[:, 0] @ expected / np.linalg.norm(expected)
    assert abs(cosine) == pytest.approx(1.0, abs=1e-9)
    params = decoupled(quarter_car(), 1e6 * np.eye(2))
    assert params.direct.shape == params.delayed.shape == (2, 1)


@pytest.mark.parametrize(
    ("changes", "size", "says"),
    [
        ({"input_matrix": np.zeros((3, 2))}, SIZE, "rank 0.*leaves no trace"),
        ({"input_matrix": np.outer([1, 1, 0], [1, 2])}, SIZE, r"rank 1.*\[-1, 0.5\]"),
        ({"observation": C[:1], "feedthrough": np.zeros((1, 2)), "observation_cov": R[:1, :1]},
         SIZE, "1 measured entries do not determine 2 inputs"),
        ({}, -SIZE, "input_cov.*not positive definite"),
        ({}, np.eye(3), r"input_cov has shape \(3, 3\)"),
        ({"observation_cov": np.zeros((3, 3))}, SIZE, "observation_cov.*variance"),
        ({"feedthrough": np.zeros((3, 1))}, SIZE, r"feedthrough has shape \(3, 1\)"),
        ({"transition": np.full((3, 3), np.nan)}, SIZE, "transition.*not finite"),
        ({"transition": np.zeros((3, 3, 5))}, SIZE, "transition has 3 axes"),
    ],
)  # fmt: skip
def test_a_model_that_cannot_work_is_refused(changes, size, says):
    with pytest.raises(ValueError, match=says):
        decoupled(model("none", **changes), size)


def test_refusals_of_traced_models_wrong_names_and_silent_inputs():
    traced = jax.grad(lambda f: decoupled(model("none", transition=f), SIZE).direct.sum())
    with pytest.raises(ValueError, match=r"outside.*replace\(params, model="):
        traced(jnp.asarray(F))
    params = decoupled(model("none"), SIZE)
    with pytest.raises(ValueError, match=r"inputs has the 1 components \('d',\).*have 2"):
        unknown_input(Seen, Push).init(prior(), params)
    with pytest.raises(ValueError, match=r"measurement has the 2 components"):
        unknown_input(Moved, Force).init(prior(), params)
    with pytest.raises(ValueError, match=r"input direction \[0, 1\] never shows"):
        strong_observability(model("none", input_matrix=G * [1.0, 0.0]))


def test_innovation_and_its_covariance_give_the_nis():
    _, ys = simulate(14, "deficient", square_wave(3.0))
    info = run("deficient", ys).info
    found = jax.vmap(normalised_square)(info.innovation, info.innovation_cov)
    np.testing.assert_allclose(found, info.nis, rtol=1e-4)
