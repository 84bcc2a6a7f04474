"""Tyre property files: what is read, against plain Python, and what is refused."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow.parquet as pq
import pytest
import typer
from typer.testing import CliRunner

from tests.oracles.magic_formula_numpy import magic_formula, read_coefficients
from wheelhop.cli.tire import tire as tire_command
from wheelhop.errors import InputError
from wheelhop.io.tires import read_tire
from wheelhop.plots.tire import plot_tire
from wheelhop.vehicle.magic_formula import relaxation_lengths, slip_forces, slip_stiffness
from wheelhop.vehicle.vertical_tire import (
    deflection_at_load,
    nominal_stiffness,
    vertical_load,
    vertical_stiffness,
)

FILES = (
    "335_65R22_5_G275MSA_40psi",
    "335_65R22_5_G275MSA_60psi",
    "335_65R22_5_G275MSA_70psi",
    "335_65R22_5_G275MSA_95psi",
    "Sedan_Pac02Tire",
    "audi_Pac02Tire",
    "mf_185_80R14",
    "suv_Pac02Tire",
)

SMALL = """$ a comment
[UNITS]
LENGTH = 'meter'
FORCE = 'newton'
ANGLE = 'radians'
MASS = 'kg'
TIME = 'second'
[MODEL]
PROPERTY_FILE_FORMAT = 'PAC2002'   ! the format
[DIMENSION]
UNLOADED_RADIUS = 0.34 $ m
[SHAPE]
{radial width}
 1.0 0.0
[VERTICAL]
VERTICAL_STIFFNESS = 2.1e+005
FNOMIN = 4000
[LONGITUDINAL_COEFFICIENTS]
PCX1 = 1.6
PDX1 = 1.1
PKX1 = 20
[LATERAL_COEFFICIENTS]
PCY1 = 1.4
PDY1 = 1.0
PKY1 = -15
PKY2 = 2.0
SOMETHING_ELSE = 'kept for others'
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tires")

    def write(old="", new=""):
        assert old in SMALL
        path = folder / "small.tir"
        path.write_text(SMALL.replace(old, new) if old else SMALL)
        return path

    return write


@pytest.mark.parametrize("name", FILES)
def test_forces_of_every_measured_tire_equal_plain_python(data, name):
    path = data / "tyre" / "chrono_tir" / f"{name}.tir"
    tire = read_tire(path).magic_formula
    rng = np.random.default_rng(0)
    n = 80
    kappa = rng.uniform(-1.5, 1.5, n) * rng.uniform(0, 1, n) ** 2
    alpha = rng.uniform(-0.8, 0.8, n) * rng.uniform(0, 1, n) ** 2
    load = tire.rated_load * rng.uniform(0.1, 2.0, n)
    camber = rng.uniform(-0.2, 0.2, n)
    found = jax.jit(slip_forces)(kappa, alpha, load, camber, tire.nominal_pressure, tire)
    c = read_coefficients(path)
    expected = np.array(
        [magic_formula(*point, c) for point in zip(kappa, alpha, load, camber, strict=True)]
    )
    # relative to the load: a force that passes through zero has no relative error
    np.testing.assert_allclose(np.stack(found, axis=1), expected, rtol=1e-10, atol=1e-9)
    assert np.abs(expected).max(axis=0).min() > 0.5 * tire.rated_load


@pytest.mark.parametrize("name", FILES)
def test_measured_tires_are_plausible(data, name):
    file = read_tire(data / "tyre" / "chrono_tir" / f"{name}.tir")
    tire, vertical = file.magic_formula, file.vertical
    load = tire.rated_load
    longitudinal, lateral = slip_stiffness(load, tire.nominal_pressure, tire)
    assert 5 < float(longitudinal) / load < 50
    assert -30 < float(lateral) / load < -3
    rho = float(deflection_at_load(load, 0.0, vertical.nominal_pressure, vertical))
    assert 0.01 < rho < 0.06
    assert all(0.1 <= float(s) < 1.5 for s in relaxation_lengths(load, tire))
    assert file.load_range[0] < load < file.load_range[1]


@pytest.mark.parametrize("name", FILES)
def test_combined_slip_of_measured_tires_stays_near_the_ellipse_of_their_peaks(data, name):
    """Within 5 %; the coefficients of one file themselves leave it by 20 %."""
    tire = read_tire(data / "tyre" / "chrono_tir" / f"{name}.tir").magic_formula
    slip = jnp.linspace(-1.5, 1.5, 151)
    kappa, alpha = (m.ravel() for m in jnp.meshgrid(slip, slip))
    zero = jnp.zeros_like(kappa)
    load, pressure = zero + tire.rated_load, zero + tire.nominal_pressure
    evaluate = jax.jit(slip_forces)
    peak_x = jnp.abs(evaluate(kappa, zero, load, zero, pressure, tire).longitudinal).max()
    peak_y = jnp.abs(evaluate(zero, alpha, load, zero, pressure, tire).lateral).max()
    force = evaluate(kappa, alpha, load, zero, pressure, tire)
    size = float(jnp.hypot(force.longitudinal / peak_x, force.lateral / peak_y).max())
    assert 0.95 < size < (1.21 if name == "suv_Pac02Tire" else 1.05)


def test_goodyear_cornering_stiffness_rises_as_the_pressure_falls(data):
    """112 kN/rad at 95 psi to 176 kN/rad at 40 psi, at 15 kN."""
    stiffness = {}
    for psi in (40, 60, 70, 95):
        file = read_tire(data / "tyre" / "chrono_tir" / f"335_65R22_5_G275MSA_{psi}psi.tir")
        assert file.inflation_pressure == pytest.approx(psi * 6894.76, rel=0.025)
        stiffness[psi] = -float(
            slip_stiffness(15e3, file.inflation_pressure, file.magic_formula)[1]
        )
    assert stiffness[95] == pytest.approx(112e3, rel=0.005)
    assert stiffness[40] == pytest.approx(176e3, rel=0.005)
    assert stiffness[95] < stiffness[70] < stiffness[60] < stiffness[40]


def test_deflection_curve_of_the_file_is_met(data):
    file = read_tire(data / "tyre" / "chrono_tir" / "335_65R22_5_G275MSA_40psi.tir")
    lines = (data / "tyre" / "chrono_tir" / "335_65R22_5_G275MSA_40psi.tir").read_text()
    rows = lines.split("[DEFLECTION_LOAD_CURVE]")[1].split("\n")[2:]
    points = np.array([[float(x) for x in row.split()] for row in rows if row.strip()])
    zero = jnp.zeros(len(points))
    v = file.vertical
    found = vertical_load(jnp.asarray(points[:, 0]), zero, zero, v.nominal_pressure, v)
    np.testing.assert_allclose(found, points[:, 1], rtol=0.02, atol=1.0)


def test_a_small_file_is_read(small):
    file = read_tire(small())
    assert (file.name, file.format, file.side) == ("small", "PAC2002", "UNKNOWN")
    assert file.inflation_pressure is None
    assert float(nominal_stiffness(file.vertical)) == pytest.approx(2.1e5, rel=1e-12)
    assert file.magic_formula.pky1 == -15.0
    assert file.magic_formula.friction_ellipse
    assert any("combined slip" in w for w in file.warnings)
    assert any("relaxation" in w for w in file.warnings)


def test_units_are_honoured(small):
    text = SMALL.replace("'meter'", "'mm'").replace("'newton'", "'kN'")
    text = text.replace("= 0.34", "= 340").replace("= 4000", "= 4.0")
    text = text.replace("2.1e+005", "0.21")
    path = small()
    path.write_text(text)
    vertical = read_tire(path).vertical
    reference = read_tire(small()).vertical
    for field in ("unloaded_radius", "rated_load", "q_fz1"):
        assert getattr(vertical, field) == pytest.approx(getattr(reference, field), rel=1e-12)


def test_pressure_terms_are_read(small):
    extra = "PKY2 = 2.0\nPPY1 = -0.4\nPFZ1 = 0.7\nNOMPRES = 220000\nQ_FZ2 = 15\nQV2 = 0.05\n"
    file = read_tire(small("PKY2 = 2.0\n", extra))
    v = file.vertical
    assert (v.pressure_coefficient, v.q_fz2, v.speed_coefficient) == (0.7, 15.0, 0.05)
    assert v.nominal_pressure == 220e3 == file.magic_formula.nominal_pressure
    rho = deflection_at_load(4000.0, 0.0, 220e3, v)
    assert float(vertical_stiffness(rho, 0.0, 220e3, v)) == pytest.approx(2.1e5, rel=1e-12)
    low, full = (slip_stiffness(4000.0, p, file.magic_formula)[1] for p in (176e3, 220e3))
    assert float(low / full) == pytest.approx(1.08, rel=1e-12)


def test_a_tire_measured_for_the_right_is_mirrored_on_the_left(small):
    with_shift = "PKY2 = 2.0\nPHY1 = 0.003\n"
    left = read_tire(small("PKY2 = 2.0\n", with_shift)).magic_formula
    right_side = "[MODEL]\nTYRESIDE = 'RIGHT'\nPHY1 = 0.003\n"
    right = read_tire(small("[MODEL]\n", right_side)).magic_formula
    force = [float(slip_forces(0.0, 0.0, 4e3, 0.0, 25e4, t).lateral) for t in (left, right)]
    assert force[0] == pytest.approx(-force[1], rel=1e-12)
    assert force[0] < -100
    negative = "[MODEL]\nUSE_MODE = -4\nPHY1 = 0.003\n"
    file = read_tire(small("[MODEL]\n", negative))
    assert file.magic_formula.measured_side == -1.0
    assert any("mirrored" in w for w in file.warnings)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("'PAC2002'", "'FTIRE'", "PROPERTY_FILE_FORMAT: 'FTIRE' is not read here"),
        ("PROPERTY_FILE_FORMAT", "OTHER", "PROPERTY_FILE_FORMAT: it is missing"),
        ("PKX1 = 20\n", "", "PKX1: the file has no such key"),
        ("FNOMIN = 4000\n", "", "FNOMIN: the file has no such key"),
        ("VERTICAL_STIFFNESS = 2.1e+005\n", "", "VERTICAL_STIFFNESS: the file has no such key"),
        ("PCY1 = 1.4", "PCY1 = 1,4", r"line 23: PCY1: '1,4' is no number"),
        ("PDX1 = 1.1", "PDX1 = nan", r"line 20: PDX1: 'nan' is no number"),
        ("PKX1 = 20", "PKX1 =", r"line 21: PKX1: '' is no number"),
        ("'newton'", "'pound_force'", "line 4: FORCE: the unit 'pound_force' is not read"),
        ("'radians'", "'degree'", "line 5: ANGLE: the unit 'degree' is not read"),
        ("PKY1 = -15", "PKY1 = 15", "PKY1: 15 is positive, so the file uses SAE axes"),
        ("PKY2 = 2.0", "PKY2 = 2.0\nPPY1 = 0.3", "NOMPRES: it is missing although"),
        ("= 0.34", "= 34.0", r"vertical_tire\.\w+|magic_formula\.unloaded_radius"),
        ("PKY2 = 2.0", "PKY2 = 2.0\nQFZ2 = 5000", "q_fz2: 5000 leaves no stiffness"),
    ],
)
def test_bad_files_are_refused_by_name(small, old, new, message):
    with pytest.raises(InputError, match=message):
        read_tire(small(old, new))


def test_what_is_no_property_file_is_told(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_tire(tmp_path / "absent.tir")
    with pytest.raises(InputError, match="cannot be read"):
        read_tire(tmp_path)
    for content in (b"x_m,z_m\n0,1\n", b"", b"\x89PNG\r\n\x1a\n\0\0[A]\nB = 1\n"):
        path = tmp_path / "other.tir"
        path.write_bytes(content)
        with pytest.raises(InputError, match="no tyre property file"):
            read_tire(path)


def run_command(*arguments):
    app = typer.Typer()
    app.command()(tire_command)
    result = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"}).invoke(
        app, [str(a) for a in arguments]
    )
    return result.exit_code, result.stdout + result.stderr


def test_the_command_shows_a_tire_and_writes_its_files(data, tmp_path):
    path = data / "tyre" / "chrono_tir" / "suv_Pac02Tire.tir"
    status, text = run_command(path, "--out", tmp_path / "out")
    assert status == 0, text
    assert "vertical stiffness" in text
    assert "248.3 kN/m" in text
    results = json.loads((tmp_path / "out" / "summary.json").read_text())["results"]
    assert results["rated_load_N"] == 4000.0
    assert results["inflation_pressure_Pa"] is None
    c = read_coefficients(path)
    lateral = [magic_formula(0.0, s, 4000.0, 0.0, c)[1] for s in np.linspace(-1, 1, 4001)]
    peak = (max(lateral) - min(lateral)) / 8000
    assert results["peak_friction_lateral"] == pytest.approx(peak, rel=1e-5)
    table = pq.read_table(tmp_path / "out" / "tire.parquet")
    assert table.schema.field("lateral_force").metadata[b"unit"] == b"N"
    row = {name: table[name][700].as_py() for name in table.column_names}
    expected = magic_formula(0.0, row["slip"], row["load"], 0.0, c)[1]
    assert row["lateral_force"] == pytest.approx(expected, rel=1e-10)
    assert (tmp_path / "out" / "tire.png").stat().st_size > 20_000


def test_the_command_refuses_a_bad_file_in_one_line(small, tmp_path):
    status, text = run_command(small("PKX1 = 20\n", ""), "--out", tmp_path / "out")
    assert status == 2
    assert "small.tir: PKX1: the file has no such key" in text
    assert not (tmp_path / "out").exists()


def test_every_axis_of_the_figure_has_its_unit(small):
    extra = "PKY2 = 2.0\nPFZ1 = 0.7\nNOMPRES = 220000\n"
    file = read_tire(small("PKY2 = 2.0\n", extra))
    figure = plot_tire(file.magic_formula, file.vertical)
    for ax in figure.axes:
        assert "[" in ax.get_xlabel()
        assert "[" in ax.get_ylabel()
    assert len(figure.axes[3].get_lines()) == 5  # four pressures and the rated load
