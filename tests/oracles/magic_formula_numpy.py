"""The Magic Formula in plain Python, one wheel at a time, written apart from wheelhop.

Written from H. B. Pacejka, Tire and Vehicle Dynamics, 3rd ed. 2012, section 4.3, in the
MF-Tyre 5.2 / PAC2002 form (camber shift by PHY3, no turn slip), equation by equation and by the
symbols of the book. Combined slip of a file with FE_METHOD = 'YES', or without RBX1 and RBY1, by
the friction ellipse of PAC2002 in its printed form (angle beta, reciprocals of the frictions).
"""

import re
from math import atan, atan2, cos, exp, hypot, pi, sin, tan

_ONE = {
    *("LFZO", "LCX", "LMUX", "LEX", "LKX", "LHX", "LVX", "LGAX", "LXAL"),
    *("LCY", "LMUY", "LEY", "LKY", "LHY", "LVY", "LGAY", "LYKA", "LVYKA"),
}


def read_coefficients(path):
    """Keys of a tyre property file: numbers where they are numbers, else bare words."""
    found = {}
    pattern = re.compile(r"^[ \t]*([A-Z]\w*)[ \t]*=[ \t]*('[^']*'|[^\s$!]+)", re.M)
    for key, text in pattern.findall(path.read_text()):
        try:
            found[key] = float(text)
        except ValueError:
            found[key] = text.strip("'")
    return found


def coefficients_of(tire):
    """The dictionary that `magic_formula` takes, of any object with lower-case attributes."""
    found = {name.upper(): value for name, value in vars(tire).items()}
    found.update(FNOMIN=tire.rated_load, UNLOADED_RADIUS=tire.unloaded_radius)
    found["FE_METHOD"] = "YES" if tire.friction_ellipse else "NO"
    return found


def sgn(x):
    return float(x > 0) - float(x < 0)


def uses_ellipse(c):
    if "FE_METHOD" in c:
        return c["FE_METHOD"] == "YES"
    return "RBX1" not in c and "RBY1" not in c


def pure(kappa, alpha, fz, gamma, c, dpi=0.0, road=1.0):
    """Everything the pure-slip part of section 4.3.2 defines, by its symbol."""
    p = {**dict.fromkeys(_ONE, 1.0), "PKY4": 2.0}
    p.update(c)
    g = lambda key: p.get(key, 0.0)  # noqa: E731
    fz0 = p["FNOMIN"] * p["LFZO"]
    dfz = (fz - fz0) / fz0

    gx = gamma * p["LGAX"]
    s_hx = (g("PHX1") + g("PHX2") * dfz) * p["LHX"]
    kx = kappa + s_hx
    c_x = p["PCX1"] * p["LCX"]
    mu_x = (p["PDX1"] + g("PDX2") * dfz) * (1 + g("PPX3") * dpi + g("PPX4") * dpi**2)
    mu_x *= (1 - g("PDX3") * gx**2) * p["LMUX"] * road
    d_x = mu_x * fz
    e_x = (g("PEX1") + g("PEX2") * dfz + g("PEX3") * dfz**2) * (1 - g("PEX4") * sgn(kx)) * p["LEX"]
    e_x = min(e_x, 1.0)
    k_x = fz * (p["PKX1"] + g("PKX2") * dfz) * exp(g("PKX3") * dfz)
    k_x *= (1 + g("PPX1") * dpi + g("PPX2") * dpi**2) * p["LKX"]
    b_x = k_x / (c_x * d_x)
    s_vx = fz * (g("PVX1") + g("PVX2") * dfz) * p["LVX"] * p["LMUX"] * road
    f_x0 = d_x * sin(c_x * atan(b_x * kx - e_x * (b_x * kx - atan(b_x * kx)))) + s_vx

    gy = gamma * p["LGAY"]
    s_hy = (g("PHY1") + g("PHY2") * dfz) * p["LHY"] + g("PHY3") * gy
    ay = alpha + s_hy
    c_y = p["PCY1"] * p["LCY"]
    mu_y = (p["PDY1"] + g("PDY2") * dfz) * (1 + g("PPY3") * dpi + g("PPY4") * dpi**2)
    mu_y *= (1 - g("PDY3") * gy**2) * p["LMUY"] * road
    d_y = mu_y * fz
    e_y = (g("PEY1") + g("PEY2") * dfz) * (1 - (g("PEY3") + g("PEY4") * gy) * sgn(ay)) * p["LEY"]
    e_y = min(e_y, 1.0)
    peak_load = (p["PKY2"] + g("PKY5") * gy**2) * (1 + g("PPY2") * dpi) * fz0
    k_y = p["PKY1"] * fz0 * (1 + g("PPY1") * dpi) * sin(p["PKY4"] * atan(fz / peak_load))
    k_y *= (1 - g("PKY3") * abs(gy)) * p["LKY"]
    b_y = k_y / (c_y * d_y)
    s_vy = (g("PVY1") + g("PVY2") * dfz) * p["LVY"] + (g("PVY3") + g("PVY4") * dfz) * gy
    s_vy *= fz * p["LMUY"] * road
    f_y0 = d_y * sin(c_y * atan(b_y * ay - e_y * (b_y * ay - atan(b_y * ay)))) + s_vy
    return {
        "p": p, "g": g, "dfz": dfz,
        "s_hx": s_hx, "k_x": k_x, "d_x": d_x, "s_vx": s_vx, "f_x0": f_x0, "slip_x": kx,
        "s_hy": s_hy, "k_y": k_y, "d_y": d_y, "s_vy": s_vy, "f_y0": f_y0, "slip_y": ay,
        "mu_y": mu_y,
    }  # fmt: skip


def magic_formula(
    kappa, tan_alpha, load, sin_camber, coefficients, relative_pressure=0.0, friction=1.0
):
    """F_x, F_y [N] in ISO axes at combined slip.

    Args:
        kappa, tan_alpha, load, sin_camber: floats; kappa beyond +-1.5 counts as that.
        coefficients: upper-case keys of a tyre property file.
        relative_pressure: (p - p0)/p0.
        friction: of the road.
    """
    kappa = min(max(kappa, -1.5), 1.5)
    if load <= 0:
        return 0.0, 0.0
    s = pure(kappa, tan_alpha, load, sin_camber, coefficients, relative_pressure, friction)
    p, g, dfz, fz = s["p"], s["g"], s["dfz"], load
    if uses_ellipse(coefficients):
        return friction_ellipse(s, fz)

    b = (g("RBX1") + g("RBX3") * sin_camber**2) * cos(atan(g("RBX2") * kappa)) * p["LXAL"]
    e = min(g("REX1") + g("REX2") * dfz, 1.0)
    g_x = weight(tan_alpha, b, g("RCX1"), e, g("RHX1"))

    b = (g("RBY1") + g("RBY4") * sin_camber**2) * p["LYKA"]
    b *= cos(atan(g("RBY2") * (tan_alpha - g("RBY3"))))
    e = min(g("REY1") + g("REY2") * dfz, 1.0)
    g_y = weight(kappa, b, g("RCY1"), e, g("RHY1") + g("RHY2") * dfz)
    d_vyk = s["mu_y"] * fz * (g("RVY1") + g("RVY2") * dfz + g("RVY3") * sin_camber)
    d_vyk *= cos(atan(g("RVY4") * tan_alpha))
    s_vyk = d_vyk * sin(g("RVY5") * atan(g("RVY6") * kappa)) * p["LVYKA"]
    return s["f_x0"] * g_x, s["f_y0"] * g_y + s_vyk


def weight(slip, b, c, e, shift):
    at = lambda x: cos(c * atan(b * x - e * (b * x - atan(b * x))))  # noqa: E731
    return max(at(slip + shift) / at(shift), 0.0)


def friction_ellipse(s, fz):
    """About the centres of the two curves; the slip angle by its tangent."""
    kappa_c, alpha_c = s["slip_x"], s["slip_y"]
    # printed as an arc cosine, which loses half the digits near its ends
    beta = atan2(abs(alpha_c), abs(kappa_c))
    if min(beta, pi / 2 - beta) < 1e-7:
        raise ValueError("the printed form divides by zero at pure slip")
    mu_x_act, mu_y_act = (s["f_x0"] - s["s_vx"]) / fz, (s["f_y0"] - s["s_vy"]) / fz
    mu_x_max, mu_y_max = s["d_x"] / fz, s["d_y"] / fz
    mu_x = 1 / hypot(1 / mu_x_act, tan(beta) / mu_y_max)
    mu_y = tan(beta) / hypot(1 / mu_x_max, tan(beta) / mu_y_act)
    return abs(mu_x / mu_x_act) * s["f_x0"], abs(mu_y / mu_y_act) * s["f_y0"]
