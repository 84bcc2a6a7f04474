"""Mass and centre of mass of a vehicle that stands still, from its four deflections.

`printed` is Filipozzi et al. 2021, Eq. 35: k q of each corner set equal to the algebraic load. It
is four equations for m, l_F, w_L and h, but three combinations of them (sum, rear less front,
right less left) are all that tells m, l_F and w_L; the fourth, the warp, equals a product of the
other three but for 4 m h^2 a_x a_y / (g L W). So h is told by one stand only where it slopes both
ways, by that term alone, and a real car's warp is made by its bars and by the ground instead.

`equilibrium` sets up heave, pitch and roll of a rigid body on the known forces of its springs and
bars, on the slope that the accelerometers show: three equations a stand. For the first moments
m, m x, m y, m z they are linear. One stand gives m, x and y for a believed height; stands of
different slope give the height too.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError, require_in_range
from wheelhop.estimators.algebraic_load import WeightDistribution, distribution_of
from wheelhop.estimators.rest_fit import (
    RestProblem,
    covariance_at,
    fit_rest,
    singular_values_at,
    tells_height,
)
from wheelhop.estimators.resting_stretch import Stands
from wheelhop.vehicle.full_vehicle_parameters import as_arrays
from wheelhop.vehicle.full_vehicle_state import STANDARD_GRAVITY, FullVehicle

UNKNOWNS = ("total_mass", "front_distance", "left_distance", "height")
"""Order of the covariance."""


class RestEstimate(NamedTuple):
    """Mass and centre of mass, told by the deflections at rest.

    Attributes:
        body_mass: m_s, what the springs carry [kg].
        distribution: of the whole vehicle, wheels included (method "printed": its l_F, w_L and h
            are those of what the springs carry).
        cov: covariance in the order of `UNKNOWNS` [kg, m, m, m], [4, 4]; what is kept at a prior
            value has that prior's.
        kept: those of `UNKNOWNS` that the stands do not tell.
        singular_values: of the Jacobian, its rows relative to weight (times wheelbase or track),
            its columns relative to mass, wheelbase, track and height, [4].
        rank: how many of them count, `rest_fit.RANK_TOLERANCE`.
        chi_square: squared misfit in standard deviations, over all stands.
        degrees: equations less free unknowns; the mean of `chi_square`.
        remarks: what a reader should know, in plain words.
    """

    body_mass: float
    distribution: WeightDistribution
    cov: np.ndarray
    kept: tuple[str, ...]
    singular_values: np.ndarray
    rank: int
    chi_square: float
    degrees: int
    remarks: tuple[str, ...]

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; infinite where an unknown has no effect."""
        s = self.singular_values
        return float(s[0] / s[-1]) if s[-1] > 0 else float("inf")

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations in the order of `UNKNOWNS`, [4]."""
        return np.sqrt(np.diag(self.cov))


def mass_at_rest(
    stands: Stands,
    vehicle: FullVehicle,
    deflection_sigma: float,
    *,
    method: str = "equilibrium",
    raised: float = 0.0,
    raised_sd: float = 0.1,
    acceleration_sigma: float = 0.0,
) -> RestEstimate:
    """Mass and centre of mass of a vehicle whose springs, geometry and wheels are known.

    The height is free where rank and noise let the stands tell it better than its prior does;
    otherwise it keeps the prior, whose error enters the covariance of the others. Errors of
    springs, friction in the struts and offsets of the sensors are in no covariance.

    Args:
        stands: mean deflections and accelerations.
        vehicle: springs, bars, geometry, wheels and (for how the body leans) tyres at nominal
            pressure; its body mass and centre only start the search.
        deflection_sigma: standard deviation of each mean deflection [m].
        method: "equilibrium" of the body on all its spring forces, or "printed", Eq. 35: preload
            + k q of each corner alone against Eq. 31.
        raised: prior of how far the body's centre of mass lies above its place in `vehicle` [m].
        raised_sd: its standard deviation [m].
        acceleration_sigma: standard deviation of each mean acceleration [m/s^2].

    Raises:
        InputError: for an unknown method, wrong shapes, or numbers out of range.
    """
    measured = _checked(stands, deflection_sigma, raised, raised_sd, acceleration_sigma, method)
    with jax.enable_x64(True):
        car = as_arrays(vehicle, jnp.float64)
        whole = jax.tree.map(float, distribution_of(car))
        body = float(car.chassis.body_mass)
        noise = np.r_[np.full(4, deflection_sigma), np.full(2, acceleration_sigma)] ** 2
        base, track, height = whole.wheelbase, whole.track, whole.height
        weight = body * STANDARD_GRAVITY
        scale = np.array([body, base, track, height])
        if method == "printed":
            place = np.array([body, whole.front_distance, whole.left_distance, height])
            low, high = np.array([0.0, 0.0, 0.0, 1e-3]), np.array([np.inf, base, track, 4.0])
            rows = np.full(4, weight)
        else:
            place = np.array([body, 0.0, 0.0, 0.0])
            low, high = np.array([0.0, -base, -track, -4.0]), np.array([np.inf, base, track, 4.0])
            rows = np.array([weight, body * base, body * track])
        place[3] = np.clip(place[3] + raised, low[3], high[3])
        problem = RestProblem(method, car, measured, noise, low, high, scale)
        fit = fit_rest(problem, place, 3)
        told = tells_height(fit, scale, rows, raised_sd)
        if told:
            all_free = fit_rest(problem, fit.theta, 4)
            # the stands may seem to tell the height until it is free
            told = tells_height(all_free, scale, rows, raised_sd)
            told = told and bool(np.all((low < all_free.theta) & (all_free.theta < high)))
            fit = all_free if told else fit
    if float(fit.theta[0]) < 0.05 * body:
        raise InputError(
            "stands.deflection",
            f"the springs would carry {float(fit.theta[0]):.3g} kg",
            "Count compressions from the design place of the struts, positive when they are pushed "
            "together, in metres.",
        )
    free = 4 if told else 3
    singular, rank = singular_values_at(fit, scale, rows)
    inner = covariance_at(fit.whitened, free)
    shift = np.zeros(4)
    if not told:
        shift = np.r_[-inner[:3, :3] @ fit.whitened[:, :3].T @ fit.whitened[:, 3], 1.0]
        inner = inner + raised_sd**2 * np.outer(shift, shift)
    cov = fit.outward @ inner @ fit.outward.T
    mass, front, left, high_up = fit.told.tolist()
    found = WeightDistribution(mass, front, left, high_up, base, track)
    chi_square, degrees = float(fit.residual @ fit.residual), fit.residual.size - free
    remarks = _remarks(
        found, np.sqrt(np.diag(cov)), told, len(measured), fit.outward @ shift, method, car
    )
    if degrees and chi_square > degrees + 5.0 * np.sqrt(2.0 * degrees):
        remarks += (
            f"the equations contradict each other: chi-square {chi_square:.0f} for {degrees} "
            "degrees of freedom; check springs, bars, sensor offsets and the ground",
        )
    return RestEstimate(
        float(fit.theta[0]),
        found,
        cov,
        () if told else ("height",),
        singular,
        rank,
        chi_square,
        degrees,
        remarks,
    )


def _remarks(
    found: WeightDistribution,
    sigma: np.ndarray,
    told: bool,
    stands: int,
    shift: np.ndarray,
    method: str,
    car: FullVehicle,
) -> tuple[str, ...]:
    remarks = []
    if not told:
        along, across = (100.0 * shift[k] / shift[3] for k in (1, 2))
        remarks.append(
            f"height is not told by {'this stand' if stands == 1 else 'these stands'}: kept at "
            f"{float(found.height):.3f} m +- {sigma[3]:.3f} m; were it 0.1 m more, l_F would be "
            f"{along:+.1f} mm and w_L {across:+.1f} mm; stands of different slope tell it"
        )
    if method == "printed":
        remarks.append("as printed, m, l_F, w_L and h are those of what the springs carry")
        if told and stands == 1:
            remarks.append(
                "height is told by the warp of the four springs alone, h^2 a_x a_y, which bars "
                "and uneven ground make as well: do not trust it"
            )
        if float(car.anti_roll.front) > 0 or float(car.anti_roll.rear) > 0:
            remarks.append("anti-roll bars are left out, as printed")
    return tuple(remarks)


def _checked(
    stands: Stands, sigma: float, raised: float, raised_sd: float, a_sigma: float, method: str
) -> np.ndarray:
    """Measurements of every stand, [stands, 6]."""
    if method not in ("equilibrium", "printed"):
        raise InputError("method", f"{method!r} is unknown", "Use 'equilibrium' or 'printed'.")
    q = np.asarray(stands.deflection, float)
    a = [np.asarray(v, float) for v in (stands.a_x, stands.a_y)]
    if q.ndim != 2 or q.shape[1] != 4 or any(v.shape != q.shape[:1] for v in a) or not len(q):
        raise InputError(
            "stands",
            f"deflections {q.shape}, a_x {a[0].shape} and a_y {a[1].shape}",
            "Give deflections [stands, 4] and accelerations [stands].",
        )
    for number in q.ravel():
        require_in_range("stands.deflection", number, -1.0, 1.0, "m")
    for name, values in zip(("a_x", "a_y"), a, strict=True):
        for number in values:
            require_in_range(f"stands.{name}", number, -5.0, 5.0, "m/s^2")
    require_in_range("deflection_sigma", sigma, 1e-9, 0.1, "m")
    require_in_range("raised", raised, -2.0, 2.0, "m")
    require_in_range("raised_sd", raised_sd, 1e-6, 2.0, "m")
    require_in_range("acceleration_sigma", a_sigma, 0.0, 1.0, "m/s^2")
    return np.column_stack([q, *a])
