"""Identification: recovery of known parameters, and what is said when it cannot be trusted."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2
from truth import TRUE, record

from benchmarks.recovery import trial
from wheelhop.errors import DivergenceError, InputError, InputWarning
from wheelhop.identification import SUSPENSION, Settings, identify, search_space
from wheelhop.identification.parameters import value_of, with_values
from wheelhop.identification.whitening import ON_BOUND, moved
from wheelhop.vehicle.parameters import brancati_suv

CAR = with_values(brancati_suv(), {"sprung_mass": TRUE["sprung_mass"]})
START = with_values(
    CAR,
    {
        "suspension.stiffness": 55e3,
        "suspension.damping": 1200.0,
        "suspension.quadratic_damping": 1500.0,
        "suspension.cubic_stiffness": 1e5,
    },
)
GRID = [(13.0, 130e3), (17.0, 230e3), (21.0, 180e3)]
EXPECTED = np.array([TRUE[name] for name in SUSPENSION])


def records(noise, level=256e-6, **changes):
    return [record(k, v, p, noise=noise, level=level, **changes) for k, (v, p) in enumerate(GRID)]


@pytest.fixture(scope="module")
def exact():
    return identify(records(0.0), START, starts=4)


@pytest.fixture(scope="module")
def noisy():
    return identify(records(0.5), START, starts=4)


def test_exact_records_give_the_true_parameters(exact):
    """Made by another program, four times finer; what is left is the sampled road."""
    np.testing.assert_allclose(exact.values, EXPECTED, rtol=5e-3)
    assert exact.problems == ()
    assert exact.unexplained < 1e-5
    assert np.all(exact.rmse < 0.01 * exact.measured_rms)
    assert np.all(exact.rmse < exact.start_rmse)
    assert exact.loss == pytest.approx(np.linalg.norm(exact.rmse))
    for name, value in zip(SUSPENSION, EXPECTED, strict=True):
        assert value_of(exact.car, name) == pytest.approx(value, rel=5e-3)


def test_every_start_ends_at_the_same_parameters(exact):
    assert exact.descent.converged.all()
    np.testing.assert_allclose(exact.descent.free, exact.descent.free[:1].repeat(4, 0), atol=0.01)


def test_noisy_records_give_them_within_the_stated_error(noisy):
    errors = (noisy.values - EXPECTED) / noisy.uncertainty.standard_errors
    assert np.all(np.abs(errors) < 4.0)
    np.testing.assert_allclose(noisy.rmse, 0.5, rtol=0.1)
    np.testing.assert_allclose(
        noisy.uncertainty.robust_errors, noisy.uncertainty.standard_errors, rtol=0.6
    )


def test_history_tells_the_way_down(noisy):
    history = noisy.descent.history
    np.testing.assert_allclose(history[-1], noisy.descent.loss, rtol=1e-12)
    assert history[-1].min() < 0.1 * history[0].min()
    assert np.all(np.diff(noisy.descent.evaluations) > 0)
    assert np.all(np.diff(noisy.descent.seconds) > 0)


def test_progress_is_told():
    told = []
    settings = Settings(warm_up=2, iterations=2)
    with pytest.warns(InputWarning, match="still descending"):
        found = identify(
            records(0.5),
            START,
            starts=4,
            settings=settings,
            on_progress=lambda done, most, loss: told.append((done, most, loss)),
        )
    assert [t[0] for t in told] == list(range(1, len(told) + 1))
    assert told[-1][2] == pytest.approx(found.descent.history[-1].min(), rel=0.01)
    assert "more iterations" in found.problems[0]


def test_reverse_mode_ends_at_the_same_parameters(noisy):
    found = identify(records(0.5), START, starts=4, mode="reverse")
    sigma = noisy.uncertainty.standard_errors
    assert np.all(np.abs(found.values - noisy.values) < 0.05 * sigma)


def test_a_parameter_that_wants_beyond_its_bound_is_named():
    """A damper that grows softer with speed, which no positive quadratic part can follow."""
    soft = records(0.0, suspension__quadratic_damping=-400.0)
    with pytest.warns(InputWarning, match="quadratic_damping is at its lower bound, 0"):
        found = identify(soft, START, starts=4)
    k = SUSPENSION.index("suspension.quadratic_damping")
    assert found.at_bound[k] == "lower"
    assert found.values[k] == 0.0
    assert float(found.car.suspension.quadratic_damping) == 0.0
    assert np.isnan(found.uncertainty.standard_errors[k])
    assert np.isfinite(np.delete(found.uncertainty.standard_errors, k)).all()


def test_what_lies_on_a_bound_is_not_shifted_by_rounding():
    """A last digit off, it would look like a parameter inside, of which nothing is known."""
    center = jnp.array([[ON_BOUND, -ON_BOUND, 0.3]])
    whitening = jnp.array([[[1e5, 2.0, 0.1], [3.0, 1e4, 0.2], [0.1, 0.2, 1.0]]])
    there = moved(center, whitening, jnp.array([[1e-8, -3e-7, 0.1]]), jnp.array([4.0]))
    np.testing.assert_array_equal(there[0, :2], center[0, :2])
    assert there[0, 2] != center[0, 2]


def test_a_start_that_runs_into_a_bound_on_its_way_comes_back():
    """From here a first Newton step wants the cubic stiffness beyond 0, where it is not."""
    away = {"damping": 299.0, "quadratic_damping": 146.0, "stiffness": 678e3}
    start = with_values(CAR, {f"suspension.{name}": value for name, value in away.items()})
    start = with_values(start, {"suspension.cubic_stiffness": 475e3})
    true = {"suspension__quadratic_damping": 100.0, "suspension__cubic_stiffness": 3e5}
    both = [
        record(k, v, p, seconds=3.2, noise=0.5, level=256e-6, **true)
        for k, (v, p) in enumerate(((13.0, 130e3), (20.0, 230e3)))
    ]
    found = identify(both, start, starts=1)
    assert found.problems == ()
    expected = np.array([2400.0, 100.0, 33.6e3, 3e5])
    assert np.all(np.abs(found.values - expected) < 4 * found.uncertainty.standard_errors)


def test_what_the_records_do_not_see_keeps_its_start_and_is_named():
    """At the nominal pressure alone, the pressure coefficient changes nothing."""
    same = [replace(r, pressure=np.full(len(r.t), 250e3)) for r in records(0.5)]
    space = search_space(("suspension.stiffness", "tire.pressure_coefficient"))
    with pytest.warns(InputWarning, match="pressure_coefficient .* not determined at all"):
        found = identify(same, CAR, space=space, starts=2)
    assert found.values[1] == 0.7
    assert found.at_bound == ("", "")
    assert np.isinf(found.uncertainty.standard_errors[1])
    assert np.isfinite(found.uncertainty.standard_errors[0])


@pytest.mark.slow
def test_accelerations_leave_the_common_scale_of_masses_and_stiffnesses_open():
    linear = {"suspension.cubic_stiffness": 0.0, "suspension.quadratic_damping": 0.0}
    names = (
        "sprung_mass",
        "unsprung_mass",
        "suspension.stiffness",
        "suspension.damping",
        "tire.stiffness",
    )
    changes = {name.replace(".", "__"): value for name, value in linear.items()}
    with pytest.warns(InputWarning, match="not determined at all"):
        found = identify(
            records(0.5, **changes), with_values(CAR, linear), space=search_space(names), starts=2
        )
    assert np.all(np.isinf(found.uncertainty.standard_errors))
    weights = np.array(list(found.uncertainty.weak[-1].weights.values()))
    np.testing.assert_allclose(np.abs(weights), 1 / np.sqrt(5), rtol=1e-3)
    ratio = found.values[2] / found.values[0]
    assert ratio == pytest.approx(TRUE["suspension.stiffness"] / TRUE["sprung_mass"], rel=0.02)


def test_records_of_the_wrong_sign_are_a_poor_fit():
    wrong = [replace(r, a_s=-r.a_s, a_u=-r.a_u) for r in records(0.5)]
    with pytest.warns(InputWarning, match="stay unexplained"):
        found = identify(wrong, START, starts=4)
    assert found.unexplained > 0.5


def test_no_finite_simulation_is_an_error():
    stiff = with_values(START, {"unsprung_mass": 2.0, "suspension.damping": 4.9e4})
    with pytest.raises(DivergenceError, match="none of 4 starts"):
        identify(records(0.5), stiff, starts=4)


def test_refusals():
    with pytest.raises(InputError, match="mode: 'sideways'"):
        identify(records(0.5), START, mode="sideways")
    with pytest.raises(InputError, match="starts: 0"):
        identify(records(0.5), START, starts=0)
    with pytest.raises(InputError, match=r"settings.refresh: 0"):
        identify(records(0.5), START, settings=Settings(refresh=0))
    with pytest.raises(InputError, match="sprung_mass"):
        identify(records(0.5), with_values(START, {"sprung_mass": 1.0}))


@pytest.mark.slow
def test_float32_finds_the_same_within_its_error(noisy):
    with jax.enable_x64(False):
        found = identify(records(0.5), START, starts=4)
    sigma = noisy.uncertainty.standard_errors
    assert np.all(np.abs(found.values - noisy.values) < 0.5 * sigma)
    np.testing.assert_allclose(found.uncertainty.standard_errors, sigma, rtol=0.05)


@pytest.mark.slow
def test_random_corners_are_found_and_the_stated_errors_are_honest():
    """Twenty random corners: exact data to 0.5 %, NEES of noisy data in its 99.9 % band."""
    exact = [trial(seed, 0.0) for seed in range(20)]
    noisy = [trial(seed, 0.5) for seed in range(20)]
    assert np.max(np.abs([t["relative"] for t in exact])) < 5e-3
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 20 * len(SUSPENSION)) / 20
    assert low < np.mean([t["nees"] for t in noisy]) < high
    assert np.mean(np.abs([t["scaled"] for t in noisy]) < 2) > 0.88
