"""Which tyres are soft, and how soft: the hypotheses of a lateral estimator as one stacked tree.

Order of Solmaz: model 8 of 16 is "front left only". Counting in binary from 1, with a digit of one
for a sound tyre and the front left tyre's first, gives that; model 16 is "none".
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from wheelhop.errors import InputError
from wheelhop.vehicle.full_vehicle_parameters import CORNERS
from wheelhop.vehicle.two_track import Wheels

MOST_MODES = 4**4
"""Four levels of every tyre."""


def level_table(levels: int) -> np.ndarray:
    """Level of every tyre in every mode, [levels^4, 4]; 0 is the softest.

    Args:
        levels: number of levels of each tyre.

    Raises:
        InputError: for fewer than two levels, or more than four.
    """
    if not 2 <= levels <= 4:
        raise InputError(
            "levels", f"{levels} levels make {levels**4} modes", "Give 2 to 4 levels a tyre."
        )
    return np.stack(np.meshgrid(*[np.arange(levels)] * 4, indexing="ij"), axis=-1).reshape(-1, 4)


def stacked_tires(levels: Sequence[Any] | Wheels) -> Wheels:
    """Tyres of every mode: every leaf with a leading axis [modes].

    Args:
        levels: tyres from the softest to the sound one, for all wheels alike; or `Wheels` of such
            sequences of equal length.

    Raises:
        InputError: for fewer than two levels, more than four, or unequal numbers.
    """
    each = levels if isinstance(levels, Wheels) else Wheels(*[tuple(levels)] * 4)
    counts = {len(tires) for tires in each}
    if len(counts) != 1:
        raise InputError(
            "levels", f"the wheels have {sorted(counts)} levels", "Give all wheels as many."
        )
    table = level_table(counts.pop())
    return Wheels(*(_take(tires, column) for tires, column in zip(each, table.T, strict=True)))


def _take(tires: Sequence[Any], column: np.ndarray) -> Any:
    def leaf(*values: Any) -> Any:
        return jnp.asarray([values[level] for level in column], jnp.result_type(float))

    return jax.tree.map(leaf, *tires)


def mode_names(levels: int = 2) -> tuple[str, ...]:
    """What every mode says, in order: "FL", "FL+RR", "none"; with the level if there are several.

    Args:
        levels: number of levels of each tyre.
    """
    sound = levels - 1

    def name(row: np.ndarray) -> str:
        soft = [
            corner if levels == 2 else f"{corner}{level}"
            for corner, level in zip(CORNERS, row, strict=True)
            if level != sound
        ]
        return "+".join(soft) or "none"

    return tuple(name(row) for row in level_table(levels))


def soft_probability(probabilities: Any, levels: int = 2) -> Any:
    """Probability that each tyre is below its sound level, [..., 4].

    Args:
        probabilities: of the modes, [..., modes].
        levels: number of levels of each tyre.
    """
    soft = (level_table(levels) < levels - 1).astype(float)
    return jnp.asarray(probabilities) @ jnp.asarray(soft, jnp.asarray(probabilities).dtype)


def mode_of(soft: Sequence[bool]) -> int:
    """Index, from zero, of the mode of two levels with these tyres soft, FL, FR, RL, RR.

    Raises:
        InputError: unless there are four.
    """
    if len(soft) != len(CORNERS):
        raise InputError("soft", f"{len(soft)} tyres", "Say of four tyres whether they are soft.")
    return int(sum(0 if s else 2 ** (3 - k) for k, s in enumerate(soft)))
