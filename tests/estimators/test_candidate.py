"""The interface of the stiffness filters that are compared, and the paper's two behind it."""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles import brancati_numpy as paper
from wheelhop.errors import DivergenceError, InputError
from wheelhop.estimators import immuf
from wheelhop.estimators.candidate import (
    Candidate,
    Knob,
    Reading,
    Records,
    checked_tuning,
    constant_track,
    draw,
    starter,
    track,
)
from wheelhop.estimators.candidates import (
    PRIOR_PRESSURE,
    class_a_corrected,
    class_a_printed,
    corrected,
    printed,
)
from wheelhop.estimators.printed import NONE_OF_THEM, Misprints
from wheelhop.filtering import StateSpaceModel, batch, independent, unscented
from wheelhop.vehicle.parameters import BRANCATI_TABLE_3, brancati_suv, with_suspension
from wheelhop.vehicle.quarter_car import Accelerations

# a filter of one state, for what concerns every candidate


class Stiffness(NamedTuple):
    k_t: Any


class Params(NamedTuple):
    growth: Any
    bias: Any
    walk: Any
    noise: Any


def scalar_prior(tuning, setting, normal):
    return independent(Stiffness(setting + tuning["p0"] * normal[0]), Stiffness(tuning["p0"]))


def scalar_params(tuning, setting):
    zero = jnp.zeros_like(setting)
    return Params(zero + 1.0, zero, tuning["walk"], tuning["noise"])


def scalar_inputs(key, speed, setting):
    del setting
    return speed, 0.1 * jax.random.normal(key, speed.shape, speed.dtype)


def scalar_bind(params, inputs):
    return params._replace(growth=inputs[0], bias=inputs[1])


def scalar_read(belief):
    k_t = belief.mean.k_t
    return Reading(k_t, jnp.sqrt(belief.cov[0][0]), jnp.ones_like(k_t)[None], k_t[None])


SCALAR = Candidate(
    "scalar",
    ("only",),
    {"p0": Knob(2.0, "N/m", "P0"), "walk": Knob(0.3, "N/m", "Q"), "noise": Knob(0.5, "-", "R")},
    unscented(
        StateSpaceModel(
            lambda x, p: Stiffness(p.growth * x.k_t + p.bias),
            lambda x, p: Accelerations(x.k_t, 2.0 * x.k_t),
            lambda x, p: ((p.walk**2,),),
            lambda p: ((p.noise**2,), (0.0, p.noise**2)),
        )
    ),
    np.float64(5.0),
    scalar_prior,
    scalar_params,
    scalar_inputs,
    scalar_bind,
    scalar_read,
    states=1,
)

RUNS, TIME = 6, 13


def scalar_records():
    rng = np.random.default_rng(0)
    measured = Accelerations(*(rng.normal(5.0 * c, 1.0, (RUNS, TIME)) for c in (1, 2)))
    return Records(measured, rng.uniform(0.9, 1.1, (RUNS, TIME)), 0.01)


def keys(runs=RUNS, seed=0):
    return jax.random.split(jax.random.key(seed), runs)


def scalar_by_hand(records, run, key, p0=2.0, walk=0.3, noise=0.5, spread=1.0):
    """A Kalman filter in plain numbers."""
    first, second = jax.random.split(key)
    offset = float(jax.random.normal(first, (1,))[0])
    bias = 0.1 * np.asarray(jax.random.normal(second, (TIME,)))
    mean, var, found = 5.0 + p0 * spread * offset, p0**2, []
    for k in range(TIME):
        growth = records.speed[run, k]
        mean, var = growth * mean + bias[k], growth**2 * var + walk**2
        y = records.measured.a_s[run, k], records.measured.a_u[run, k]
        precision = 1 / var + (1 + 4) / noise**2
        mean = (mean / var + (y[0] + 2 * y[1]) / noise**2) / precision
        var = 1 / precision
        found.append((mean, var**0.5))
    return np.array(found).T


@pytest.mark.parametrize("spread", [1.0, 0.0, 3.0])
def test_track_is_the_filter_driven_by_hand(spread):
    records = scalar_records()
    found = track(SCALAR, records, keys(), spread=spread)
    for run in range(RUNS):
        mean, sigma = scalar_by_hand(records, run, keys()[run], spread=spread)
        np.testing.assert_allclose(found.stiffness[run], mean, rtol=1e-12)
        np.testing.assert_allclose(found.sigma[run], sigma, rtol=1e-12)
        np.testing.assert_allclose(found.mode_stiffness[run, :, 0], mean, rtol=1e-12)
    assert found.probabilities.shape == (RUNS, TIME, 1)


def test_tuning_reaches_the_filter():
    records, tuning = scalar_records(), {"p0": 0.7, "walk": 0.1, "noise": 1.3}
    found = track(SCALAR, records, keys(), tuning)
    mean, sigma = scalar_by_hand(records, 2, keys()[2], **tuning)
    np.testing.assert_allclose(found.stiffness[2], mean, rtol=1e-12)
    np.testing.assert_allclose(found.sigma[2], sigma, rtol=1e-12)


def test_a_run_depends_on_its_own_key_alone():
    """Not on the order of the runs, nor on how many there are."""
    records, some = scalar_records(), np.array([4, 1, 3])
    whole, part = track(SCALAR, records, keys()), track(SCALAR, records.part(some), keys()[some])
    assert len(records.part(some)) == 3
    np.testing.assert_allclose(part.stiffness, whole.stiffness[some], rtol=1e-13)
    order = np.random.default_rng(1).permutation(RUNS)
    mixed = track(SCALAR, records.part(order), keys()[order])
    np.testing.assert_array_equal(mixed.stiffness, whole.stiffness[order])
    (normal, inputs), (alone, own) = (
        draw(SCALAR, r, k) for r, k in ((records, keys()), (records.part(some), keys()[some]))
    )
    np.testing.assert_array_equal(normal[some], alone)
    np.testing.assert_array_equal(inputs[1][some], own[1])
    assert len(np.unique(normal)) == RUNS


def test_the_same_seed_gives_the_same_bits():
    first, again = (track(SCALAR, scalar_records(), keys(seed=5)) for _ in range(2))
    other = track(SCALAR, scalar_records(), keys(seed=6))
    for mine, theirs in zip(first, again, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert not np.array_equal(first.stiffness, other.stiffness)


@pytest.mark.parametrize(("stride", "first"), [(1, 0), (4, 0), (5, 2), (13, 12), (20, 12)])
def test_stride_keeps_the_last_sample(stride, first):
    records = scalar_records()
    every, some = (track(SCALAR, records, keys(), stride=s) for s in (1, stride))
    for mine, theirs in zip(some, every, strict=True):
        np.testing.assert_array_equal(mine, theirs[:, first::stride])
        np.testing.assert_array_equal(mine[:, -1], theirs[:, -1])


def test_stride_below_one_is_refused():
    with pytest.raises(InputError, match="stride: 0"):
        track(SCALAR, scalar_records(), keys(), stride=0)


@pytest.mark.parametrize(
    ("tuning", "message"),
    [
        ({"walkk": 1.0}, r"tuning: 'walkk' is no knob of scalar. Use \['p0', 'walk', 'noise'\]"),
        ({"p0": 1.0, "walk": 0.3}, r"tuning: 'noise' is missing. Give it, for instance 0.5 -"),
        ({"p0": 0.0, "walk": 0.3, "noise": 1.0}, r"tuning\.p0: 0\. Give a positive number"),
        ({"p0": 1.0, "walk": -0.3, "noise": 1.0}, r"tuning\.walk: -0\.3"),
        ({"p0": 1.0, "walk": np.nan, "noise": 1.0}, r"tuning\.walk: nan"),
        ({"p0": 1.0, "walk": 0.3, "noise": np.inf}, r"tuning\.noise: inf"),
    ],
)
def test_tuning_that_does_not_fit_is_named(tuning, message):
    with pytest.raises(InputError, match=message):
        track(SCALAR, scalar_records(), keys(), tuning)


def test_default_tuning_is_where_the_knobs_start():
    assert checked_tuning(SCALAR, None) == {"p0": 2.0, "walk": 0.3, "noise": 0.5}
    other = {"noise": 3, "p0": 1, "walk": 2}
    assert checked_tuning(SCALAR, other) == other


def test_divergence_names_the_run():
    records = scalar_records()
    speed = records.speed.copy()
    speed[3] = 1e200
    with pytest.raises(DivergenceError, match=r"scalar: 1 of 6 runs .* the first is run 3"):
        track(SCALAR, replace(records, speed=speed), keys())
    found = track(SCALAR, replace(records, speed=speed), keys(), check=False)
    np.testing.assert_array_equal(np.isfinite(found.stiffness[:, -1]), np.arange(RUNS) != 3)


def test_constant_track_says_the_prior_at_every_time():
    found = constant_track(2e5, 3e4, runs=2, samples=4)
    np.testing.assert_array_equal(found.stiffness, np.full((2, 4), 2e5))
    np.testing.assert_array_equal(found.sigma, np.full((2, 4), 3e4))
    np.testing.assert_array_equal(found.probabilities, np.ones((2, 4, 1)))
    np.testing.assert_array_equal(found.mode_stiffness, np.full((2, 4, 1), 2e5))


# the paper's filter and the corrected one

DT = 0.002
CARS = {c: with_suspension(brancati_suv(), BRANCATI_TABLE_3[c]) for c in "ABCD"}


@pytest.fixture(scope="module", autouse=True)
def quickly_compiled():
    """`run_batch` compiled several times faster, to run slower, where the options exist."""
    options = {
        "xla_backend_optimization_level": 0,
        "xla_cpu_use_fusion_emitters": False,
        "xla_disable_hlo_passes": "none",
    }
    try:
        jax.jit(jnp.negative, compiler_options=options)(1.0)
    except Exception:
        options = {}
    patch = pytest.MonkeyPatch()
    patch.setattr(batch, "staged_jit", lambda f: jax.jit(f, compiler_options=options))
    yield
    patch.undo()
    batch._compiled.cache_clear()


@pytest.fixture(scope="module")
def short():
    rng = np.random.default_rng(0)
    measured = Accelerations(rng.normal(size=(2, 16)), 3.0 * rng.normal(size=(2, 16)))
    return Records(measured, rng.uniform(10.0, 20.0, (2, 16)), DT)


def test_printed_candidate_is_eq_9_to_19_in_lanes(short):
    candidate = printed(CARS, DT, misprints=Misprints())
    found = track(candidate, short, keys(2))
    normals, roads = jax.tree.map(np.asarray, draw(candidate, short, keys(2)))
    tune = candidate.default
    tire = CARS["A"].tire
    k_t = paper.stiffness(
        PRIOR_PRESSURE, tire.stiffness, tire.nominal_pressure, tire.pressure_coefficient
    )
    per_pascal = tire.stiffness * tire.pressure_coefficient / tire.nominal_pressure
    sigma = [tune[f"p0_{name}"] for name in ("z_s", "z_u", "v_s", "v_u", "pressure")]
    sigma = np.array(sigma) * [1, 1, 1, 1, per_pascal]
    cars = [
        {
            "m_s": car.sprung_mass,
            "m_u": car.unsprung_mass,
            "k_s": car.suspension.stiffness,
            "k_nl": car.suspension.cubic_stiffness,
            "c_s": car.suspension.damping,
            "c_nl": car.suspension.quadratic_damping,
        }
        for car in CARS.values()
    ]
    q = [tune[f"q_{i}"] for i in range(1, 6)]
    kept = dict.fromkeys(
        ("damping", "prediction", "weights", "spread", "determinant", "sensors"), True
    )
    for run in range(2):
        np.testing.assert_array_equal(roads.before[run, 1:], roads.now[run, :-1])
        mean, cov, mu, means, _ = paper.immuf(
            np.stack(short.measured, axis=-1)[run],
            np.array([0, 0, 0, 0, k_t]) + sigma * normals[run],
            np.diag(sigma**2),
            cars,
            np.concatenate([roads.before[run, :1], roads.now[run]]),
            paper.markov(4),
            q,
            (0.5, 0.5),
            DT,
            kept,
        )
        np.testing.assert_allclose(found.stiffness[run], mean[:, 4], rtol=1e-9)
        np.testing.assert_allclose(found.sigma[run], np.sqrt(cov[:, 4, 4]), rtol=1e-9)
        np.testing.assert_allclose(found.probabilities[run], mu, atol=1e-9)
        np.testing.assert_allclose(found.mode_stiffness[run], means[:, :, 4], rtol=1e-9)


def test_printed_roads_have_the_levels_of_eq_7():
    expected = [4 * paper.class_level(a) for a in range(4)]
    np.testing.assert_allclose(printed(CARS, DT).setting.roads, expected, rtol=1e-14)
    ratio = printed(CARS, DT, convention="iso8608").setting.roads / np.array(expected)
    np.testing.assert_allclose(ratio, np.pi * (1 + 0.127**2) / (2 * 0.127) / 4, rtol=1e-12)
    assert printed(CARS, DT, misprints=NONE_OF_THEM).filter != printed(CARS, DT).filter


def test_corrected_candidate_has_the_parameters_of_the_corrected_filter(short):
    for convention in ("iso8608", "brancati2022"):
        candidate = corrected(CARS, DT, convention=convention)
        tuning = candidate.default | {"road_gain": 1.0, "wheel_walk": 0.7}
        walks = (tuning["stiffness_walk"], tuning["velocity_walk"])
        expected = immuf.immuf_params(
            list(CARS.values()),
            1.0,
            DT,
            immuf.Tuning(0.5, 0.5, *walks, wheel_walk=0.7),
            convention=convention,
        )
        found = candidate.params(tuning, candidate.setting)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-12), found, expected)
        rougher = candidate.params(tuning | {"road_gain": 4.0}, candidate.setting)
        np.testing.assert_allclose(
            rougher.members.road_level[:-1], expected.members.road_level[1:], rtol=1e-12
        )


def test_corrected_candidate_tracks(short):
    candidate = corrected(CARS, DT)
    found = track(candidate, short, keys(2), spread=0.0)
    assert candidate.modes == tuple("ABCD")
    assert found.mode_stiffness.shape == found.probabilities.shape == (2, 16, 4)
    np.testing.assert_allclose(found.probabilities.sum(axis=-1), 1.0, atol=1e-12)
    assert np.all((found.sigma > 0) & (found.sigma < 1e5))
    # the first samples say little: the estimate is the prior's, which no run starts away from
    tire = CARS["A"].tire
    law = tire.stiffness, tire.nominal_pressure, tire.pressure_coefficient
    np.testing.assert_allclose(found.stiffness[:, 0], paper.stiffness(180e3, *law), rtol=1e-2)
    moved = track(candidate, short, keys(2))
    normal = np.asarray(draw(candidate, short, keys(2))[0])[:, 4]
    away = (moved.stiffness - found.stiffness)[:, 0]
    assert np.all(np.sign(away) == np.sign(normal))


@pytest.mark.parametrize("make", [class_a_printed, class_a_corrected])
def test_a_single_class_is_the_same_filter_with_one_mode(make, short):
    candidate = make(CARS, DT, "iso8608")
    assert candidate.modes == ("A",)
    params = candidate.params(candidate.default, candidate.setting)
    np.testing.assert_array_equal(params.transition, [[1.0]])
    np.testing.assert_array_equal(params.initial, [1.0])

    def step(normal, inputs):
        start = starter(candidate.filter, candidate.prior, candidate.params)
        states, params = start(candidate.default, candidate.setting, normal)
        state, inputs = jax.tree.map(lambda a: a[0], (states, inputs))
        y = jax.tree.map(lambda a: jnp.asarray(a[0, 0]), short.measured)
        bound = candidate.bind(params, jax.tree.map(lambda a: a[0], inputs))
        return candidate.read(candidate.filter.step(state, y, bound)[0])

    reading = jax.eval_shape(lambda: step(*draw(candidate, short, keys(2))))
    assert reading.stiffness.shape == reading.sigma.shape == ()
    assert reading.probabilities.shape == reading.mode_stiffness.shape == (1,)
