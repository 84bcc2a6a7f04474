"""Chapter on the coupling of the wheels: gains against a rigid car in NumPy, verdicts."""

import jax
import numpy as np
import pytest

from wheelhop.io.report import FAILS, HOLDS, IN_PART, OPEN
from wheelhop.studies.filipozzi.coupling import (
    BOTH,
    FREE,
    PAPER_FREE,
    PAPER_REAR,
    REAR,
    STRONG,
    coupling,
    rear_coupling,
)
from wheelhop.studies.filipozzi.coupling_report import (
    coupling_figures,
    coupling_findings,
    coupling_in_words,
    coupling_numbers,
    coupling_tables,
    missed_in_roll,
)
from wheelhop.studies.filipozzi.settings import CORNERING, QUICK
from wheelhop.studies.filipozzi.vehicles import barred_vehicle
from wheelhop.studies.frame import Store
from wheelhop.vehicle.parameters import BRANCATI_TABLE_1

GRAVITY = 9.80665


def quiet(done: int, total: int) -> None:
    assert 0 <= done <= total


@pytest.fixture(scope="module")
def gains():
    return coupling(QUICK, Store(None), quiet)


def test_relative_gains_are_those_of_wheels_on_a_heavy_body(gains):
    """Oracle: K^-1 (I - m J M^-1 J^T) of a rigid car on its struts, in NumPy."""
    for c in gains.values():
        car = barred_vehicle()
        k = np.diag(np.repeat(c.springs, 2))
        for at, bar in zip((0, 2), c.bars, strict=True):
            k[at : at + 2, at : at + 2] += bar * np.array([[1, -1], [-1, 1]])
        ch = jax.tree.map(np.asarray, car.chassis)
        x = np.array([ch.front_arm, ch.front_arm, -ch.rear_arm, -ch.rear_arm])
        y = 0.5 * np.array([ch.front_track, -ch.front_track, ch.rear_track, -ch.rear_track])
        m, jacobian = ch.wheel_mass, np.stack([np.ones(4), y, -x], axis=1)
        # wheels turn with the body about its centre of mass, hub_drop below it
        lever = np.sum(m * ch.hub_drop**2) * np.diag([0.0, 1.0, 1.0])
        body = np.diag([ch.body_mass, ch.roll_inertia, ch.pitch_inertia])
        rigid = body + jacobian.T @ np.diag(m) @ jacobian + lever
        gain = np.linalg.solve(
            k, np.eye(4) - m[:, None] * jacobian @ np.linalg.solve(rigid, jacobian.T)
        )
        np.testing.assert_allclose(c.at_rest, gain * np.linalg.inv(gain).T, atol=2e-3)
        np.testing.assert_allclose(c.cornering.sum(0), 1.0, atol=1e-9)
        np.testing.assert_allclose(c.cornering.sum(1), 1.0, atol=1e-9)
        assert 1e-6 < np.abs(c.cornering - c.at_rest).max() < 2e-3


def test_the_body_leans_as_its_stiffness_in_roll_has_it(gains):
    """Roll of struts and tyres in series about the road, to a tenth: m a h / c, small angles."""
    car = barred_vehicle()
    mass = float(car.chassis.body_mass)
    height = float(car.chassis.hub_drop[0]) + 0.34
    for c in (gains[FREE], gains[BOTH]):
        radius = 0.5 * np.array([car.chassis.front_track, car.chassis.rear_track], float)
        strut = c.springs + 2.0 * c.bars
        tire = BRANCATI_TABLE_1.tire_stiffness
        series = strut * tire / (strut + tire)
        stiffness = np.sum(2.0 * radius**2 * series) - mass * GRAVITY * height
        assert float(c.roll) == pytest.approx(mass * CORNERING * height / stiffness, rel=0.15)
        assert c.compression[1] > 0 > c.compression[0]


def test_the_strong_bar_adds_what_the_papers_adds(gains):
    added = rear_coupling(gains[STRONG].cornering) - rear_coupling(gains[FREE].cornering)
    assert added == pytest.approx(rear_coupling(PAPER_REAR) - rear_coupling(PAPER_FREE), abs=1e-5)
    np.testing.assert_allclose(missed_in_roll(gains[BOTH]), [30 / 63.6, 16 / 51.5], rtol=1e-12)


def test_report_of_the_coupling(gains):
    verdicts = [f.verdict for f in coupling_findings(gains)]
    assert verdicts == [HOLDS, HOLDS, IN_PART, OPEN, HOLDS, FAILS]
    (figure,) = coupling_figures(gains)
    assert {len(v) for v in figure.columns.values()} == {16}
    assert set(figure.units) <= set(figure.columns)
    table, full = coupling_tables(gains)
    assert len(table.rows) == 6
    assert len(full.rows) == 16
    assert coupling_numbers(gains)[REAR]["bars"] == [0.0, 8e3]
    assert all(coupling_in_words(QUICK))
    worse = gains | {FREE: gains[FREE]._replace(cornering=np.asarray(PAPER_REAR))}
    assert coupling_findings(worse)[0].verdict == FAILS
