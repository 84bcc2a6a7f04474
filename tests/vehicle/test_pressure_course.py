"""Pressure over time against its printed laws."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.errors import InputError
from wheelhop.vehicle.pressure_course import PressureCourse, held, pressure_at, validate

START = np.array([230e3, 235e3, 220e3, 225e3])
END = np.array([130e3, 235e3, 100e3, 225e3])


def at(course, *times):
    return np.stack([np.asarray(pressure_at(course, jnp.asarray(t))) for t in times])


def test_held_pressure_stays():
    np.testing.assert_array_equal(at(held(jnp.asarray(START)), 0.0, 1e4), [START, START])


def test_even_leak():
    leak = PressureCourse(jnp.asarray(START), jnp.asarray(END), begin=10.0, duration=40.0)
    found = at(leak, 0.0, 10.0, 20.0, 50.0, 80.0)
    np.testing.assert_allclose(found, [START, START, 0.75 * START + 0.25 * END, END, END])


def test_puncture_decays_and_wheels_have_their_own_time():
    begin = np.array([5.0, 0.0, 8.0, 0.0])
    course = PressureCourse(
        jnp.asarray(START), jnp.asarray(END), begin=jnp.asarray(begin), decay=jnp.asarray(3.0)
    )
    t = 9.0
    expected = END + (START - END) * np.exp(-(t - begin) / 3.0)
    np.testing.assert_allclose(at(course, t)[0], expected)
    np.testing.assert_array_equal(at(course, 0.0)[0], START)


def test_warm_up_is_added():
    course = PressureCourse(
        jnp.asarray(START), jnp.asarray(START), warming=20e3, warming_time=600.0
    )
    np.testing.assert_allclose(at(course, 600.0)[0], START + 20e3 * (1 - np.exp(-1)))


@pytest.mark.parametrize("decay", [0.0, 3.0])
def test_derivatives_are_finite_at_the_beginning_of_the_loss(decay):
    course = PressureCourse(*map(jnp.asarray, (START, END, 5.0, 40.0, decay, 1e3, 600.0)))
    for t in (4.0, 5.0, 6.0):
        slope = jax.grad(lambda c, t=t: jnp.sum(pressure_at(c, jnp.asarray(t))))(course)
        assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(slope))


def test_impossible_course_is_named():
    good = held(START)
    assert validate(good) is good
    with pytest.raises(InputError, match=r"pressure\.end RL: 2000 Pa is outside"):
        validate(replace(good, end=np.array([2e5, 2e5, 2e3, 2e5])))
    with pytest.raises(InputError, match=r"3 values\. Give four"):
        validate(held(START[:3]))
    with pytest.raises(InputError, match=r"pressure\.duration: 0 s"):
        validate(replace(good, duration=0.0))
