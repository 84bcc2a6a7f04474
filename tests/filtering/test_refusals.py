"""What is silently wrong elsewhere is refused here, by name."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from models import COV, MEAN, Sensors, Track, linear_model, sample

from wheelhop.filtering import (
    InteractingParams,
    StateSpaceModel,
    dense,
    drive,
    extended,
    gated,
    gaussian,
    independent,
    interacting,
    run_batch,
    square_root_unscented,
    unscented,
)


class Plane(NamedTuple):
    x: Any
    y: Any


class Distance(NamedTuple):
    r: Any


def distances(distance, move=lambda x: x):
    return StateSpaceModel(
        lambda x, p: move(x),
        lambda x, p: Distance(distance(x)),
        lambda x, p: ((p,), (0.0, p)),
        lambda p: ((0.1,),),
    )


def stacked_norm(x):
    return jnp.linalg.norm(jnp.stack([x.x, x.y]))


def stacked_norm_over_components(x):
    return jnp.linalg.norm(jnp.stack([x.x, x.y]), axis=0)


PRIOR = independent(Plane(1.0, 2.0), Plane(0.3, 0.4))
YS = Distance(jnp.array([[2.0, 2.1, 2.2], [2.4, 2.2, 2.1]]))
P = jnp.asarray(0.01)


@pytest.mark.parametrize("make", [extended, unscented, square_root_unscented])
def test_a_norm_over_components_is_right_for_one_run_and_refused_or_right_in_lanes(make):
    plain = make(distances(lambda x: jnp.sqrt(x.x**2 + x.y**2)))
    whole, by_axis = make(distances(stacked_norm)), make(distances(stacked_norm_over_components))

    def likelihoods(filter):
        start = filter.init(PRIOR, P)
        return jax.vmap(lambda y: drive.run(filter, start, y, P).info.log_likelihood)(YS)

    expected = likelihoods(plain)
    np.testing.assert_allclose(likelihoods(whole), expected, rtol=1e-12)
    found = run_batch(by_axis, by_axis.init(PRIOR, P), YS, P, keep=lambda s, i: i.log_likelihood)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    with pytest.raises(ValueError, match="the model's observation mixes runs by `reduce_sum`"):
        run_batch(whole, whole.init(PRIOR, P), YS, P)


def test_a_normalisation_that_mixes_runs_is_found_in_the_transition():
    def normalise(x):
        return Plane(x.x / stacked_norm(x), x.y / stacked_norm(x))

    filter = unscented(distances(lambda x: x.x, normalise))
    with pytest.raises(ValueError, match="the model's transition mixes runs"):
        run_batch(filter, filter.init(PRIOR, P), YS, P)


def test_matrices_of_parameters_may_meet_stacked_components():
    matrix = np.array([[1.0, 0.1], [0.0, 0.9]])

    def move(x):
        return Plane(*(jnp.asarray(matrix) @ jnp.stack([x.x, x.y])))

    filter = unscented(distances(lambda x: jnp.hypot(x.x, x.y), move))
    found = run_batch(filter, filter.init(PRIOR, P), YS, P)  # two runs, two components
    expected = jax.vmap(lambda y: drive.run(filter, PRIOR, y, P))(YS)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


FILTER = unscented(linear_model())
START = gaussian(Track(*MEAN), jnp.asarray(COV))


def records(runs, steps):
    ys = np.stack([sample(k, steps)[1] for k in range(runs)])
    return Sensors(jnp.asarray(ys[..., 0]), jnp.asarray(ys[..., 1]))


@pytest.mark.parametrize(
    "keep",
    [lambda s, i: dense(s)[0], lambda s, i: jnp.linalg.norm(jnp.stack(s.mean)), lambda s, i: 1.0],
    ids=["components last", "norm", "constant"],
)
def test_a_kept_result_without_runs_last_is_refused_whatever_the_lengths(keep):
    with pytest.raises(ValueError, match="does not have the runs last"):
        run_batch(FILTER, START, records(3, 3), 1.0, keep=lambda s, i: jnp.asarray(keep(s, i)))


def test_a_forgotten_run_axis_is_refused():
    one = jax.tree.map(lambda a: a[0], records(1, 10))
    with pytest.raises(ValueError, match="no time axis"):
        run_batch(FILTER, START, one, 1.0)
    starts = jax.tree.map(lambda a: jnp.stack([a, a, a]), START)
    with pytest.raises(ValueError, match=r"not one of scalars|could not be broadcast"):
        run_batch(FILTER, starts, records(3, 5), 1.0)
    with pytest.raises(ValueError, match=r"not one of scalars|could not be broadcast"):
        run_batch(FILTER, START, records(3, 5), jnp.ones(3))


@pytest.mark.parametrize(
    ("pz", "initial", "says"),
    [
        ([[1.0, 1.0], [1.0, 1.0]], [0.5, 0.5], "transition"),
        ([[0.9, 0.2], [0.1, 0.8]], [0.5, 0.5], "transition"),
        ([[1.1, -0.1], [0.1, 0.9]], [0.5, 0.5], "transition"),
        ([[0.9, 0.1], [0.1, np.nan]], [0.5, 0.5], "transition"),
        ([[0.9, 0.1], [0.1, 0.9]], [5.0, 5.0], "initial"),
        ([[0.9, 0.1], [0.1, 0.9]], [1.5, -0.5], "initial"),
    ],
)
def test_what_is_no_probability_is_refused(pz, initial, says):
    params = InteractingParams(jnp.ones(2), jnp.array(pz), jnp.array(initial))
    with pytest.raises(ValueError, match=f"{says}=.*does not hold probabilities"):
        interacting(FILTER).init(START, params)


@pytest.mark.parametrize("bad", [np.nan, -0.1])
def test_a_probability_that_turns_bad_later_is_flagged(bad):
    imm = interacting(FILTER)
    params = InteractingParams(jnp.ones(2), jnp.eye(2), jnp.array([0.5, 0.5]))
    pz = jnp.array([np.eye(2), [[1.0 - bad, bad], [0.0, 1.0]], np.eye(2)])
    run = drive.run(
        imm,
        imm.init(START, params),
        jax.tree.map(lambda a: a[0], records(1, 3)),
        params,
        inputs=pz,
        bind=lambda p, now: InteractingParams(p.members, now, p.initial),
    )
    assert run.info.flags.nonfinite.tolist() == [False, True, True]


class Swapped(NamedTuple):
    b: Any
    a: Any


def test_names_in_another_order_are_refused():
    with pytest.raises(ValueError, match=r"the measurement has the components \('b', 'a'\)"):
        FILTER.step(START, Swapped(jnp.ones(()), jnp.ones(())), 1.0)
    turned = distances(lambda x: x.x, lambda x: Swapped(x.x, x.y))
    for make in (extended, unscented, square_root_unscented):
        filter = make(turned)
        with pytest.raises(ValueError, match="the transition's result has the components"):
            filter.step(filter.init(PRIOR, P), Distance(jnp.ones(())), P)


def test_impossible_covariances_are_refused():
    mean = Plane(0.0, 0.0)
    with pytest.raises(ValueError, match=r"shape \(3, 2\)"):
        gaussian(mean, jnp.ones((3, 2)))
    with pytest.raises(ValueError, match="not symmetric"):
        gaussian(mean, jnp.array([[1.0, 0.5], [0.2, 1.0]]))
    for bad in (-4.0, np.nan):
        with pytest.raises(ValueError, match=r"cov\[1\]\[1\]=.* is no variance"):
            gaussian(mean, jnp.array([[1.0, 0.0], [0.0, bad]]))


def test_no_noise_at_all_is_no_infinite_likelihood():
    sure = StateSpaceModel(
        lambda x, p: x, lambda x, p: Distance(x.x), lambda x, p: ((p,), (p, p)), lambda p: ((p,),)
    )
    nothing = independent(Plane(1.0, 2.0), Plane(0.0, 0.0))
    _, info = extended(sure).step(nothing, Distance(jnp.asarray(1.0)), jnp.asarray(0.0))
    assert np.isnan(info.log_likelihood)
    assert bool(info.flags.nonfinite)


def test_updates_that_cannot_go_together_are_refused():
    with pytest.raises(ValueError, match="judge the sample anew"):
        extended(linear_model(), iterations=3, measurement_update=gated(0.99))
    filter = square_root_unscented(linear_model(), measurement_update=lambda *a: (START, None))
    with pytest.raises(ValueError, match="not a SquareRootGaussian"):
        filter.step(filter.init(START, 1.0), Sensors(jnp.ones(()), jnp.ones(())), 1.0)
