"""The loss: values against a NumPy simulation, derivatives against differences and reverse mode."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from truth import record, simulate, waves

from wheelhop.identification.drives import prepare
from wheelhop.identification.loss import inputs_of, step
from wheelhop.identification.objective import evaluate, losses, mean_squares, task_of
from wheelhop.identification.parameters import PARAMETERS, search_space, with_values
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.quarter_car import RelativeState

CAR = brancati_suv()
CLOSE = {"suspension.stiffness": 36e3, "suspension.damping": 2100.0, "tire.damping": 90.0}
ALL = search_space(tuple(PARAMETERS))
START = with_values(CAR, CLOSE)
RECORDS = [record(1, 12.0, 130e3, 3.2), record(2, 22.0, 230e3, 3.7, noise=0.5)]
PREPARED = prepare(RECORDS)
TASK = task_of(START, PREPARED.drives)
FREE = jnp.asarray(ALL.free(START))[None]


def test_errors_are_those_of_a_numpy_simulation():
    """The same waves, another program, four times finer, the true road between the samples."""
    true = {name: float(v) for name, v in zip(ALL.names, ALL.values(FREE[0]), strict=True)}
    deviation = []
    for rate in (500.0, 2000.0):
        r = record(2, 22.0, 230e3, 4.0, rate)
        prepared = prepare([r], settling=1.9)
        found = mean_squares(FREE, task_of(START, prepared.drives), ALL)[0, 0]
        road = waves(np.random.default_rng(2), 64e-6, 22.0)
        a_s, a_u, _ = simulate(road, 230e3, 4.0, rate, true)
        judged = r.t - r.t[0] >= 1.9
        pairs = ((a_s, r.a_s), (a_u, r.a_u))
        expected = [np.mean((ours - measured)[judged] ** 2) for ours, measured in pairs]
        deviation.append(np.abs(np.asarray(found) / expected - 1.0))
    assert np.max(deviation) < 2e-3


def test_forward_gradient_is_the_central_difference_and_reverse_mode():
    forward = jax.jit(lambda f: evaluate(f, TASK, ALL))(FREE)
    reverse = jax.jit(lambda f: evaluate(f, TASK, ALL, "reverse"))(FREE)
    np.testing.assert_allclose(forward.loss, reverse.loss, rtol=1e-12)
    scale = float(jnp.abs(forward.gradient).max())
    np.testing.assert_allclose(forward.gradient, reverse.gradient, atol=1e-10 * scale)
    n = FREE.shape[1]
    step = 1e-5 * jnp.eye(n)
    value = jax.jit(lambda f: losses(f, TASK, ALL))
    difference = (value(FREE + step) - value(FREE - step)) / 2e-5
    np.testing.assert_allclose(forward.gradient[0], difference, atol=2e-7 * scale)


def test_gauss_newton_matrix_is_that_of_the_residuals_derivatives():
    """By central differences: with J = |r|^2, dr/dtheta from squares of shifted simulations."""
    space = search_space(("suspension.damping", "tire.stiffness"))
    free = jnp.asarray(space.free(START))
    found = jax.jit(lambda f: evaluate(f, TASK, space))(free[None]).normal[0]
    h = 1e-4

    def difference_energy(a, b):
        """Weighted |r(a) - r(b)|^2, by making the simulation at b the record."""
        own = PREPARED.drives
        car = space.car(b, START)
        simulated = accelerations_of(car, own)
        drives = own._replace(a_s=simulated[0] * own.count_s, a_u=simulated[1] * own.count_u)
        sums = squares(a[None], TASK._replace(drives=drives))
        counts = np.stack([np.asarray(c).sum((1, 2)) for c in (own.count_s, own.count_u)], 1)
        return float(np.sum(np.asarray(sums[0]) * counts * np.asarray(TASK.weight)))

    accelerations_of = _compiled_accelerations()
    squares = jax.jit(lambda f, task: mean_squares(f, task, space))
    basis = np.eye(2)
    for i in range(2):
        for j in range(2):
            plus, minus = basis[i] + basis[j], basis[i] - basis[j]
            expected = (
                0.25
                * (
                    difference_energy(free + h * plus, free - h * plus)
                    - difference_energy(free + h * minus, free - h * minus)
                )
                / (2 * h) ** 2
            )
            assert float(found[i, j]) == pytest.approx(expected, rel=1e-5)


def test_many_candidates_are_each_candidate_alone():
    space = search_space()
    free = jnp.asarray(space.free(START))[None] + 0.1 * jnp.arange(3.0)[:, None]
    compiled = jax.jit(lambda f: evaluate(f, TASK, space))
    together = compiled(free)
    alone = [compiled(free[k : k + 1]) for k in range(3)]
    for field in ("loss", "gradient", "normal"):
        each = np.concatenate([getattr(a, field) for a in alone])
        np.testing.assert_allclose(getattr(together, field), each, rtol=1e-11, atol=1e-14)


def test_a_record_counts_the_same_beside_a_longer_one():
    """Padding adds nothing, and every record has the same say whatever its length and rate."""
    space = search_space()
    free = jnp.asarray(space.free(START))[None]
    several = [*RECORDS, record(3, 15.0, 180e3, 3.1, rate=800.0)]
    alone = [prepare([r]) for r in several]
    each = [mean_squares(free, task_of(START, p.drives), space)[0, 0] for p in alone]
    prepared = prepare(several)
    together = mean_squares(free, task_of(START, prepared.drives), space)[0]
    np.testing.assert_allclose(together, np.stack(each), rtol=1e-12)


def test_a_candidate_that_leaves_the_finite_numbers_is_told_from_the_others():
    space = search_space(("suspension.damping", "unsprung_mass"))
    free = jnp.asarray([[30.0, -30.0], *np.asarray(space.free(START))[None]])
    found = evaluate(free, TASK, space)
    assert float(found.loss[0]) >= 1e12
    assert float(found.loss[1]) < 1.0
    assert np.all(np.isfinite(found.gradient))
    assert np.all(np.asarray(found.gradient[0]) == 0)


def test_float32_gives_the_float64_loss(float32):
    prepared = prepare(RECORDS)
    task = task_of(START, prepared.drives)
    assert task.weight.dtype == jnp.float32
    space = search_space()
    free = space.free(START)[None]
    found = jax.jit(lambda f: evaluate(f, task, space))(jnp.asarray(free, jnp.float32))
    assert found.gradient.dtype == jnp.float32
    with jax.enable_x64(True):
        exact = jax.jit(lambda f: evaluate(f, TASK, space))(jnp.asarray(free))
    assert float(found.loss[0]) == pytest.approx(float(exact.loss[0]), rel=1e-4)
    scale = float(np.abs(exact.gradient).max())
    np.testing.assert_allclose(found.gradient, exact.gradient, atol=1e-3 * scale)


def _compiled_accelerations():
    """A function of car and drives: a_s and a_u of all steps, [records, blocks, steps]."""

    def one(car, drive):
        def sample(x, now):
            rise, slopes, pressure = now
            x, a = step(x, car, pressure, rise, slopes, drive.dt)
            return x, (a.a_s, a.a_u)

        inputs = jax.tree.map(jnp.ravel, inputs_of(drive)[:3])
        zero = jnp.zeros_like(drive.dt)
        _, out = jax.lax.scan(sample, RelativeState(zero, zero, zero, zero), inputs)
        return tuple(o.reshape(drive.rise.shape) for o in out)

    return jax.jit(jax.vmap(one, in_axes=(None, 0)))
