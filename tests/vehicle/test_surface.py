"""The road surface under four wheels: spline, envelopes, lanes, measured tracks."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.io.results import write_table
from wheelhop.io.roads import read_road
from wheelhop.plots.surface import plot_surface
from wheelhop.vehicle.road.envelope import Cam, Envelope, moving_average, tandem_cam
from wheelhop.vehicle.road.profile import Profile
from wheelhop.vehicle.road.surface import (
    enveloped,
    flat_surface,
    road_under,
    surface_from_grid,
    surface_from_tracks,
)
from wheelhop.vehicle.road.tracks import (
    RoadGrid,
    grid_points,
    profile_along,
    tracks_from_profiles,
    with_lead_in,
)

RNG = np.random.default_rng(5)
under = jax.jit(road_under)
WAVENUMBERS = np.array([0.6, 1.1, 1.7, 2.3])


def waves(x, wavenumbers=WAVENUMBERS):
    """Elevation and slope of one sine a wheel, x [..., 4]."""
    return np.sin(wavenumbers * x), wavenumbers * np.cos(wavenumbers * x)


def wave_surface(spacing, start=-5.0, length=40.0, envelope=None):
    x = start + spacing * np.arange(round(length / spacing) + 1)
    tracks = waves(x[:, None])[0].T
    return surface_from_tracks(tracks, spacing, start, envelope or Envelope("point"))


def random_tracks(points=240, spacing=0.05):
    return 0.003 * np.cumsum(RNG.normal(size=(4, points)), axis=1), spacing


def test_a_flat_road_is_flat_everywhere_and_at_any_height():
    surface = flat_surface(0.3)
    found = under(surface, jnp.array([-1e4, 0.0, 12.3, 1e6]), jnp.array([0.0, 1.0, -9.0, 3.0]))
    contact = enveloped(found, jnp.full(4, 0.08), surface)
    np.testing.assert_allclose(contact.elevation, 0.3, rtol=1e-15)
    assert not np.any(contact.slope_x)
    assert not np.any(contact.slope_y)


def test_the_spline_is_of_fourth_order_in_elevation_and_third_in_slope():
    x = RNG.uniform(0.0, 30.0, 4 * 200).reshape(4, 200)
    elevation, slope = (a.T for a in waves(x.T))

    def errors(spacing):
        found = under(wave_surface(spacing), jnp.asarray(x), jnp.zeros((4, 200)))
        error_z = np.abs(found.elevation[0] - elevation).max()
        return error_z, np.abs(found.slope_x[0] - slope).max()

    (coarse_z, coarse_s), (fine_z, fine_s) = errors(0.02), errors(0.01)
    assert np.log2(coarse_z / fine_z) == pytest.approx(4.0, abs=0.05)
    assert np.log2(coarse_s / fine_s) == pytest.approx(3.0, abs=0.2)
    assert errors(0.1)[0] < 2e-4


def test_a_cubic_road_is_reproduced_exactly():
    x = 0.5 * np.arange(60)
    cubic = lambda s: 1e-3 * s**3 - 0.02 * s**2 + 0.3 * s  # noqa: E731
    surface = surface_from_tracks(np.tile(cubic(x), (4, 1)), 0.5)
    places = np.array([2.3, 10.0, 17.77, 26.4])
    found = under(surface, jnp.asarray(places), jnp.zeros(4))
    np.testing.assert_allclose(found.elevation[0], cubic(places), rtol=1e-12)
    np.testing.assert_allclose(found.slope_x[0], 3e-3 * places**2 - 0.04 * places + 0.3, rtol=1e-11)


@pytest.mark.parametrize("kind", ["point", "moving_average"])
def test_slope_is_the_derivative_of_elevation_also_where_the_road_ends(kind):
    tracks, spacing = random_tracks()
    surface = surface_from_tracks(tracks, spacing, -2.0, Envelope(kind))
    x = jnp.asarray(
        np.r_[np.linspace(-2.3, -1.8, 12), np.linspace(9.8, 10.3, 12), RNG.uniform(size=8)]
    )
    x = x.reshape(4, -1)

    @jax.jit
    @jax.grad
    def derivative(x):
        return jnp.sum(road_under(surface, x, jnp.zeros_like(x)).elevation[-1])

    slope = under(surface, x, jnp.zeros_like(x)).slope_x[-1]
    np.testing.assert_allclose(derivative(x), slope, atol=1e-12)


def test_elevation_slope_and_curvature_are_continuous_across_cells_and_ends():
    tracks, spacing = random_tracks()
    surface = surface_from_tracks(tracks, spacing)
    knots = spacing * np.array([-4, -3, -2, -1, 0, 1, 57, 238, 239, 240, 241, 242])
    gap = 1e-9

    def at(x):
        x = jnp.asarray(np.broadcast_to(x, (4, len(knots))))
        found = under(surface, x, jnp.zeros_like(x))
        return found.elevation[0], found.slope_x[0]

    z, s = at(knots - gap)
    z_after, s_after = at(knots + gap)
    np.testing.assert_allclose(z, z_after, atol=1e-8)
    np.testing.assert_allclose(s, s_after, atol=1e-6)


def test_beyond_its_ends_the_road_stays_at_its_end_elevation():
    tracks, spacing = random_tracks()
    surface = surface_from_tracks(tracks, spacing, start=-3.0)
    for x, column in ((-3.0 - 4 * spacing, 0), (-500.0, 0), (9.2, -1), (1e5, -1)):
        found = under(surface, jnp.full(4, x), jnp.zeros(4))
        np.testing.assert_allclose(found.elevation[0], tracks[:, column], atol=1e-15)
        np.testing.assert_allclose(found.slope_x[0], 0.0, atol=1e-13)


def test_rear_wheels_see_what_the_front_wheels_saw_a_wheelbase_earlier():
    """Cross-correlation of front and rear elevation over time peaks at l / v."""
    wheelbase, speed, dt, spacing = 2.818, 20.0, 1e-3, 0.02
    track = np.convolve(RNG.normal(size=6000), np.hanning(40), mode="same")
    surface = surface_from_tracks(np.tile(track, (4, 1)), spacing, start=-5.0)
    x_front = speed * dt * np.arange(5000)
    x = np.stack([x_front, x_front, x_front - wheelbase, x_front - wheelbase])
    z = np.asarray(under(surface, jnp.asarray(x), jnp.zeros_like(x)).elevation[0])
    front, rear = z[0] - z[0].mean(), z[2] - z[2].mean()
    lags = np.arange(0, 300)
    match = [np.dot(front[: 5000 - 300], rear[k : k + 5000 - 300]) for k in lags]
    assert lags[int(np.argmax(match))] * dt * speed == pytest.approx(wheelbase, abs=speed * dt)


def test_a_grid_is_linear_across_and_constant_beside_the_road():
    x = 0.1 * np.arange(100)
    y = np.array([-1.0, -0.5, 0.0, 0.5])
    z = 0.2 * np.sin(0.4 * x)[None, :] + 0.05 * y[:, None]
    surface = surface_from_grid(z, 0.1, 0.0, -1.0, 0.5)
    sides = jnp.array([0.3, -0.72, 3.0, -3.0])
    found = under(surface, jnp.full(4, 4.0), sides)
    expected = 0.2 * np.sin(1.6) + 0.05 * np.clip(sides, -1.0, 0.5)
    np.testing.assert_allclose(found.elevation[0], expected, atol=1e-6)
    np.testing.assert_allclose(found.slope_x[0], 0.08 * np.cos(1.6), atol=1e-5)
    np.testing.assert_allclose(found.slope_y[0], [0.05, 0.05, 0.0, 0.0], atol=1e-12)
    across = lambda v: jnp.sum(road_under(surface, jnp.full(4, 4.0), v).elevation)  # noqa: E731
    np.testing.assert_allclose(jax.jit(jax.grad(across))(sides), found.slope_y[0], atol=1e-12)


@pytest.mark.parametrize("half_length", [0.04, 0.0613, 0.1, 0.25])
def test_moving_average_of_a_sine_is_a_sinc(half_length):
    spacing, wavenumber = 0.002, 9.0
    x = spacing * np.arange(4000)
    z = jnp.asarray(np.sin(wavenumber * x))
    inner = slice(200, -200)
    expected = np.sinc(wavenumber * half_length / np.pi) * np.sin(wavenumber * x)
    found = np.asarray(moving_average(z, spacing, half_length))
    np.testing.assert_allclose(found[inner], expected[inner], atol=5e-5)


@pytest.mark.parametrize("half_length", [0.013, 0.05, 0.08, 0.1234])
def test_moving_average_is_exact_for_a_piecewise_linear_road(half_length):
    tracks, spacing = random_tracks(points=80)
    x = spacing * np.arange(80)
    found = np.asarray(moving_average(jnp.asarray(tracks), spacing, half_length))
    for k in (5, 33, 70):
        edges = np.unique(
            np.clip(
                np.r_[x, x[k] - half_length, x[k] + half_length],
                x[k] - half_length,
                x[k] + half_length,
            )
        )
        for z, value in zip(tracks, found[:, k], strict=True):
            exact = np.trapezoid(np.interp(edges, x, z), edges) / (2 * half_length)
            assert value == pytest.approx(exact, abs=1e-13)


def brute_force_cam(x, z, at, half_length, cam):
    """Tandem cam by lowering two finely drawn ellipses onto a finely drawn road."""

    def lowest(center):
        t = np.linspace(-cam.half_length, cam.half_length, 20001)
        profile = cam.half_height * (1 - np.abs(t / cam.half_length) ** cam.exponent) ** (
            1 / cam.exponent
        )
        return np.max(np.interp(center + t, x, z) + profile) - cam.half_height

    apart = 2 * cam.shift * half_length
    front, rear = lowest(at + apart / 2), lowest(at - apart / 2)
    return (front + rear) / 2, (front - rear) / apart


def test_tandem_cam_equals_two_ellipses_lowered_by_brute_force():
    spacing, half_length, cam = 0.005, 0.08, Cam()
    x = spacing * np.arange(801)
    z = np.where((x > 1.5) & (x < 1.8), 0.02, 0.0) + 0.01 * np.sin(2 * x)
    z = np.convolve(z, np.full(9, 1 / 9), mode="same")
    height, slope = tandem_cam(jnp.asarray(z), spacing, half_length, cam)
    for k in (200, 260, 285, 300, 330, 375, 420, 600):
        expected = brute_force_cam(x, z, x[k], half_length, cam)
        assert float(height[k]) == pytest.approx(expected[0], abs=1e-4)
        assert float(slope[k]) == pytest.approx(expected[1], abs=1.5e-3)


def test_tandem_cam_rises_before_a_step_and_leaves_a_plane_as_it_is():
    spacing, half_length, cam = 0.005, 0.08, Cam()
    x = spacing * np.arange(801)
    step = np.where(x > 2.0, 0.03, 0.0)
    height, slope = (np.asarray(v) for v in tandem_cam(jnp.asarray(step), spacing, half_length))
    lifted = x[np.argmax(height > 1e-6)]
    # a cam touches the edge of a step of height h at a (1 - (1 - h/b)^c)^(1/c) before it
    reach = cam.half_length * (1 - (1 - 0.03 / cam.half_height) ** cam.exponent) ** (
        1 / cam.exponent
    )
    assert lifted == pytest.approx(2.0 - reach - cam.shift * half_length, abs=2 * spacing)
    assert slope.max() > 0.1
    plane, gradient = tandem_cam(jnp.asarray(0.05 * x), spacing, half_length)
    np.testing.assert_allclose(gradient[200:-200], 0.05, atol=1e-9)
    assert np.ptp(np.asarray(plane - 0.05 * x)[200:-200]) < 1e-12


def test_half_lengths_in_between_are_interpolated():
    """Quadratic in the half-length: against the average over exactly that length."""
    tracks, spacing = random_tracks(points=400, spacing=0.02)
    x = jnp.asarray([1.0, 2.5, 3.33, 6.1])
    bank = surface_from_tracks(tracks, spacing, 0.0, Envelope())
    found = enveloped(under(bank, x, jnp.zeros(4)), jnp.full(4, 0.07), bank)
    exact = surface_from_tracks(tracks, spacing, 0.0, Envelope(half_lengths=(0.07,)))
    expected = under(exact, x, jnp.zeros(4))
    raw = under(surface_from_tracks(tracks, spacing), x, jnp.zeros(4))
    error = np.abs(found.elevation - expected.elevation[0]).max()
    assert error < 0.1 * np.abs(raw.elevation - expected.elevation).max()
    clipped = enveloped(under(bank, x, jnp.zeros(4)), jnp.full(4, 9.0), bank)
    np.testing.assert_allclose(clipped.elevation, under(bank, x, jnp.zeros(4)).elevation[-1])


@pytest.mark.parametrize("kind", ["point", "moving_average", "tandem_cam"])
def test_lanes_equal_separate_runs_on_a_shared_road_and_on_roads_of_their_own(kind):
    roads = jnp.asarray(np.stack([random_tracks(points=120)[0] for _ in range(3)]))
    make = jax.jit(lambda z: surface_from_tracks(z, 0.05, -1.0, Envelope(kind)))
    own = jax.jit(jax.vmap(make, out_axes=-1))(roads)
    x, y = jnp.asarray(RNG.uniform(-2, 6, (4, 3))), jnp.zeros((4, 3))
    half = jnp.asarray(RNG.uniform(0.04, 0.13, (4, 3)))
    contact = jax.jit(lambda s: enveloped(road_under(s, x, y), half, s))
    one = jax.jit(lambda s, k: enveloped(road_under(s, x[:, k], y[:, k]), half[:, k], s))
    shared = make(roads[0])
    for k in range(3):
        for many, alone in (
            (contact(own), one(make(roads[k]), k)),
            (contact(shared), one(shared, k)),
        ):
            for a, b in zip(many, alone, strict=True):
                np.testing.assert_allclose(a[..., k], b, rtol=1e-12, atol=1e-15)


def test_gradients_to_places_road_and_half_length_are_finite():
    tracks, spacing = random_tracks(points=60)

    @jax.jit
    @partial(jax.grad, argnums=(0, 1, 2))
    def gradients(tracks, x, half):
        surface = surface_from_tracks(tracks, spacing, 0.0, Envelope())
        return sum(jnp.sum(v) for v in enveloped(road_under(surface, x, 0 * x), half, surface))

    x = jnp.array([-9.0, 0.0, 1.0, 99.0])
    for half in (0.08, 0.01, 0.5):
        found = gradients(jnp.asarray(tracks), x, jnp.full(4, half))
        assert all(np.all(np.isfinite(g)) for g in found)
        assert np.any(found[0])


@pytest.mark.usefixtures("float32")
def test_single_precision_keeps_elevation_and_slope_far_down_the_road():
    spacing, start = 0.02, 0.0
    x = spacing * np.arange(100_001)
    track = (0.01 * np.sin(0.7 * x)).astype(np.float32)
    surface = surface_from_tracks(np.tile(track, (4, 1)), spacing, start)
    places = np.float32([3.0, 511.03, 1203.771, 1999.0])
    found = road_under(surface, jnp.asarray(places), jnp.zeros(4, jnp.float32))
    assert found.elevation.dtype == jnp.float32
    exact = places.astype(float)
    np.testing.assert_allclose(found.elevation[0], 0.01 * np.sin(0.7 * exact), atol=3e-6)
    np.testing.assert_allclose(found.slope_x[0], 0.007 * np.cos(0.7 * exact), atol=3e-5)


def test_bad_surfaces_are_refused():
    flat = np.zeros((4, 10))
    with pytest.raises(InputError, match="tracks: there are 2"):
        surface_from_tracks(flat[:2], 0.1)
    with pytest.raises(InputError, match=r"spacing: 0 m is not positive"):
        surface_from_tracks(flat, 0.0)
    with pytest.raises(InputError, match="road: it has 1 points"):
        surface_from_tracks(flat[:, :1], 0.1)
    with pytest.raises(InputError, match="envelope: 'carpet' is unknown"):
        surface_from_tracks(flat, 0.1, 0.0, Envelope("carpet"))
    with pytest.raises(InputError, match="not positive and increasing"):
        surface_from_tracks(flat, 0.1, 0.0, Envelope(half_lengths=(0.1, 0.05)))
    with pytest.raises(InputError, match=r"lateral_spacing: -1 m"):
        surface_from_grid(flat, 0.1, 0.0, 0.0, -1.0)


def test_measured_profiles_become_tracks_with_a_flat_smooth_start(data):
    left, _ = read_road(data / "roads/normalized/lidar_czech_B.csv")
    right = Profile(left.spacing, left.elevation[::-1].copy())
    tracks = tracks_from_profiles(left, right, 0.25, start=-5.0, lead_in=10.0)
    x = grid_points(-5.0, left.length, 0.25)
    assert tracks.shape == (4, len(x))
    assert not np.any(tracks[:, x <= 0])
    datum = 0.5 * (left.elevation[0] + right.elevation[0])
    late = x >= 10.0
    expected = np.stack([p.elevation[-late.sum() :] - datum for p in (left, right, left, right)])
    np.testing.assert_allclose(tracks[:, late], expected, atol=1e-12)


def test_a_short_profile_is_reflected_only_if_asked():
    x = 0.1 * np.arange(101)
    profile = Profile(0.1, np.sin(x))
    with pytest.raises(InputError, match="20 m is beyond the road"):
        tracks_from_profiles(profile, None, 0.1, length=20.0)
    tracks = tracks_from_profiles(
        profile, None, 0.1, length=20.0, start=0.0, lead_in=0.0, reflect=True
    )
    np.testing.assert_allclose(tracks[0, 1:101], np.sin(x[1:]), atol=1e-9)
    np.testing.assert_allclose(tracks[0, 101:], np.sin(x[::-1])[1:], atol=1e-9)


def test_a_coarser_grid_does_not_alias():
    """Waves of 0.15 m, which 0.25 m points would fold into long ones, disappear."""
    x = 0.02 * np.arange(5001)
    profile = Profile(0.02, 0.01 * np.sin(2 * np.pi * x / 0.15))
    tracks = tracks_from_profiles(profile, None, 0.25, start=0.0, lead_in=0.0)
    assert np.abs(tracks[:, 40:-40]).max() < 1e-5


def test_a_road_written_to_a_table_comes_back_as_the_same_tracks(tmp_path):
    left = Profile(0.1, 0.01 * RNG.normal(size=300))
    columns = {"x_m": left.distance, "z_m": left.elevation}
    write_table(tmp_path / "road.parquet", columns, {"x_m": "m", "z_m": "m"})
    again, _ = read_road(tmp_path / "road.parquet")
    a, b = (tracks_from_profiles(p, None, 0.1) for p in (left, again))
    np.testing.assert_allclose(a, b, atol=1e-12)


def test_tracks_along_a_grid_are_linear_between_its_rows():
    grid = RoadGrid(0.1, -1.0, 0.5, RNG.normal(size=(5, 30)))
    middle = profile_along(grid, 0.25)
    np.testing.assert_allclose(middle.elevation, 0.5 * (grid.elevation[2] + grid.elevation[3]))
    np.testing.assert_allclose(profile_along(grid, 1.0).elevation, grid.elevation[-1])
    with pytest.raises(InputError, match=r"1\.2 m is beside the road"):
        profile_along(grid, 1.2)


def test_lead_in_ends_where_the_road_begins_unchanged():
    x = jnp.linspace(-5.0, 20.0, 251)
    road = jnp.ones((4, 251))
    found = np.asarray(with_lead_in(road, x, 8.0))
    assert not np.any(found[:, x <= 0])
    assert np.all(found[:, x >= 8.0] == 1.0)
    assert np.all(np.diff(found[0]) >= 0)


def test_the_figure_of_a_surface_draws_rough_one_sided_and_flat_roads(tmp_path):
    rough = 0.001 * np.cumsum(RNG.normal(size=(4, 2000)), axis=1)
    rough[2:] = rough[:2]
    one_sided, flat = rough * np.array([[1.0], [0.0], [1.0], [0.0]]), np.zeros((4, 200))
    figure = plot_surface(rough, 0.05, -5.0, title="rough")
    tracks, spectra, coherence = figure.axes
    assert len(tracks.lines) == len(spectra.lines) == 2
    assert len(coherence.lines) == 2
    np.testing.assert_allclose(tracks.lines[1].get_ydata(), 1e3 * rough[1])
    measured, law = (line.get_ydata() for line in coherence.lines)
    assert np.all((measured >= 0) & (measured <= 1))
    assert np.all(np.diff(law) <= 0)
    assert len(plot_surface(one_sided, 0.05).axes[2].lines) == 1
    plot_surface(flat, 0.05).savefig(tmp_path / "flat.png")
    with pytest.raises(InputError, match="tracks: they have 20 points"):
        plot_surface(flat[:, :20], 0.05)
