"""The printed filter against the paper's equations in NumPy, and what each misprint does."""

from dataclasses import fields, replace
from functools import lru_cache
from operator import itemgetter
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2

from tests.oracles import brancati_numpy as paper
from wheelhop.estimators.printed import (
    NONE_OF_THEM,
    AbsoluteCorner,
    ArtificialRoad,
    Misprints,
    PrintedParams,
    artificial_roads,
    bind_road,
    printed_immuf,
    printed_model,
    printed_params,
)
from wheelhop.estimators.printed_interacting import (
    PrintedForms,
    mixed_states,
    printed_interacting,
    printed_mixing,
    without_root,
)
from wheelhop.filtering import (
    Gaussian,
    InteractingParams,
    StateSpaceModel,
    drive,
    independent,
    smallmat,
    unscented,
)
from wheelhop.filtering.interacting import correct
from wheelhop.filtering.interface import Flags, Info
from wheelhop.vehicle.parameters import (
    BRANCATI_TABLE_3,
    QuarterCar,
    VehicleTable,
    brancati_suv,
    corner_sprung_mass,
    with_suspension,
)
from wheelhop.vehicle.quarter_car import Accelerations
from wheelhop.vehicle.road import class_level, shape_filter_psd
from wheelhop.vehicle.road.shape_filter import CUTOFF
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import Tire, stiffness_from_pressure

SWITCHES = tuple(f.name for f in fields(Misprints))
LITERAL, RESOLVED = Misprints(), NONE_OF_THEM
SINGLE = {name: Misprints(**{n: n == name for n in SWITCHES}) for name in SWITCHES}
FORMS = {"literal": LITERAL, "resolved": RESOLVED} | SINGLE

RUNS, TIME, DT, SPEED = 48, 30, 0.002, 15.0
NOISE = 0.5
Q = np.array([1e-5, 1e-4, 3e-3, 3e-2, 90.0]) ** 2 / DT**3
MEAN = np.array([0.0, 0.0, 0.0, 0.0, 212.8e3])
SIGMA = np.array([0.005, 0.005, 0.05, 0.2, 10e3])
PZ = np.array(
    [
        [0.90, 0.05, 0.04, 0.01],
        [0.02, 0.93, 0.04, 0.01],
        [0.01, 0.04, 0.90, 0.05],
        [0.03, 0.03, 0.02, 0.92],
    ]
)
"""Not symmetric, so that rows and columns cannot be confused."""

CARS = [with_suspension(brancati_suv(), BRANCATI_TABLE_3[c]) for c in "ABCD"]


class Level(NamedTuple):
    height: Any


def quickly(function):
    """`jax.jit` that compiles several times faster, and runs slower, where the options exist."""
    return jax.jit(function, compiler_options=quick_options())


@lru_cache(maxsize=1)
def quick_options():
    options = {
        "xla_backend_optimization_level": 0,
        "xla_cpu_use_fusion_emitters": False,
        "xla_disable_hlo_passes": "none",
    }
    try:
        jax.jit(jnp.negative, compiler_options=options)(1.0)
    except Exception:
        return {}
    return options


def numbers(car):
    s = car.suspension
    springs = {"k_s": s.stiffness, "k_nl": s.cubic_stiffness}
    dampers = {"c_s": s.damping, "c_nl": s.quadratic_damping}
    return {"m_s": car.sprung_mass, "m_u": car.unsprung_mass} | springs | dampers


def random_car(rng):
    low, high = np.array([200.0, 30.0, 2e4, 5e4, 1e3, 300.0]), 2.0
    m_s, m_u, *suspension = low * rng.uniform(1.0, high, 6)
    tire = Tire(rng.uniform(2e5, 3e5), rng.uniform(2e5, 3e5), rng.uniform(0.5, 0.9))
    return QuarterCar(m_s, m_u, Suspension(*suspension), tire)


def random_states(rng, count=200):
    scale = [0.03, 0.03, 0.5, 1.0]
    motion = rng.normal(size=(count, 4)) * scale
    return np.column_stack([motion, rng.uniform(1e5, 4e5, count)])


def random_cov(rng, size, scale=None):
    root = rng.normal(size=(size, size))
    scale = np.ones(size) if scale is None else scale
    return (root @ root.T + 0.3 * np.eye(size)) * np.outer(scale, scale)


def columns(array, names):
    return names(*(jnp.asarray(c) for c in np.moveaxis(array, -1, 0)))


def stacked(cars):
    return jax.tree.map(lambda *a: jnp.asarray(np.stack(a), float), *cars)


def dense_cov(cov):
    return np.asarray(smallmat.to_dense(cov))


# Eq. 1 to 7 and 15 to 19, one by one


@pytest.mark.parametrize("seed", range(3))
def test_masses_and_stiffness_are_eq_2_to_4(seed):
    rng = np.random.default_rng(seed)
    chassis, load, front, rear = rng.uniform([1e3, 0, 1, 1], [2e3, 500, 2, 2])
    table = VehicleTable(chassis_mass=chassis, front_semi_wheelbase=front, rear_semi_wheelbase=rear)
    expected = paper.sprung_mass(chassis, load, rear, front + rear)
    assert corner_sprung_mass(table, "front", load) == pytest.approx(expected, rel=1e-12)
    tire, pressure = random_car(rng).tire, rng.uniform(1e5, 3e5)
    law = (tire.stiffness, tire.nominal_pressure, tire.pressure_coefficient)
    expected = paper.stiffness(pressure, *law)
    assert stiffness_from_pressure(pressure, tire) == pytest.approx(expected, rel=1e-12)


def test_spectrum_is_eq_5_and_levels_are_eq_7():
    rng = np.random.default_rng(0)
    for a, road_class in enumerate("ABCDEFGH"):
        assert class_level(road_class) == pytest.approx(paper.class_level(a), rel=1e-14)
        v, alpha, variance, wavenumber = rng.uniform(0.1, 20.0, 4)
        # densities over omega = v W and over W hold the same variance
        expected = v * paper.road_psd(v * wavenumber, alpha, v, variance)
        found = shape_filter_psd(wavenumber, variance, alpha)
        assert found == pytest.approx(expected, rel=1e-12)


def test_eq_6_between_samples_has_the_spectrum_of_eq_5():
    """Covariances over lags of a road are the cosine transform of its one-sided spectrum."""
    v, variance, lags = 15.0, 3e-5, 6
    drawn = [
        paper.road(unit, CUTOFF, np.full(lags, v), 0.05, variance) for unit in np.eye(lags + 1)
    ]
    cov = np.array(drawn).T @ np.array(drawn)
    for lag in range(1, lags + 1):
        expected, _ = quad(
            lambda omega: paper.road_psd(omega, CUTOFF, v, variance) / variance,
            *(0, np.inf),
            weight="cos",
            wvar=0.05 * lag,
        )
        assert cov[0, lag] == pytest.approx(variance * expected, rel=1e-6)
        assert cov[lag, lag] == pytest.approx(variance, rel=1e-12)


def test_artificial_roads_are_eq_6_at_any_speed():
    rng = np.random.default_rng(0)
    speed, variances = rng.uniform(5.0, 25.0, 40), np.array([4e-6, 1.6e-5, 6.4e-5])
    key = jax.random.key(3)
    road = quickly(artificial_roads)(key, jnp.asarray(speed), DT, jnp.asarray(variances))
    assert road.before.shape == road.now.shape == (40, 3)
    for mode, mode_key in enumerate(jax.random.split(key, 3)):
        normals = np.asarray(jax.random.normal(mode_key, (41,)))
        expected = paper.road(normals, CUTOFF, speed, DT, variances[mode])
        np.testing.assert_allclose(road.before[:, mode], expected[:-1], rtol=1e-10)
        np.testing.assert_allclose(road.now[:, mode], expected[1:], rtol=1e-10)


def member(car, road=(0.0, 0.0), q=Q, noise=(NOISE, NOISE)):
    return PrintedParams(car, ArtificialRoad(*road), DT, AbsoluteCorner(*q), *noise)


@pytest.mark.parametrize("same_sign", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_model_is_eq_1_15_and_16(seed, same_sign):
    rng = np.random.default_rng(seed)
    car, states, roads = random_car(rng), random_states(rng), 0.02 * rng.normal(size=(2, 200))
    model = printed_model(Misprints(damping=same_sign))
    params = member(car, tuple(jnp.asarray(r) for r in roads))
    x = columns(states, AbsoluteCorner)
    after = np.stack(model.transition(x, params), axis=-1)
    measured = np.stack(model.observation(x, params), axis=-1)
    for k, state in enumerate(states):
        expected = paper.transition(state, roads[0, k], DT, numbers(car), same_sign)
        np.testing.assert_allclose(after[k], expected, rtol=1e-10)
        expected = paper.observation(state, roads[1, k], numbers(car), same_sign)
        np.testing.assert_allclose(measured[k], expected, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_noises_are_eq_17_to_19(seed):
    rng = np.random.default_rng(seed)
    q, sigmas = rng.uniform(0.1, 1e6, 5), rng.uniform(0.1, 3.0, 2)
    params, x = member(random_car(rng), q=q, noise=sigmas), AbsoluteCorner(*MEAN)
    for kept in (True, False):
        model = printed_model(Misprints(sensors=kept))
        found = dense_cov(jax.tree.map(jnp.asarray, model.observation_cov(params)))
        np.testing.assert_allclose(found, paper.sensor_cov(*sigmas, kept), rtol=1e-14)
        found = dense_cov(jax.tree.map(jnp.asarray, model.process_cov(x, params)))
        np.testing.assert_allclose(found, paper.process_cov(q, DT), rtol=1e-14)
    stay = rng.uniform(0.5, 0.99)
    found = printed_params(stacked(CARS), DT, AbsoluteCorner(*Q), stay=stay)
    np.testing.assert_allclose(found.transition, paper.markov(4, stay), rtol=1e-14)
    np.testing.assert_allclose(found.initial, 0.25)


# Eq. 9 to 12, one by one


def random_modes(rng):
    mu, pz = rng.dirichlet(np.ones(4)), rng.dirichlet(np.ones(4), size=4)
    means = random_states(rng, 4)
    covs = [random_cov(rng, 5, SIGMA) for _ in range(4)]
    return mu, pz, means, covs


def as_members(means, covs):
    entry = np.array(covs)
    cov = tuple(tuple(jnp.asarray(entry[:, i, j]) for j in range(i + 1)) for i in range(5))
    return Gaussian(columns(means, AbsoluteCorner), cov)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("prediction", [True, False])
@pytest.mark.parametrize("weights", [True, False])
def test_prediction_and_weights_are_eq_9_and_10(seed, prediction, weights):
    mu, pz, _, _ = random_modes(np.random.default_rng(seed))
    found = printed_mixing(jnp.asarray(mu), jnp.asarray(pz), PrintedForms(prediction, weights))
    predicted = paper.predict_modes(mu, pz, prediction)
    np.testing.assert_allclose(found[0], predicted, rtol=1e-12)
    expected = paper.mixing_weights(mu, predicted, pz, weights)
    np.testing.assert_allclose(found[1].T, expected, rtol=1e-12)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("spread", [True, False])
def test_mixed_states_are_eq_10_and_11(seed, spread):
    rng = np.random.default_rng(seed)
    _, _, means, covs = random_modes(rng)
    weights = rng.uniform(size=(4, 4))
    found = mixed_states(jnp.asarray(weights.T), as_members(means, covs), spread=not spread)
    mean, cov = paper.mix(weights, means, covs, spread)
    np.testing.assert_allclose(np.stack(found.mean, axis=-1), mean, rtol=1e-10)
    scale = np.sqrt([np.diag(p) for p in cov])
    error = (dense_cov(found.cov) - cov) / (scale[:, :, None] * scale[:, None, :])
    assert np.abs(error).max() < 1e-10


def step_report(innovations, covs):
    """Infos with the density of every mode's innovation, as a member filter reports it."""
    nis = np.array([n @ np.linalg.solve(s, n) for n, s in zip(innovations, covs, strict=True)])
    log_det = np.array([np.linalg.slogdet(2 * np.pi * s)[1] for s in covs])
    zero = jnp.zeros(4)
    flags = Flags(zero, zero, zero)
    return Info(None, None, jnp.asarray(-0.5 * (nis + log_det)), jnp.asarray(nis), flags)


def corrected_modes(predicted, innovations, covs, no_root):
    infos = step_report(innovations, covs)
    likelihoods = without_root(infos) if no_root else infos.log_likelihood
    return np.exp(np.asarray(correct(jnp.log(jnp.asarray(predicted)), likelihoods)[0]))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("no_root", [True, False])
def test_correction_is_eq_12(seed, no_root):
    rng = np.random.default_rng(seed)
    mu = rng.dirichlet(np.ones(4))
    innovations, covs = rng.normal(size=(4, 2)), [random_cov(rng, 2) for _ in range(4)]
    found = corrected_modes(mu, innovations, covs, no_root)
    expected = paper.correct_modes(mu, innovations, covs, no_root)
    np.testing.assert_allclose(found, expected, rtol=1e-10)


# the whole filter, on runs of the model that the resolved one is made for


def case(rng, roughness, pz):
    """Roads of every mode, states and measurements of one run of the paper's own Eq. 8."""
    speeds = np.full(TIME, SPEED)
    variances = [4 * roughness * paper.class_level(a) for a in range(4)]
    drawn = [paper.road(rng.normal(size=TIME + 1), CUTOFF, speeds, DT, v) for v in variances]
    roads = np.stack(drawn, axis=1)
    cars, cov = [numbers(car) for car in CARS], np.diag(SIGMA**2)
    truth = paper.simulate(rng, MEAN, cov, cars, roads, pz, Q, (NOISE, NOISE), DT)
    return roads, *truth


def cases(roughness, pz):
    rng = np.random.default_rng(0)
    drawn = zip(*(case(rng, roughness, pz) for _ in range(RUNS)), strict=True)
    roads, states, ys = (np.array(a) for a in drawn)
    inputs = ArtificialRoad(jnp.asarray(roads[:, :-1]), jnp.asarray(roads[:, 1:]))
    return SimpleNamespace(
        roads=roads, states=states, ys=ys, measured=columns(ys, Accelerations), inputs=inputs
    )


@pytest.fixture(scope="module")
def smooth():
    """Roads on which the modes are told apart slowly, so that mixtures are nearly Gaussian."""
    return cases(0.02, PZ)


@pytest.fixture(scope="module")
def rough():
    """Roads and Pz as printed."""
    return cases(1.0, paper.markov(4))


def filter_params(pz=PZ, q=Q):
    params = printed_params(stacked(CARS), jnp.asarray(DT, float), AbsoluteCorner(*q), NOISE)
    return replace(params, transition=jnp.asarray(pz, float))


def prior():
    return independent(AbsoluteCorner(*MEAN), AbsoluteCorner(*SIGMA))


@lru_cache(maxsize=16)
def compiled(misprints):
    filter = printed_immuf(misprints)

    def one(ys, inputs, params):
        start = filter.init(prior(), params)
        return drive.run(filter, start, ys, params, inputs=inputs, bind=bind_road)

    return quickly(jax.vmap(one, in_axes=(0, 0, None)))


def filtered(name, data, pz=PZ):
    """Trajectory of every run, [runs, time, ...]."""
    found = compiled(FORMS[name])(data.measured, data.inputs, filter_params(pz))
    return jax.tree.map(np.asarray, found)


@pytest.mark.parametrize("name", FORMS)
def test_filter_is_eq_9_to_19_over_a_record(smooth, name):
    found = filtered(name, smooth)
    kept = {n: getattr(FORMS[name], n) for n in SWITCHES}
    cars, start = [numbers(car) for car in CARS], (MEAN, np.diag(SIGMA**2))
    for run in (0, 1):
        given = cars, smooth.roads[run], PZ, Q, (NOISE, NOISE), DT, kept
        mean, cov, mu, means, covs = paper.immuf(smooth.ys[run], *start, *given)
        state = jax.tree.map(itemgetter(run), found.state)
        np.testing.assert_allclose(np.exp(state.log_probabilities), mu, rtol=0, atol=1e-10)
        assert belief_error(state.combined, mean, cov) < 1e-10
        assert belief_error(state.members, means, covs) < 1e-10


def belief_error(belief, mean, cov):
    """Largest difference of means and covariances, in standard deviations."""
    sigma = np.sqrt(np.diagonal(cov, axis1=-2, axis2=-1))
    off = (np.stack(belief.mean, axis=-1) - mean) / sigma
    spread = (dense_cov(belief.cov) - cov) / (sigma[..., :, None] * sigma[..., None, :])
    return max(np.abs(off).max(), np.abs(spread).max())


# what each misprint does


def median_nees(name, data):
    belief = filtered(name, data).state.combined
    off = data.states - np.stack(belief.mean, axis=-1)
    return np.median(np.einsum("rti,rtij,rtj->rt", off, np.linalg.inv(dense_cov(belief.cov)), off))


def test_resolved_filter_is_honest_and_misprints_are_not(smooth):
    """Median of the normalised error squared, over that of chi-square with 5 degrees."""
    ratio = {name: median_nees(name, smooth) / chi2.median(5) for name in FORMS}
    assert 0.85 < ratio["resolved"] < 1.0
    for overconfident in ("damping", "spread", "determinant"):
        assert ratio[overconfident] > 1.1
    assert ratio["sensors"] < 0.97 * ratio["resolved"]
    assert ratio["literal"] > 4.0


@pytest.mark.parametrize("seed", range(3))
def test_same_sign_damping_breaks_the_momentum_balance(seed):
    rng = np.random.default_rng(seed)
    car, states, z_r = random_car(rng), random_states(rng), jnp.asarray(0.02 * rng.normal(size=200))
    x, params = columns(states, AbsoluteCorner), member(car, (z_r, z_r))
    force = {}
    for kept in (True, False):
        a = printed_model(Misprints(damping=kept)).observation(x, params)
        tyre = x.k_t * (x.z_u - z_r)
        force[kept] = np.asarray(car.sprung_mass * a.a_s + car.unsprung_mass * a.a_u + tyre)
    square = car.suspension.quadratic_damping * np.asarray(x.v_s - x.v_u) ** 2
    np.testing.assert_allclose(force[True], -2 * square, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(force[False], 0.0, atol=1e-8)


def test_prediction_without_transpose_shows_only_where_pz_is_not_symmetric(rough):
    mu = jnp.asarray([0.7, 0.2, 0.06, 0.04])
    forms = [PrintedForms(prediction=kept) for kept in (True, False)]
    kept, used = (printed_mixing(mu, jnp.asarray(paper.markov(4)), f)[0] for f in forms)
    np.testing.assert_allclose(kept, used, rtol=1e-14)
    kept, used = (printed_mixing(mu, jnp.asarray(PZ), f)[0] for f in forms)
    assert np.abs(np.asarray(kept - used)).max() > 0.01
    assert float(used.sum()) == pytest.approx(1.0, abs=1e-14)
    assert abs(float(kept.sum()) - 1.0) > 0.01
    kept, used = (filtered(n, rough, paper.markov(4)).state for n in ("prediction", "resolved"))
    np.testing.assert_allclose(kept.combined.mean.k_t, used.combined.mean.k_t, rtol=1e-10)


def test_printed_weights_sum_to_197_percent_in_an_improbable_mode():
    pz = jnp.asarray(paper.markov(4))

    def sums(mu, kept):
        return np.asarray(printed_mixing(jnp.asarray(mu), pz, PrintedForms(weights=kept))[1].sum(0))

    certain = sums([1.0, 0.0, 0.0, 0.0], True)
    np.testing.assert_allclose(certain, [0.9412 / 0.97, 1.96, 1.96, 1.96], rtol=1e-12)
    for mu in np.random.default_rng(0).dirichlet(0.3 * np.ones(4), 20):
        assert np.all((sums(mu, True) >= 0.97) & (sums(mu, True) <= 1.96))
        np.testing.assert_allclose(sums(mu, False), 1.0, rtol=1e-12)


def test_printed_weights_carry_the_stiffness_away(rough):
    """A mode's k_t leaves a tenth to ten times its prior; with the weights resolved, none does."""

    def lost(name):
        stiffness = filtered(name, rough, paper.markov(4)).state.members.mean.k_t
        return ~((stiffness > 0.1 * MEAN[4]) & (stiffness < 10 * MEAN[4])).all(axis=(1, 2))

    assert lost("literal").mean() > 0.9
    assert lost("weights").mean() > 0.4
    for name in ("resolved", "damping", "prediction", "spread", "determinant", "sensors"):
        assert not lost(name).any()


@pytest.mark.parametrize("seed", range(3))
def test_mixing_without_spread_is_overconfident(seed):
    _, _, means, covs = random_modes(np.random.default_rng(seed))
    members = as_members(means, covs)
    mixing = printed_mixing(jnp.full(4, 0.25), jnp.asarray(PZ), PrintedForms(weights=False))[1]
    without, used = (mixed_states(mixing, members, spread=s) for s in (False, True))
    missing = (dense_cov(used.cov) - dense_cov(without.cov)) / np.outer(SIGMA, SIGMA)
    for k in range(4):
        eigenvalues = np.linalg.eigvalsh(missing[k])
        assert eigenvalues.min() > -1e-9 * eigenvalues.max()
        assert eigenvalues.max() > 0.1
    np.testing.assert_allclose(without.mean.k_t, used.mean.k_t, rtol=1e-14)


@pytest.mark.parametrize("seed", range(3))
def test_determinant_without_root_favours_the_mode_that_is_surer(seed):
    """Of modes that fit equally well, by the square root of the ratio of determinants."""
    rng = np.random.default_rng(seed)
    covs = [random_cov(rng, 2) for _ in range(4)]
    fit = [np.linalg.cholesky(s) @ [0.6, -0.8] for s in covs]
    kept, used = (corrected_modes(np.full(4, 0.25), fit, covs, k) for k in (True, False))
    det = np.array([np.linalg.det(s) for s in covs])
    surest, vaguest = np.argmin(det), np.argmax(det)
    gain = (kept[surest] / kept[vaguest]) / (used[surest] / used[vaguest])
    assert gain == pytest.approx(np.sqrt(det[vaguest] / det[surest]), rel=1e-10)
    assert gain > 1.2


def test_standard_deviations_on_the_diagonal_of_r_widen_the_innovations(smooth):
    """0.5 instead of 0.25 (m/s^2)^2, seen whole at the first sample."""
    kept, used = (filtered(name, smooth).info for name in ("sensors", "resolved"))
    for i in range(2):
        wider = kept.innovation_cov[i][i][:, 0] - used.innovation_cov[i][i][:, 0]
        np.testing.assert_allclose(wider, 0.25, rtol=1e-9)
    np.testing.assert_allclose(kept.innovation_cov[1][0][:, 0], used.innovation_cov[1][0][:, 0])


# as any filter: differentiable, and in single precision


def test_slopes_through_the_printed_equations_are_confirmed_by_differences():
    """Reverse mode over a record, with members of one state: other tests have the members'."""
    model = StateSpaceModel(
        transition=lambda x, p: x,
        observation=lambda x, p: Level(x.height * p),
        process_cov=lambda x, p: ((0.1 * p,),),
        observation_cov=lambda p: ((0.2 * p,),),
    )
    filter = printed_interacting(unscented(model))
    ys = Level(jnp.asarray(np.random.default_rng(0).normal(size=12)))

    def outcome(log_members, log_transition):
        transition = jnp.asarray(PZ) * jnp.exp(log_transition)
        params = InteractingParams(jnp.exp(log_members), transition, jnp.full(4, 0.25))
        start = filter.init(independent(Level(1.0), Level(0.7)), params)
        final, info = drive.scan(filter, start, ys, params)
        return info.info.log_likelihood.sum() + final.combined.mean.height

    here = jnp.linspace(-0.5, 0.5, 4), jnp.zeros((4, 4))
    both = quickly(jax.value_and_grad(outcome, argnums=(0, 1)))
    slopes = both(*here)[1]
    rng = np.random.default_rng(1)
    for _ in range(5):
        way = [jnp.asarray(rng.normal(size=a.shape)) for a in here]
        beside = ([a + h * w for a, w in zip(here, way, strict=True)] for h in (1e-6, -1e-6))
        above, below = (both(*point)[0] for point in beside)
        along = sum(float((s * w).sum()) for s, w in zip(slopes, way, strict=True))
        assert along == pytest.approx(float(above - below) / 2e-6, rel=1e-6)


def test_single_precision_runs(smooth):
    double = filtered("resolved", smooth).state.combined
    with jax.enable_x64(False):
        data = jax.tree.map(lambda a: jnp.asarray(np.asarray(a), float), vars(smooth))
        single = filtered("resolved", SimpleNamespace(**data)).state.combined
    assert single.mean.k_t.dtype == np.float32
    sigma = np.sqrt(double.cov[4][4])
    assert np.abs((single.mean.k_t - double.mean.k_t) / sigma).max() < 1e-3
