"""Which parameters of a quarter car are fitted, within which bounds, and as which free numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError
from wheelhop.filtering.parameterisation import Bijection, bounded
from wheelhop.vehicle.parameters import QuarterCar

SPREAD = 0.7
"""Standard deviation of the random starts, in free numbers: about a factor of two."""

_EDGE = 1e-3


@dataclass(frozen=True)
class Bounds:
    """Open interval of a parameter and its unit."""

    lower: float
    upper: float
    unit: str


PARAMETERS: dict[str, Bounds] = {
    "sprung_mass": Bounds(20.0, 20e3, "kg"),
    "unsprung_mass": Bounds(2.0, 2e3, "kg"),
    "suspension.stiffness": Bounds(1e3, 1e6, "N/m"),
    "suspension.cubic_stiffness": Bounds(0.0, 1e8, "N/m^3"),
    "suspension.damping": Bounds(0.0, 5e4, "Ns/m"),
    "suspension.quadratic_damping": Bounds(0.0, 5e4, "Ns^2/m^2"),
    "tire.stiffness": Bounds(2e4, 3e6, "N/m"),
    "tire.pressure_coefficient": Bounds(0.05, 1.2, "1"),
    "tire.damping": Bounds(0.0, 1e4, "Ns/m"),
}
"""Every parameter that can be fitted, with its default bounds."""

SUSPENSION = (
    "suspension.damping",
    "suspension.quadratic_damping",
    "suspension.stiffness",
    "suspension.cubic_stiffness",
)
"""The four that Brancati & Tufano 2022, Table 2, leave unknown."""


@dataclass(frozen=True)
class SearchSpace:
    """Fitted parameters; each is a logistic function of a free number, so it keeps its bounds.

    Attributes:
        names: keys of `PARAMETERS`.
        lower, upper: bounds, in the parameters' units.
    """

    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the parameters."""
        return tuple(PARAMETERS[name].unit for name in self.names)

    def maps(self) -> tuple[Bijection, ...]:
        """Free number to parameter, one by one."""
        return tuple(bounded(a, b) for a, b in zip(self.lower, self.upper, strict=True))

    def values(self, free: Any) -> Any:
        """Parameters [n] of free numbers [n]."""
        return jnp.stack([m.constrain(free[k]) for k, m in enumerate(self.maps())])

    def car(self, free: Any, base: QuarterCar) -> QuarterCar:
        """A quarter car with the fitted parameters from free numbers [n], others from `base`."""
        found = {name: m.constrain(free[k]) for k, (name, m) in enumerate(self._named())}
        return with_values(base, found)

    def free(self, car: QuarterCar, inside: float = _EDGE) -> np.ndarray:
        """Free numbers [n] of a quarter car.

        Args:
            car: parameters.
            inside: share of the interval by which a number next to a bound is put inside it.

        Raises:
            InputError: naming a parameter that is outside its bounds.
        """
        numbers = []
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            value = float(value_of(car, name))
            unit = PARAMETERS[name].unit
            if not low <= value <= high:
                raise InputError(
                    name,
                    f"the start, {value:g} {unit}, is outside the bounds {low:g} to {high:g}",
                    "Start inside the bounds, widen them, or do not fit this parameter.",
                )
            share = min(max((value - low) / (high - low), inside), 1.0 - inside)
            numbers.append(math.log(share) - math.log1p(-share))
        return np.array(numbers)

    def _named(self) -> list[tuple[str, Bijection]]:
        return list(zip(self.names, self.maps(), strict=True))


def search_space(
    names: Sequence[str] = SUSPENSION,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> SearchSpace:
    """The parameters to fit and their bounds.

    Args:
        names: keys of `PARAMETERS`.
        bounds: (lower, upper) in place of the defaults.

    Raises:
        InputError: for a name that is unknown or given twice, or bounds that are none.
    """
    given = {} if bounds is None else dict(bounds)
    if not names or len(set(names)) != len(names):
        raise InputError("parameters", f"{list(names)}", "Name each parameter to fit once.")
    for name in (*names, *given):
        if name not in PARAMETERS:
            raise InputError(
                "parameters", f"{name!r} is unknown", f"Use some of {', '.join(PARAMETERS)}."
            )
    for name in given:
        if name not in names:
            raise InputError(
                "bounds", f"{name!r} is not fitted", "Leave its bounds out, or fit it."
            )
    chosen = [given.get(n, (PARAMETERS[n].lower, PARAMETERS[n].upper)) for n in names]
    for name, (low, high) in zip(names, chosen, strict=True):
        widest = PARAMETERS[name]
        if not widest.lower <= low < high <= widest.upper:
            raise InputError(
                f"bounds of {name}",
                f"{low:g} to {high:g} {widest.unit}",
                f"Give lower < upper within {widest.lower:g} to {widest.upper:g} {widest.unit}.",
            )
    lower, upper = zip(*((float(a), float(b)) for a, b in chosen), strict=True)
    return SearchSpace(tuple(names), lower, upper)


def starting_points(first: np.ndarray, starts: int, seed: int) -> np.ndarray:
    """The given free numbers [n] and random ones around them, [starts, n]."""
    random = np.random.default_rng(seed).normal(size=(starts - 1, len(first)))
    return np.concatenate([first[None], first + SPREAD * random])


def value_of(car: QuarterCar, name: str) -> Any:
    """A parameter of a quarter car by its name in `PARAMETERS`."""
    part: Any = car
    for step in name.split("."):
        part = getattr(part, step)
    return part


def with_values(car: QuarterCar, values: Mapping[str, Any]) -> QuarterCar:
    """The quarter car with parameters replaced by name."""
    parts: dict[str, dict[str, Any]] = {"": {}, "suspension": {}, "tire": {}}
    for name, value in values.items():
        part, _, field = name.rpartition(".")
        parts[part][field] = value
    return replace(
        car,
        suspension=replace(car.suspension, **parts["suspension"]),
        tire=replace(car.tire, **parts["tire"]),
        **parts[""],
    )
