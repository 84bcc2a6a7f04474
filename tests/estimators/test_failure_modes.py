"""Hypotheses of a lateral estimator: the paper's order, levels of every tyre, probabilities."""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.oracles import two_track_numpy as paper
from wheelhop.errors import InputError
from wheelhop.estimators.failure_modes import (
    MOST_MODES,
    level_table,
    mode_names,
    mode_of,
    soft_probability,
    stacked_tires,
)
from wheelhop.vehicle.lateral_tire import NOMINAL_TIRE, SOFT_TIRE, ArctangentTire, InflatedTire
from wheelhop.vehicle.magic_formula_parameters import generic_passenger_tire
from wheelhop.vehicle.two_track import Wheels

CORNERS = ("FL", "FR", "RL", "RR")
LEVELS = pytest.mark.parametrize("levels", [2, 3, 4])


def test_the_eighth_model_is_the_front_left_tire_alone_and_the_sixteenth_is_none():
    """Solmaz, section IV, names the first; the rest follow from counting in binary."""
    names = mode_names()
    assert len(names) == 16
    assert names[8 - 1] == "FL"
    assert names[16 - 1] == "none"
    assert names[1 - 1] == "FL+FR+RL+RR"
    assert [names.index(corner) + 1 for corner in CORNERS] == [8, 12, 14, 15]


def test_names_tyres_and_levels_agree_with_each_other():
    stacked = stacked_tires((SOFT_TIRE, NOMINAL_TIRE))
    k = np.stack([np.stack([t.k1, t.k2, t.k3], -1) for t in stacked], axis=1)
    np.testing.assert_array_equal(k, paper.combinations())
    for index, (name, row) in enumerate(zip(mode_names(), level_table(2), strict=True)):
        soft = [corner in name.split("+") for corner in CORNERS]
        assert [level == 0 for level in row] == soft
        assert mode_of(soft) == index


@LEVELS
def test_every_combination_of_levels_is_there_once(levels):
    table = level_table(levels)
    assert table.shape == (levels**4, 4)
    assert {tuple(row) for row in table} == set(product(range(levels), repeat=4))
    assert len(set(mode_names(levels))) == levels**4 <= MOST_MODES
    assert mode_names(levels)[-1] == "none"


@LEVELS
def test_more_levels_keep_the_order_of_two(levels):
    """Those modes whose tyres are softest or sound, in the order of the sixteen."""
    table = level_table(levels)
    kept = table[np.isin(table, (0, levels - 1)).all(axis=1)]
    np.testing.assert_array_equal(kept // (levels - 1), level_table(2))


def test_levels_between_are_named():
    names = mode_names(3)
    assert names[int(np.flatnonzero((level_table(3) == [1, 2, 2, 0]).all(axis=1))[0])] == "FL1+RR0"


@LEVELS
def test_each_wheel_takes_its_own_tires_by_the_table(levels):
    """Leaves [modes]; every wheel another tyre at every level."""
    tires = Wheels(
        *([ArctangentTire(1.0, 4000.0 + 10 * w + i, 12) for i in range(levels)] for w in range(4))
    )
    found = stacked_tires(tires)
    k2 = np.stack([tire.k2 for tire in found], axis=-1)
    np.testing.assert_array_equal(k2, 4000.0 + 10 * np.arange(4) + level_table(levels))
    assert {leaf.dtype for leaf in jax.tree.leaves(found)} == {jnp.dtype("float64")}


def test_pressures_make_levels_of_a_magic_formula():
    slip = generic_passenger_tire()
    found = stacked_tires([InflatedTire(slip, p) for p in (120e3, 180e3, 240e3)])
    assert found.rear_left.slip.rated_load.shape == (81,)
    expected = 120e3 + 60e3 * level_table(3)[:, 2]
    np.testing.assert_array_equal(found.rear_left.pressure, expected)


def test_levels_take_the_precision_in_force(float32):
    assert stacked_tires((SOFT_TIRE, NOMINAL_TIRE)).front_left.k2.dtype == jnp.float32


@LEVELS
def test_probability_of_a_soft_tire_sums_its_modes(levels):
    rng = np.random.default_rng(levels)
    p = rng.dirichlet(np.full(levels**4, 0.1), size=3)
    expected = [
        [sum(p[i, m] for m, row in enumerate(level_table(levels)) if row[w] < levels - 1)]
        for i, w in product(range(3), range(4))
    ]
    found = soft_probability(p, levels)
    assert found.shape == (3, 4)
    np.testing.assert_allclose(found.ravel(), np.ravel(expected), rtol=1e-12)
    even = soft_probability(np.full(levels**4, levels**-4.0), levels)
    np.testing.assert_allclose(even, (levels - 1) / levels, rtol=1e-12)


def test_certainty_names_the_tires():
    for name, row in zip(mode_names(), np.eye(16), strict=True):
        expected = [corner in name.split("+") for corner in CORNERS]
        np.testing.assert_array_equal(soft_probability(row), expected)


@pytest.mark.parametrize("levels", [-1, 0, 1, 5])
def test_too_few_and_too_many_levels_are_refused(levels):
    for ask in (level_table, mode_names, lambda n: stacked_tires([NOMINAL_TIRE] * max(n, 0))):
        with pytest.raises(InputError, match=r"^levels: "):
            ask(levels)


def test_wheels_of_unequal_levels_are_refused():
    two, three = [SOFT_TIRE, NOMINAL_TIRE], [SOFT_TIRE, SOFT_TIRE, NOMINAL_TIRE]
    with pytest.raises(InputError, match=r"levels: the wheels have \[2, 3\]"):
        stacked_tires(Wheels(two, two, three, two))
