"""Load correction of the pressure estimate: a payload's bias, and the sigma that a load adds."""

import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.estimators.load_correction import OperatingLoad, corrected_by_load, operating_load
from wheelhop.estimators.pressure import Operation, StiffnessBelief, pressure_belief
from wheelhop.vehicle.full_vehicle_parameters import VEHICLES
from wheelhop.vehicle.tire import Tire

CAR = VEHICLES["suv-load-speed"]()
LAW = CAR.tire.vertical
SPEED, NOMINAL, TRUE = 15.0, 250e3, 225e3
LEVEL = 9.80665 * np.array([610.0, 610.0, 560.0, 560.0])
REFERENCE = Operation(jnp.asarray(LEVEL), SPEED, TRUE)
KNOWN = jnp.asarray(0.005**2 * np.eye(4))


def stiffness(load, pressure):
    """Central difference of load over deflection, the law written out, spin of free rolling."""
    p = {name: float(np.asarray(getattr(LAW, name))[0]) for name in LAW.__dataclass_fields__}
    reference = p["unloaded_radius"] / np.sqrt(p["q_fz1"] ** 2 + 4 * p["q_fz2"])

    def force(rho, spin):
        rim = spin * p["unloaded_radius"] / p["reference_speed"]
        inflation = 1 + p["pressure_coefficient"] * (pressure / p["nominal_pressure"] - 1)
        x = rho / p["unloaded_radius"]
        elastic = (p["q_fz1"] * x + p["q_fz2"] * x * x) * p["rated_load"]
        return (1 + p["speed_coefficient"] * rim) * inflation * elastic

    def spin_at(rho):
        x = rho / reference
        drop = reference * (p["d_reff"] * np.arctan(p["b_reff"] * x) + p["f_reff"] * x)
        return SPEED / (p["unloaded_radius"] - drop)

    low, high = 0.0, 0.1
    for _ in range(80):
        rho = 0.5 * (low + high)
        low, high = (rho, high) if force(rho, spin_at(rho)) < load else (low, rho)
    spin = spin_at(rho)
    return (force(rho + 1e-6, spin) - force(rho - 1e-6, spin)) / 2e-6


# the linear law of each wheel under its level load, where it sinks deeper at less pressure
AT = np.array([[stiffness(f, p) for p in (TRUE, NOMINAL)] for f in LEVEL])
SLOPE = (1.0 - AT[:, 0] / AT[:, 1]) / (1.0 - TRUE / NOMINAL)
TIRE = Tire(jnp.asarray(AT[:, 1]), NOMINAL, jnp.asarray(SLOPE))
HEAVY = 1.2 * LEVEL
SEEN = StiffnessBelief(jnp.log(jnp.asarray([stiffness(f, TRUE) for f in HEAVY])), KNOWN)


def pressure(belief):
    found = pressure_belief(belief, TIRE)
    return np.asarray(found.mean), np.sqrt(np.diagonal(np.asarray(found.cov), axis1=-2, axis2=-1))


def test_a_payload_reads_as_pressure_until_its_load_is_known():
    uncorrected = pressure(SEEN)[0] - TRUE
    assert np.all((uncorrected > 5e3) & (uncorrected < 15e3))
    exact = OperatingLoad(jnp.asarray(HEAVY), jnp.zeros(4))
    found = pressure(corrected_by_load(SEEN, exact, SPEED, REFERENCE, LAW))[0] - TRUE
    assert np.abs(found).max() < 2
    # the load's effect depends on pressure by no more than the stiffness itself, 0.7 x 10 % here
    elsewhere = Operation(REFERENCE.load, SPEED, NOMINAL)
    left = pressure(corrected_by_load(SEEN, exact, SPEED, elsewhere, LAW))[0] - TRUE
    assert np.abs(left / uncorrected).max() < 0.07


def test_an_estimated_load_leaves_errors_of_the_stated_sigma():
    rng = np.random.default_rng(0)
    sd, draws = 200.0, 400
    log = jnp.asarray(np.asarray(SEEN.mean) + rng.normal(0, 0.005, (draws, 4)))
    belief = StiffnessBelief(log, jnp.broadcast_to(KNOWN, (draws, 4, 4)))
    estimated = OperatingLoad(jnp.asarray(HEAVY + rng.normal(0, sd, (draws, 4))), jnp.full(4, sd))
    mean, sigma = pressure(corrected_by_load(belief, estimated, SPEED, REFERENCE, LAW))
    # chi-square of 1600 degrees has a standard deviation of 3.5 %
    assert np.mean(((mean - TRUE) / sigma) ** 2) == pytest.approx(1.0, abs=0.12)
    assert np.abs((mean - TRUE).mean(0)).max() < 4 * sigma.mean() / np.sqrt(draws)


def test_sigma_grows_with_the_loads_as_the_delta_method_says():
    sigma = []
    for sd in (0.0, 200.0, 400.0):
        load = OperatingLoad(jnp.asarray(HEAVY), jnp.full(4, sd))
        sigma.append(np.diag(corrected_by_load(SEEN, load, SPEED, REFERENCE, LAW).cov))
    slope = [np.log(stiffness(f + 5.0, TRUE) / stiffness(f - 5.0, TRUE)) / 10 for f in HEAVY]
    np.testing.assert_allclose(sigma[0], np.diag(KNOWN), rtol=1e-12)
    for row, sd in zip(sigma[1:], (200.0, 400.0), strict=True):
        np.testing.assert_allclose(row - sigma[0], (np.array(slope) * sd) ** 2, rtol=1e-3)


def test_the_load_of_a_window_has_one_error_all_along():
    """Its sigma is the mean sigma: Monte Carlo of an error that does not change in the window."""
    rng = np.random.default_rng(1)
    sigma = np.broadcast_to([100.0, 150.0, 200.0, 250.0], (60, 4))
    course = 4000 + 500 * np.sin(np.linspace(0, 9, 60))[:, None] + np.zeros((60, 4))
    window = slice(10, 50)
    errors = []
    for common in rng.normal(0, 1, (500, 4)):
        found = operating_load(course + common * sigma, sigma, window)
        errors.append(np.asarray(found.mean) - course[window].mean(0))
    assert np.std(errors, axis=0) == pytest.approx(np.asarray(found.sd), rel=0.1)
    np.testing.assert_allclose(found.sd, sigma[0], rtol=1e-14)


def test_lost_samples_are_left_out():
    load = np.array([[1.0, 5.0], [np.nan, 7.0], [3.0, np.nan], [9.0, 9.0]])
    sigma = np.array([[1.0, 2.0], [9.0, np.nan], [3.0, 9.0], [7.0, 7.0]])
    found = operating_load(load, sigma, slice(0, 3))
    np.testing.assert_allclose(found.mean, [2.0, 5.0])
    np.testing.assert_allclose(found.sd, [2.0, 2.0])
    nothing = operating_load(np.full((3, 2), np.nan), sigma[:3])
    assert np.isnan(np.asarray(nothing.mean)).all()


def test_windows_and_shapes_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="no sample"):
        operating_load(np.ones((5, 4)), np.ones((5, 4)), slice(5, 9))
    with pytest.raises(InputError, match=r"\[time, wheels\]"):
        operating_load(np.ones((5, 4)), np.ones(5))
