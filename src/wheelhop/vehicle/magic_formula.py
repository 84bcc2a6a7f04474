"""Steady-state slip forces of a tyre by the Magic Formula.

Pacejka 2012, section 4.3, in the form of MF-Tyre 5.2 and PAC2002, with the inflation pressure
terms of Besselink, Schmeitz & Pacejka 2010. Slip and camber enter as tan(alpha) and
sin(camber); turn slip does not. ISO axes of the wheel: F_x > 0 for kappa > 0, F_y < 0 for
tan(alpha) > 0.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp

from wheelhop.vehicle.arctangent import arctan
from wheelhop.vehicle.magic_formula_parameters import MagicFormula

LARGEST_SLIP = 1.5


class SlipForces(NamedTuple):
    """Forces of the road on the tyre [N], along the wheel's heading and to its left."""

    longitudinal: Any
    lateral: Any


class _Curve(NamedTuple):
    """One pure-slip curve: force over load D sin(C atan(Bx - E(Bx - atan Bx))) + S_V."""

    slip: Any
    friction: Any
    stiffness: Any
    even: Any
    vertical_shift: Any


def slip_forces(
    kappa: Any,
    tan_alpha: Any,
    load: Any,
    sin_camber: Any,
    pressure: Any,
    tire: MagicFormula,
    friction: Any = 1.0,
) -> SlipForces:
    """Longitudinal and lateral force [N] at combined slip.

    Pacejka 2012, section 4.3; for a `friction_ellipse` tyre the pure-slip forces are reduced
    so that the force stays inside the ellipse of the two peaks.

    Args:
        kappa: longitudinal slip [-], any shape; taken as +-1.5 beyond that.
        tan_alpha: lateral slip V_sy/|V_x| [-], the same shape.
        load: F_z [N], the same shape; zero or less gives no force.
        sin_camber: sine of the inclination, positive when the top leans to the right.
        pressure: p [Pa], the same shape or [].
        tire: coefficients.
        friction: road friction relative to the one the tyre was measured on, the same shape
            or [].
    """
    mirror = tire.side * tire.measured_side
    kappa = jnp.clip(kappa, -LARGEST_SLIP, LARGEST_SLIP)
    tan_alpha, sin_camber = mirror * tan_alpha, mirror * sin_camber
    load = jnp.maximum(load, 0.0)
    x = _longitudinal(kappa, load, sin_camber, pressure, tire, friction)
    y = _lateral(tan_alpha, load, sin_camber, pressure, tire, friction)
    combine = _ellipse if tire.friction_ellipse else _weighted
    force_x, force_y = combine(x, y, kappa, tan_alpha, load, sin_camber, tire)
    return SlipForces(load * force_x, mirror * (load * force_y))


def slip_stiffness(load: Any, pressure: Any, tire: MagicFormula) -> tuple[Any, Any]:
    """Slopes dF_x/dkappa > 0 and dF_y/dtan(alpha) < 0 [N] of the curves' centres.

    They are the slopes at zero slip of a tyre without shifts, upright.

    Args:
        load: F_z [N], any shape.
        pressure: p [Pa], the same shape or [].
        tire: coefficients.
    """
    load = jnp.maximum(load, 0.0)
    ratio, dfz = _relative_load(load, tire)
    longitudinal = _stiffness_x(dfz, pressure, tire)
    lateral = _stiffness_y(ratio, jnp.zeros_like(load), pressure, tire)
    return load * longitudinal, load * lateral


def relaxation_lengths(load: Any, tire: MagicFormula) -> tuple[Any, Any]:
    """Relaxation lengths sigma_kappa and sigma_alpha [m], not below `minimum_relaxation`.

    sigma_kappa = R0 Fz/Fz0 (ptx1 + ptx2 dfz) exp(-ptx3 dfz) lsgkp and
    sigma_alpha = R0 pty1 sin(2 atan(Fz/(pty2 Fz0'))) lfzo lsgal. Pacejka 2012, appendix 3.

    Args:
        load: F_z [N], any shape.
        tire: coefficients.
    """
    load = jnp.maximum(load, 0.0)
    dfz = load / (tire.lfzo * tire.rated_load) - 1.0
    size = tire.unloaded_radius / tire.rated_load * load
    sigma_kappa = size * (tire.ptx1 + tire.ptx2 * dfz) * jnp.exp(-tire.ptx3 * dfz) * tire.lsgkp
    u = load / (tire.pty2 * tire.lfzo * tire.rated_load)
    wave = 2.0 * u / (1.0 + u * u)
    sigma_alpha = tire.pty1 * wave * tire.unloaded_radius * tire.lfzo * tire.lsgal
    floor = tire.minimum_relaxation
    return jnp.maximum(sigma_kappa, floor), jnp.maximum(sigma_alpha, floor)


def _relative_load(load: Any, tire: MagicFormula) -> tuple[Any, Any]:
    """Fz/Fz0', kept off zero for the quotients of the formula, and dfz = Fz/Fz0' - 1."""
    ratio = jnp.maximum(load / (tire.lfzo * tire.rated_load), 1e-4)
    return ratio, ratio - 1.0


def _relative_pressure(pressure: Any, tire: MagicFormula) -> Any:
    return (pressure - tire.nominal_pressure) / tire.nominal_pressure


def _stiffness_x(dfz: Any, pressure: Any, t: MagicFormula) -> Any:
    """Slope of F_x over F_z per slip at the centre of the curve."""
    dp = _relative_pressure(pressure, t)
    with_pressure = 1.0 + t.ppx1 * dp + t.ppx2 * dp * dp
    return (t.pkx1 + t.pkx2 * dfz) * jnp.exp(t.pkx3 * dfz) * with_pressure * t.lkx


def _stiffness_y(ratio: Any, camber: Any, pressure: Any, t: MagicFormula) -> Any:
    """Slope of F_y over F_z per tan(alpha) at the centre of the curve; negative in ISO axes."""
    dp = _relative_pressure(pressure, t)
    place = (t.pky2 + t.pky5 * camber * camber) * (1.0 + t.ppy2 * dp)
    wave = jnp.sin(t.pky4 * arctan(ratio / place))
    scale = t.pky1 * (1.0 + t.ppy1 * dp) * (1.0 - t.pky3 * jnp.abs(camber)) * t.lky
    return scale * wave / ratio


def _longitudinal(
    kappa: Any, load: Any, camber: Any, pressure: Any, t: MagicFormula, friction: Any
) -> _Curve:
    _, dfz = _relative_load(load, t)
    dp = _relative_pressure(pressure, t)
    camber = t.lgax * camber
    grip = t.lmux * friction
    slip = kappa + (t.phx1 + t.phx2 * dfz) * t.lhx
    peak = (t.pdx1 + t.pdx2 * dfz) * (1.0 - t.pdx3 * camber * camber) * grip
    peak = peak * (1.0 + t.ppx3 * dp + t.ppx4 * dp * dp)
    curvature = (t.pex1 + t.pex2 * dfz + t.pex3 * dfz * dfz) * t.lex
    curvature = jnp.minimum(curvature * (1.0 - t.pex4 * jnp.sign(slip)), 1.0)
    stiffness = _stiffness_x(dfz, pressure, t)
    even = _sine(slip, peak, t.pcx1 * t.lcx, curvature, stiffness)
    return _Curve(slip, peak, stiffness, even, (t.pvx1 + t.pvx2 * dfz) * t.lvx * grip)


def _lateral(
    tan_alpha: Any, load: Any, camber: Any, pressure: Any, t: MagicFormula, friction: Any
) -> _Curve:
    ratio, dfz = _relative_load(load, t)
    dp = _relative_pressure(pressure, t)
    camber = t.lgay * camber
    grip = t.lmuy * friction
    slip = tan_alpha + (t.phy1 + t.phy2 * dfz) * t.lhy + t.phy3 * camber
    peak = (t.pdy1 + t.pdy2 * dfz) * (1.0 - t.pdy3 * camber * camber) * grip
    peak = peak * (1.0 + t.ppy3 * dp + t.ppy4 * dp * dp)
    lopsided = 1.0 - (t.pey3 + t.pey4 * camber) * jnp.sign(slip)
    curvature = jnp.minimum((t.pey1 + t.pey2 * dfz) * lopsided * t.ley, 1.0)
    stiffness = _stiffness_y(ratio, camber, pressure, t)
    even = _sine(slip, peak, t.pcy1 * t.lcy, curvature, stiffness)
    shift = (t.pvy1 + t.pvy2 * dfz) * t.lvy + (t.pvy3 + t.pvy4 * dfz) * camber
    return _Curve(slip, peak, stiffness, even, shift * grip)


def _sine(slip: Any, peak: Any, shape: Any, curvature: Any, stiffness: Any) -> Any:
    """D sin(C atan(Bx - E(Bx - atan(Bx)))) with B = K/(C D); zero on a frictionless road."""
    product = shape * peak
    divisor = jnp.where(jnp.abs(product) > 1e-6, product, 1e-6)
    bx = stiffness / divisor * slip
    return peak * jnp.sin(shape * arctan(bx - curvature * (bx - arctan(bx))))


def _weight(slip: Any, slope: Any, shape: Any, curvature: Any, shift: Any) -> Any:
    """Weighting function G of combined slip: one at zero slip, never negative."""

    def cosine(x: Any) -> Any:
        bx = slope * x
        return jnp.cos(shape * arctan(bx - curvature * (bx - arctan(bx))))

    return jnp.maximum(cosine(slip + shift) / cosine(shift), 0.0)


def _weighted(
    x: _Curve,
    y: _Curve,
    kappa: Any,
    tan_alpha: Any,
    load: Any,
    camber: Any,
    t: MagicFormula,
) -> tuple[Any, Any]:
    """Forces over load by the weighting functions of combined slip."""
    _, dfz = _relative_load(load, t)
    slope = (t.rbx1 + t.rbx3 * camber * camber) * _cos_atan(t.rbx2 * kappa) * t.lxal
    curvature = jnp.minimum(t.rex1 + t.rex2 * dfz, 1.0)
    force_x = (x.even + x.vertical_shift) * _weight(tan_alpha, slope, t.rcx1, curvature, t.rhx1)

    slope = t.rby1 + t.rby4 * camber * camber
    slope = slope * _cos_atan(t.rby2 * (tan_alpha - t.rby3)) * t.lyka
    curvature = jnp.minimum(t.rey1 + t.rey2 * dfz, 1.0)
    weight = _weight(kappa, slope, t.rcy1, curvature, t.rhy1 + t.rhy2 * dfz)
    induced = y.friction * (t.rvy1 + t.rvy2 * dfz + t.rvy3 * camber)
    induced = induced * _cos_atan(t.rvy4 * tan_alpha)
    induced = induced * jnp.sin(t.rvy5 * arctan(t.rvy6 * kappa)) * t.lvyka
    return force_x, (y.even + y.vertical_shift) * weight + induced


def _ellipse(x: _Curve, y: _Curve, *_: Any) -> tuple[Any, Any]:
    """Forces over load inside the ellipse of the two peak frictions.

    With the secant slopes s = force/slip: F_x = F_x0/sqrt(1 + (s_x slip_y/mu_y)^2), and the
    same with x and y exchanged, which is the friction-ellipse rule of PAC2002 free of 0/0.
    """
    across_x = _secant(x) * y.slip / _off_zero(y.friction)
    across_y = _secant(y) * x.slip / _off_zero(x.friction)
    force_x = (x.even + x.vertical_shift) / jnp.sqrt(1.0 + across_x * across_x)
    force_y = (y.even + y.vertical_shift) / jnp.sqrt(1.0 + across_y * across_y)
    return force_x, force_y


def _secant(curve: _Curve) -> Any:
    """Force over slip, which tends to the slope of the curve where the slip vanishes."""
    small = jnp.abs(curve.slip) < 1e-5
    return jnp.where(small, curve.stiffness, curve.even / jnp.where(small, 1.0, curve.slip))


def _off_zero(friction: Any) -> Any:
    return jnp.where(jnp.abs(friction) > 1e-6, friction, 1e-6)


def _cos_atan(x: Any) -> Any:
    return 1.0 / jnp.sqrt(1.0 + x * x)
