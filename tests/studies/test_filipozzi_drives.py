"""What the Filipozzi study drives, and its sensor noise."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.studies.filipozzi import drives as study
from wheelhop.studies.filipozzi.drives import (
    BRAKE,
    BRAKE_DAMPING,
    BRAKE_STIFFNESS,
    ROAD,
    SLOPE,
    SWEEP,
    Drive,
    cases,
    simulate,
)
from wheelhop.studies.filipozzi.sensed import DATASHEET_NOISE, noisy
from wheelhop.studies.filipozzi.settings import (
    QUICK,
    SPEED,
    FilipozziSettings,
    validate_settings,
)
from wheelhop.studies.filipozzi.vehicles import (
    barred_vehicle,
    digressive_vehicle,
    free_deflection,
    paper_vehicle,
)
from wheelhop.studies.frame import Store
from wheelhop.vehicle.corner_suspension import corner_suspensions
from wheelhop.vehicle.full_vehicle_parameters import suv
from wheelhop.vehicle.strut import damper_force, spring_force

GRAVITY = 9.80665
FULL = FilipozziSettings()


def quiet(done: int, total: int) -> None:
    assert 0 <= done <= total


def test_the_papers_vehicle_is_linear():
    car = paper_vehicle(stiffness=1.5, damping=0.5)
    plain = suv(anti_roll=False)
    s = jnp.asarray([-0.15, -0.02, 0.07, 0.15])
    expected = plain.strut.preload + 1.5 * plain.strut.stiffness * s
    np.testing.assert_allclose(spring_force(s, car.strut), expected, rtol=1e-12)
    slope = (damper_force(jnp.full(4, 1e-6), plain.strut)) / 1e-6
    np.testing.assert_allclose(damper_force(s, car.strut), 0.5 * slope * s, rtol=1e-4)
    fading = damper_force(jnp.full(4, 0.5), digressive_vehicle().strut)
    np.testing.assert_allclose(fading, damper_force(jnp.full(4, 0.5), plain.strut), rtol=1e-12)


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.5])
def test_a_free_spring_shows_the_mass_it_carries(factor):
    car = paper_vehicle(stiffness=factor)
    shown = free_deflection(np.zeros((2, 4)), car)
    mass = np.asarray(corner_suspensions(car).sprung_mass)
    believed = np.asarray(suv().strut.stiffness)
    np.testing.assert_allclose(believed * shown[1], mass * GRAVITY / factor, rtol=1e-9)


def test_bars_are_those_asked_for():
    assert float(barred_vehicle(0.0, 2.0).anti_roll.front) == 0.0
    assert float(barred_vehicle(0.0, 2.0).anti_roll.rear) == 2.0 * float(suv().anti_roll.rear)
    with pytest.raises(InputError, match="rear"):
        barred_vehicle(1.0, -1.0)


def test_every_figure_has_its_drive():
    every = cases(FULL)
    assert {*BRAKE_STIFFNESS.values(), *BRAKE_DAMPING.values(), ROAD} < set(every)
    stiff, soft = every[BRAKE_STIFFNESS[1.5]].vehicle, every[BRAKE_STIFFNESS[0.5]].vehicle
    np.testing.assert_allclose(stiff.strut.stiffness, 3.0 * soft.strut.stiffness)
    np.testing.assert_array_equal(stiff.strut.preload, soft.strut.preload)
    # 20 km/h over 1.6 m is 3.5 Hz when the front wheels reach the sweep's end at 20 s
    (sweep,), (slope,) = every[SWEEP].obstacles, every[SLOPE].obstacles
    ahead = 20 / 3.6 * 20.0 + float(every[SWEEP].vehicle.chassis.front_arm)
    assert sweep.start + sweep.length == pytest.approx(ahead)
    assert float(sweep.wavelength(jnp.asarray(ahead))) == pytest.approx(1.6)
    z = np.asarray(slope.elevation(jnp.asarray([50.0, 60.0])))
    assert np.diff(z) == pytest.approx(2.0)


def test_drives_keep_their_own_time_and_obey_newton():
    """A tenth of a second on two roads and two vehicles: the sum of forces is the acceleration."""
    every = cases(QUICK)
    short = {
        BRAKE: replace(every[BRAKE], duration=0.05),
        ROAD: replace(every[ROAD], duration=0.1, vehicle=barred_vehicle()),
    }
    found = simulate(short, FilipozziSettings(rate=500.0))
    assert [len(d.t) for d in found.values()] == [25, 50]
    assert found[ROAD].load.shape == (50, 4)
    car = paper_vehicle()
    suspension = corner_suspensions(car)
    weight = (float(car.chassis.body_mass) + float(suspension.unsprung_mass.sum())) * GRAVITY
    assert found[BRAKE].load.sum(1) == pytest.approx(weight, rel=2e-3)
    d = found[ROAD]
    assert np.ptp(d.load) > 100.0
    wheel = np.asarray(suspension.unsprung_mass) * (GRAVITY + d.wheel_acceleration)
    np.testing.assert_allclose(d.load, d.strut + wheel, rtol=2e-3)
    difference = d.compression[:, 0] - d.compression[:, 1]
    preload, stiffness, damping = (
        float(part[0]) for part in (suspension.preload, suspension.stiffness, suspension.damping)
    )
    alone = preload + stiffness * d.compression[:, 0] + damping * d.compression_rate[:, 0]
    np.testing.assert_allclose(d.strut[:, 0] - alone, 15e3 * difference, atol=0.05)


def still(samples: int) -> Drive:
    return Drive(np.arange(samples) / 1e3, *(np.zeros((samples, 4)) for _ in Drive._fields[1:]))


def test_the_papers_noise_is_held_for_its_correlation_time():
    found = noisy(still(2000), FilipozziSettings(runs=40), BRAKE)
    assert found.compression.shape == (40, 2000, 4)
    for signal, deviation in zip(found, (0.1, 0.1, 3.162e-4), strict=True):
        steps = signal.reshape(40, 200, 10, 4)
        assert np.ptp(steps, axis=2).max() == 0.0
        assert np.std(steps) == pytest.approx(deviation, rel=0.02)
        # one-sided sums of the autocorrelation: the spectral density at frequency zero
        density = np.var(signal.mean(1)) * 2.0
        assert density == pytest.approx(deviation**2 * 0.01, rel=0.3)
    again = noisy(still(2000), FilipozziSettings(runs=40), BRAKE)
    np.testing.assert_array_equal(found.compression, again.compression)
    other = noisy(still(2000), FilipozziSettings(runs=40), ROAD)
    assert abs(np.corrcoef(found.compression.ravel(), other.compression.ravel())[0, 1]) < 0.05


def test_datasheet_noise_is_white():
    found = noisy(still(2000), QUICK, BRAKE, DATASHEET_NOISE)
    for signal, deviation in zip(found, (0.5, 0.5, 5e-4), strict=True):
        assert np.std(signal) == pytest.approx(deviation, rel=0.03)
        assert abs(np.mean(signal[:, 1:] * signal[:, :-1])) < 0.03 * deviation**2
    with pytest.raises(InputError, match="kind"):
        noisy(still(10), QUICK, BRAKE, "pink")


def test_kept_drives_come_back(monkeypatch, tmp_path):
    asked = []

    def instead(every, settings):
        asked.append(settings)
        return {name: still(5)._replace(t=np.full(5, k)) for k, name in enumerate(every)}

    monkeypatch.setattr(study, "simulate", instead)
    for _ in range(2):
        found = study.drives(QUICK, Store(tmp_path), quiet)
    assert len(asked) == 1
    assert list(found) == list(cases(QUICK))
    assert [d.t[0] for d in found.values()] == list(range(len(found)))


def test_settings_out_of_range_are_refused():
    assert validate_settings(QUICK) is QUICK
    with pytest.raises(InputError, match="bandwidth"):
        validate_settings(FilipozziSettings(rate=500.0, bandwidth=200.0))
    assert validate_settings(FilipozziSettings(seed=2**32 - 1)).seed == 4294967295
    with pytest.raises(InputError, match="seed"):
        validate_settings(FilipozziSettings(seed=2**32))
    assert SPEED == 25.0
