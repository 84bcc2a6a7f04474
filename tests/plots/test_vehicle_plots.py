"""Pictures of a drive: axes with units, resonances where they are, motion drawn as it was."""

import numpy as np
import pytest
from PIL import Image
from scipy.signal import lfilter

from wheelhop.errors import InputError
from wheelhop.plots.animation import animation_frames, frame_count, write_animation
from wheelhop.plots.car_outline import spring_line, tire_outline
from wheelhop.plots.motion import motion_of
from wheelhop.plots.resonances import (
    corner_spectrum,
    peak_of_wheel_hop,
    plot_corner_spectrum,
    wheel_response,
)
from wheelhop.plots.vehicle import plot_vehicle_record
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.simulation import Signals
from wheelhop.vehicle.vehicle_record import VehicleRecord

CORNERS = ("FL", "FR", "RL", "RR")
SINGLE = {
    *("speed", "lateral_speed", "a_x", "a_y", "a_z", "roll_rate", "pitch_rate", "yaw_rate"),
    *("roll", "pitch", "yaw", "x", "y", "z"),
}
RATE = 250.0
HOPS = (10.0, 11.0, 12.0, 10.5)


@pytest.fixture(scope="module")
def vehicle():
    return suv()


def resonator(signal, hertz, damping=0.15):
    """A two-pole resonance by its recursion: peak near `hertz`."""
    radius = np.exp(-damping * 2 * np.pi * hertz / RATE)
    poles = [1.0, -2 * radius * np.cos(2 * np.pi * hertz / RATE), radius**2]
    return lfilter([1.0, 0.0, -1.0], poles, signal)


def record(vehicle, seconds=16.0, rough=True, **changes):
    """At 20 m/s on the level, at rest on its wheels; every wheel rings at its own frequency."""
    rng = np.random.default_rng(0)
    n = round(seconds * RATE)
    t = np.arange(1, n + 1) / RATE
    velocity = rng.normal(size=(n, 4)) * (0.1 if rough else 0.0)
    fields = {name: np.zeros(n if name in SINGLE else (n, 4)) for name in Signals._fields}
    deflection = np.full((n, 4), 0.02)
    hub = np.asarray(vehicle.chassis.hub_drop) + np.asarray(vehicle.tire.vertical.unloaded_radius)
    fields |= {
        "speed": np.full(n, 20.0),
        "x": 20.0 * t,
        "z": np.full(n, float(np.mean(hub)) - 0.02),
        "load": np.full((n, 4), 5e3),
        "tire_deflection": deflection,
        "pressure": np.full((n, 4), 2e5),
        "elevation": np.cumsum(velocity, axis=0) / RATE,
        "wheel_acceleration": np.stack(
            [resonator(velocity[:, k], HOPS[k]) for k in range(4)], axis=1
        ),
    }
    truth = Signals(**(fields | changes))
    measured = {f"a_u_{c}": truth.wheel_acceleration[:, k] for k, c in enumerate(CORNERS)}
    measured |= {f"a_s_{c}": 0.1 * measured[f"a_u_{c}"] for c in CORNERS}
    measured |= {"steering_wheel": 0.1 * np.sin(t)}
    return VehicleRecord(t, measured, truth, {})


@pytest.mark.parametrize("plot", [plot_vehicle_record, plot_corner_spectrum])
def test_every_axis_has_a_label_with_a_unit(plot, vehicle, tmp_path):
    figure = plot(record(vehicle), "a drive")
    for ax in figure.axes:
        assert "[" in ax.get_ylabel()
    figure.savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_the_overview_draws_the_data_in_its_units(vehicle):
    axes = plot_vehicle_record(record(vehicle)).axes
    lines = {line.get_label(): line.get_ydata() for ax in axes for line in ax.lines}
    np.testing.assert_allclose(lines["speed"], 72.0)
    loads = next(ax for ax in axes if ax.get_ylabel() == "tyre load [kN]")
    np.testing.assert_allclose([line.get_ydata()[0] for line in loads.lines], 5.0)


def test_the_wheel_hop_is_found_where_each_wheel_rings(vehicle):
    r = record(vehicle, 60.0)
    found = [peak_of_wheel_hop(r, corner) for corner in CORNERS]
    np.testing.assert_allclose(found, HOPS, atol=0.6)
    f, response = wheel_response(r, "FL")
    # the recursion's own response, by its transfer function
    radius = np.exp(-0.15 * 2 * np.pi * 10.0 / RATE)
    z = np.exp(2j * np.pi * f / RATE)
    poles = 1 - 2 * radius * np.cos(2 * np.pi * 10.0 / RATE) / z + radius**2 / z**2
    # elevation is the velocity's sum, and its central difference a mean over two samples
    mean = np.abs(np.cos(np.pi * f / RATE))
    expected = np.abs((1 - z**-2) / poles) / mean
    inside = (f > 5) & (f < 20)
    np.testing.assert_allclose(response[inside], expected[inside], rtol=0.25)


def test_no_hop_is_claimed_of_a_flat_road_or_a_short_record(vehicle):
    assert peak_of_wheel_hop(record(vehicle, rough=False), "FL") is None
    assert peak_of_wheel_hop(record(vehicle, 2.0), "FL") is None
    with pytest.raises(InputError, match="too short for a spectrum"):
        corner_spectrum(record(vehicle, 2.0), "a_s_FL")


def test_power_under_the_spectrum_is_the_variance(vehicle):
    r = record(vehicle, 60.0)
    f, density = corner_spectrum(r, "a_u_FL")
    power = np.sum(density) * (f[1] - f[0])
    assert power == pytest.approx(np.var(r.measured["a_u_FL"]), rel=0.1)


def test_at_rest_nothing_is_exaggerated_and_the_tyres_touch_the_road(vehicle):
    m = motion_of(record(vehicle, 1.0, rough=False), vehicle)
    np.testing.assert_allclose(m.heave, 0.0, atol=1e-9)
    np.testing.assert_allclose(m.hub - m.below, 0.34, atol=1e-12)
    assert m.scale == 20


def test_a_small_pitch_is_drawn_larger_and_a_hill_as_steep_as_it_is(vehicle):
    n = round(RATE)
    m = motion_of(record(vehicle, 1.0, rough=False, pitch=np.full(n, 0.01)), vehicle)
    np.testing.assert_allclose(m.pitch, m.scale * 0.01)
    assert m.scale == 10
    flat = record(vehicle, 8.0, rough=False)
    x, c = flat.truth.x, vehicle.chassis
    arm = np.array([c.front_arm, c.front_arm, -c.rear_arm, -c.rear_arm], float)
    climb = 0.1 * (x[:, None] + arm)
    uphill = flat.truth._replace(elevation=climb, pitch=np.full(len(x), -np.arctan(0.1)))
    m = motion_of(VehicleRecord(flat.t, flat.measured, uphill, {}), vehicle)
    middle = slice(len(x) // 3, 2 * len(x) // 3)
    np.testing.assert_allclose(m.slope[middle], 0.1, atol=1e-6)
    np.testing.assert_allclose(m.pitch[middle], 0.0, atol=1e-6)


def test_the_animation_plays_in_real_time(vehicle, tmp_path):
    r = record(vehicle, 1.0, y=np.linspace(0.0, 3.5, round(RATE)))
    done = []
    path = write_animation(
        tmp_path / "drive.gif", r, vehicle, frame_rate=10, on_progress=lambda k, n: done.append(k)
    )
    with Image.open(path) as picture:
        assert picture.n_frames == frame_count(r, 10) == 10
        assert picture.info["duration"] == 100
    assert done == list(range(1, 11))
    with pytest.raises(InputError, match="frame_rate"):
        write_animation(path, r, vehicle, frame_rate=500)


def test_frames_differ_only_where_something_moves(vehicle):
    frames = list(animation_frames(record(vehicle, 1.0), vehicle, "a title", 5))
    assert frames[0].shape == frames[-1].shape
    changed = np.any(frames[0] != frames[-1], axis=(1, 2))
    assert changed.any()
    assert not changed.all()


def test_outlines_stretch_to_the_road():
    for below in (0.2, 0.34, 0.5):
        assert tire_outline(0.36, below)[:, 1].min() == pytest.approx(-below, rel=1e-2)
    x, z = spring_line(np.array([1.0, 0.3]), np.array([1.0, 0.9]))
    assert (x[0], z[0], z[-1]) == pytest.approx((1.0, 0.3, 0.9))
