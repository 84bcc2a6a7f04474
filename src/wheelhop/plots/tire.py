"""Figure of a tyre: slip forces, combined slip and vertical law."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from wheelhop.plots.style import ESTIMATE, MUTED, TRUTH, legend
from wheelhop.vehicle.magic_formula import slip_forces
from wheelhop.vehicle.magic_formula_parameters import MagicFormula
from wheelhop.vehicle.vertical_tire import VerticalTire, deflection_at_load, vertical_load

LOADS = (0.25, 0.5, 1.0, 1.5)
PRESSURES = (0.6, 0.8, 1.0, 1.2)
_SHADES = ("#9dc3e6", "#5b9bd5", ESTIMATE, "#123a63")

_forces = jax.jit(slip_forces)


def plot_tire(tire: MagicFormula, vertical: VerticalTire, title: str = "") -> Figure:
    """Slip forces at four loads, forces at combined slip, and load over deflection.

    Args:
        tire: slip-force coefficients, plain numbers.
        vertical: vertical law, plain numbers.
        title: headline of the figure.
    """
    figure = Figure(figsize=(10.0, 7.6), layout="constrained")
    ((longitudinal, lateral), (combined, upright)) = figure.subplots(2, 2)
    for ax in (longitudinal, lateral, combined, upright):
        ax.grid(True, alpha=0.25, linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title or "Tyre", x=0.01, ha="left", fontsize=12)
    _longitudinal(longitudinal, tire)
    _lateral(lateral, tire)
    _combined(combined, tire)
    _vertical(upright, vertical)
    return figure


def _evaluate(
    tire: MagicFormula, kappa: np.ndarray, tan_alpha: np.ndarray, load: float
) -> tuple[np.ndarray, np.ndarray]:
    """Forces [kN] at slips of one shape and a load [N], upright, at nominal pressure."""
    k, a = jnp.asarray(kappa), jnp.asarray(tan_alpha)
    zero = jnp.zeros_like(k)
    forces = _forces(k, a, zero + load, zero, zero + tire.nominal_pressure, tire)
    return np.asarray(forces.longitudinal) / 1e3, np.asarray(forces.lateral) / 1e3


def _longitudinal(ax: Any, tire: MagicFormula) -> None:
    kappa = np.linspace(-0.4, 0.4, 321)
    for share, shade in zip(LOADS, _SHADES, strict=True):
        load = share * tire.rated_load
        force, _ = _evaluate(tire, kappa, 0.0 * kappa, load)
        ax.plot(100 * kappa, force, color=shade, label=f"{load / 1e3:.2f} kN")
    _axis_cross(ax)
    ax.set_xlabel("longitudinal slip κ [%]")
    ax.set_ylabel("longitudinal force $F_x$ [kN]")
    ax.set_title("pure longitudinal slip", loc="left", fontsize=10)
    legend(ax, loc="lower right", title="load", title_fontsize=8)


def _lateral(ax: Any, tire: MagicFormula) -> None:
    alpha = np.linspace(-15.0, 15.0, 301)
    tan_alpha = np.tan(np.radians(alpha))
    for share, shade in zip(LOADS, _SHADES, strict=True):
        load = share * tire.rated_load
        _, force = _evaluate(tire, 0.0 * tan_alpha, tan_alpha, load)
        ax.plot(alpha, force, color=shade, label=f"{load / 1e3:.2f} kN")
    _axis_cross(ax)
    ax.set_xlabel("slip angle α [deg]")
    ax.set_ylabel("lateral force $F_y$ [kN]")
    ax.set_title("pure lateral slip", loc="left", fontsize=10)
    legend(ax, loc="upper right", title="load", title_fontsize=8)


def _combined(ax: Any, tire: MagicFormula) -> None:
    """Lines of constant slip angle over kappa, and the ellipse of the two pure-slip peaks."""
    kappa = np.linspace(-1.0, 1.0, 801)
    load = tire.rated_load
    slips = np.linspace(0.0, 1.0, 801)
    peak_x = np.abs(_evaluate(tire, slips, 0.0 * slips, load)[0]).max()
    peak_y = np.abs(_evaluate(tire, 0.0 * slips, slips, load)[1]).max()
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    ax.plot(
        peak_x * np.cos(turn),
        peak_y * np.sin(turn),
        color=TRUTH,
        linewidth=1.0,
        linestyle="--",
        label="ellipse of the peaks",
    )
    for degrees, shade in zip((1, 3, 6, 12), _SHADES, strict=True):
        for sign in (1.0, -1.0):
            tan_alpha = np.full_like(kappa, sign * np.tan(np.radians(degrees)))
            force_x, force_y = _evaluate(tire, kappa, tan_alpha, load)
            label = f"α = ±{degrees}°" if sign > 0 else None
            ax.plot(force_x, force_y, color=shade, linewidth=1.2, label=label)
    _axis_cross(ax)
    # room for the legend beside the ellipse
    ax.set_xlim(-1.15 * peak_x, 2.5 * peak_x)
    ax.set_ylim(-1.15 * peak_y, 1.15 * peak_y)
    ax.set_aspect("equal", adjustable="box", anchor="W")
    ax.set_xlabel("longitudinal force $F_x$ [kN]")
    ax.set_ylabel("lateral force $F_y$ [kN]")
    ax.set_title(f"combined slip at {load / 1e3:.2f} kN, κ from −1 to 1", loc="left", fontsize=10)
    legend(ax, loc="upper right")


def _vertical(ax: Any, tire: VerticalTire) -> None:
    most = 1.5 * tire.rated_load
    shares = PRESSURES if float(tire.pressure_coefficient) != 0.0 else (1.0,)
    colours = _SHADES if len(shares) > 1 else (ESTIMATE,)
    for share, shade in zip(shares, colours, strict=True):
        pressure = share * tire.nominal_pressure
        end = float(deflection_at_load(most, 0.0, pressure, tire))
        rho = jnp.linspace(0.0, end, 101)
        zero = jnp.zeros_like(rho)
        load = np.asarray(vertical_load(rho, zero, zero, zero + pressure, tire))
        ax.plot(1e3 * np.asarray(rho), load / 1e3, color=shade, label=f"{pressure / 1e3:.0f} kPa")
    ax.axhline(tire.rated_load / 1e3, color=MUTED, linewidth=0.8, linestyle=":")
    ax.text(
        0.0,
        tire.rated_load / 1e3,
        " rated load",
        color=MUTED,
        fontsize=8,
        ha="left",
        va="bottom",
    )
    ax.set_xlim(left=0.0)
    ax.set_ylim(bottom=0.0)
    ax.set_xlabel("deflection ρ [mm]")
    ax.set_ylabel("vertical load $F_z$ [kN]")
    ax.set_title("vertical law, standing", loc="left", fontsize=10)
    legend(ax, loc="lower right", title="pressure", title_fontsize=8)


def _axis_cross(ax: Any) -> None:
    ax.axhline(0.0, color=MUTED, linewidth=0.6)
    ax.axvline(0.0, color=MUTED, linewidth=0.6)
