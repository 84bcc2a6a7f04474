"""OpenCRG files: measured surfaces in, and one clear message for each broken file."""

import sys

import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.io.opencrg import read_opencrg
from wheelhop.io.roads import read_road
from wheelhop.vehicle.road.tracks import profile_along

crg = pytest.importorskip("pyopencrg")


@pytest.fixture(scope="module")
def intact(data):
    return data / "roads/opencrg/belgian_block.crg"


@pytest.mark.parametrize("inches", [1, 2])
def test_ride_course_equals_the_table_derived_from_it(data, inches):
    """The table leaves out the flat lead-in and rounds to micrometres."""
    grid = read_opencrg(data / f"roads/chrono_crg/detrended_rms_course_{inches}in.crg")
    table, _ = read_road(data / f"roads/normalized/krc_rms_course_{inches}in.csv")
    assert grid.spacing == pytest.approx(table.spacing)
    assert (grid.lateral[0], grid.lateral[-1]) == (-3.0, 3.0)
    track = profile_along(grid, 0.8).elevation
    begin = round(100.0 / grid.spacing)
    differences = [
        np.abs(np.diff(track[k : k + len(table.elevation)]) - np.diff(table.elevation)).max()
        for k in range(begin - 3, begin + 4)
    ]
    assert min(differences) < 2.1e-6
    assert sorted(differences)[1] > 1e-3


def test_belgian_block_equals_the_table_derived_from_it(data, intact):
    grid = read_opencrg(intact, unroll=True)
    assert grid.elevation.shape == (341, 1001)
    assert np.all(np.isfinite(grid.elevation))
    for lateral in (-1.2, -0.8, -0.4, 0.0, 0.4, 0.8, 1.2):
        table, _ = read_road(data / "roads/normalized/belgian_block_7tracks.csv", f"z_v{lateral:+}")
        track = profile_along(grid, lateral).elevation
        np.testing.assert_allclose(track - track[0], table.elevation, atol=1.1e-6)


def test_a_curved_road_is_refused_unless_it_is_unrolled(intact):
    with pytest.raises(InputError, match=r"line is curved, with a radius down to 26\.1 m"):
        read_opencrg(intact)


def test_a_written_surface_comes_back_with_slope_and_banking(tmp_path):
    rng = np.random.default_rng(0)
    z = rng.normal(scale=0.01, size=(80, 5))
    road = crg.CrgRoad(z, u_inc=0.1, v_inc=0.5, slope=0.02, banking=0.03)
    for fmt in ("KDBI", "LDFI"):
        road.save(tmp_path / "road.crg", fmt=fmt)
        grid = read_opencrg(tmp_path / "road.crg")
        x, y = 0.1 * np.arange(80), 0.5 * np.arange(-2, 3)
        expected = z.T + 0.02 * x[None, :] + 0.03 * y[:, None]
        np.testing.assert_allclose(grid.elevation, expected, atol=1e-9)
        np.testing.assert_allclose(grid.lateral, y, atol=1e-12)


def test_unmeasured_edges_are_continued_and_uneven_sections_made_even(tmp_path):
    v = np.array([-1.0, -0.5, 0.0, 1.0])
    z = np.tile(0.1 * v, (20, 1))
    z[3, 0] = z[7, 3] = np.nan
    crg.CrgRoad(z, u_inc=0.1, v=v).save(tmp_path / "road.crg", fmt="KDBI")
    grid = read_opencrg(tmp_path / "road.crg")
    np.testing.assert_allclose(grid.lateral, [-1.0, -0.5, 0.0, 0.5, 1.0])
    np.testing.assert_allclose(grid.elevation[:, 0], 0.1 * grid.lateral, atol=1e-12)
    np.testing.assert_allclose(grid.elevation[:, 3], [-0.05, -0.05, 0.0, 0.05, 0.1], atol=1e-12)
    np.testing.assert_allclose(grid.elevation[:, 7], [-0.1, -0.05, 0.0, 0.0, 0.0], atol=1e-12)


def test_a_hole_is_refused(tmp_path):
    z = np.zeros((20, 5))
    z[6, 2] = np.nan
    crg.CrgRoad(z, u_inc=0.1, v_inc=0.5).save(tmp_path / "road.crg", fmt="KDBI")
    with pytest.raises(InputError, match="cross section 7 has a hole"):
        read_opencrg(tmp_path / "road.crg")


def refuse(path, content, match):
    path.write_bytes(content)
    with pytest.raises(InputError, match=match):
        read_opencrg(path, unroll=True)


def test_converted_line_endings_are_found(intact, tmp_path):
    content = intact.read_bytes().replace(b"\n", b"\r\n")
    refuse(tmp_path / "road.crg", content, "it is corrupted.*converted line ending")


@pytest.mark.parametrize("kept", [0.9999, 0.5, 0.02, 0.006, 0.0005])
def test_a_truncated_file_is_found(intact, tmp_path, kept):
    content = intact.read_bytes()
    refuse(tmp_path / "road.crg", content[: int(kept * len(content))], "corrupted|no OpenCRG file")


def test_whole_records_missing_at_the_end_are_found(intact, tmp_path):
    """342 floats a record and 80 bytes a block: ten records less still fill whole blocks."""
    content = intact.read_bytes()
    refuse(tmp_path / "road.crg", content[: -342 * 4 * 10], "corrupted|no OpenCRG file")


def test_other_files_are_no_opencrg(tmp_path):
    refuse(tmp_path / "road.crg", b"x_m,z_m\n0,0\n1,0.1\n", "it is no OpenCRG file")
    refuse(tmp_path / "road.crg", b"", "it is no OpenCRG file")
    refuse(tmp_path / "road.crg", bytes(range(256)) * 40, "it is no OpenCRG file")
    with pytest.raises(InputError, match="there is no such file"):
        read_opencrg(tmp_path / "missing.crg")
    with pytest.raises(InputError, match="it is a directory"):
        read_opencrg(tmp_path)


def test_the_missing_package_is_named_with_its_remedy(intact, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyopencrg", None)
    with pytest.raises(InputError, match=r'pip install "wheelhop\[io\]"'):
        read_opencrg(intact)
