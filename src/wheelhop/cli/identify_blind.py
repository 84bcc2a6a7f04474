"""`wheelhop identify --blind`: the options of a fit without a road, and the fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wheelhop.cli.identify_progress import fit_bar
from wheelhop.cli.session import console, escape
from wheelhop.errors import InputError, require_in_range
from wheelhop.identification.blind import (
    NOISE,
    BlindIdentification,
    identify_blind,
)
from wheelhop.identification.parameters import SearchSpace
from wheelhop.identification.scoring import Ascent
from wheelhop.identification.unknown_road import lay
from wheelhop.vehicle.parameters import QuarterCar
from wheelhop.vehicle.record import CornerRecord

FIT = "fit"
"""What is written in place of a number that is to be fitted."""

_WAVINESS = 2.0


@dataclass(frozen=True)
class BlindOptions:
    """What `identify` leaves to a fit without a road.

    Attributes:
        waviness: of all roads; fitted if None.
        noise: standard deviations of a_s and a_u [m/s^2]; fitted if None.
    """

    waviness: float | None
    noise: tuple[float, float] | None

    def settings(self) -> dict[str, Any]:
        """The options that a fit with a road does not have, for the summary."""
        return {
            "blind": True,
            "waviness": FIT if self.waviness is None else self.waviness,
            "noise_m_per_s2": FIT if self.noise is None else self.noise,
        }


def refuse_blind_only(waviness: str | None, noise: str | None) -> None:
    """Raise `InputError` for an option of fits without a road."""
    for option, value in (("--waviness", waviness), ("--noise", noise)):
        if value is not None:
            raise InputError(
                option, "on a known road it has no meaning", "Leave it out, or add --blind."
            )


def blind_options(
    space: SearchSpace,
    waviness: str | None,
    noise: str | None,
    road: Path | None,
    track: str | None,
    reflect: bool,
) -> BlindOptions:
    """The options of a fit without a road, from their texts.

    Args:
        space: the fitted parameters.
        waviness: a number, `FIT`, or None for 2.
        noise: A_S,A_U [m/s^2], `FIT`, or None for the default.
        road, track, reflect: options that name a road, of which none may be given.

    Raises:
        InputError: for a text that is no number, one out of range, or a road.
    """
    roads = {"--road": road is not None, "--track": track is not None, "--reflect": reflect}
    for option, given in roads.items():
        if given:
            raise InputError(
                option, "a fit with --blind reads no road", "Leave one of the two out."
            )
    if "tire.damping" in space.names:
        raise InputError(
            "--parameters",
            "tire.damping cannot be fitted without a road: it needs the road's velocity",
            "Leave it out, or fit it on a known road, without --blind.",
        )
    return BlindOptions(_waviness(waviness), _noise(noise))


def say_unused(records: Sequence[CornerRecord], names: Sequence[str], car: QuarterCar) -> None:
    """Say what is known, and a fit without a road does not use."""
    known = [
        name
        for name, record in zip(names, records, strict=True)
        if record.elevation is not None and np.isfinite(record.elevation).any()
    ]
    if known:
        told = escape(", ".join(known))
        console.print(f"--blind: the elevation in {told} is not used", soft_wrap=True)
    if float(car.tire.damping) > 0:
        console.print(
            "--blind: the tyre's damping counts as none: it acts on the road's velocity, which "
            "is not known",
            soft_wrap=True,
        )


def fit_blind(
    records: Sequence[CornerRecord],
    names: Sequence[str],
    car: QuarterCar,
    space: SearchSpace,
    options: BlindOptions,
    starts: int,
    iterations: int,
    settling: float,
    seed: int,
) -> BlindIdentification:
    """Fit without a road, under a progress bar.

    Args:
        records: as read, with pressure.
        names: of the records.
        car: to begin from.
        space: what to fit of it.
        options: of roads and accelerometers.
        starts: starting points.
        iterations: most iterations.
        settling: time at each log's start that does not count [s].
        seed: of the starting points.

    Raises:
        InputError: for a record that cannot be used.
        DivergenceError: if no start gave a finite likelihood.
    """
    # refused here, before a progress bar begins
    lay(records, names, settling, noise=options.noise or (0.0, 0.0))
    with fit_bar("climbing", lambda loss: f"has log-likelihood {-loss:.1f}") as advance:
        return identify_blind(
            records,
            car,
            names=names,
            space=space,
            waviness=options.waviness,
            noise=options.noise,
            starts=starts,
            seed=seed,
            settling=settling,
            settings=Ascent(iterations=iterations),
            on_progress=advance,
        )


def _waviness(text: str | None) -> float | None:
    if text is None:
        return _WAVINESS
    if text.strip() == FIT:
        return None
    try:
        value = float(text)
    except ValueError:
        raise InputError(
            "--waviness", f"{text!r} is no number", "Give one from 1 to 3, or fit."
        ) from None
    require_in_range("--waviness", value, 1.0, 3.0, "(no unit)")
    return value


def _noise(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return NOISE, NOISE
    if text.strip() == FIT:
        return None
    first, _, second = text.partition(",")
    try:
        both = float(first), float(second)
    except ValueError:
        raise InputError(
            "--noise",
            f"{text!r} is not A_S,A_U",
            "Give two standard deviations in m/s^2, as 0.5,0.5, or fit.",
        ) from None
    for value in both:
        require_in_range("--noise", value, 1e-4, 100.0, "m/s^2")
    return both
