"""Chapter of the mass at rest: what is weighed, and claims that follow the numbers."""

import numpy as np
import pytest

from wheelhop.studies.filipozzi.settings import FilipozziSettings
from wheelhop.studies.filipozzi.vehicles import paper_vehicle
from wheelhop.studies.filipozzi.weighing import (
    EQUILIBRIUM,
    PAYLOAD,
    PRINTED,
    STANDS,
    Weighing,
    loaded,
    stood,
    weighing,
)
from wheelhop.studies.filipozzi.weighing_report import (
    errors,
    weighing_figures,
    weighing_findings,
    weighing_numbers,
    weighing_tables,
)
from wheelhop.studies.frame import Store


@pytest.fixture(scope="module")
def found() -> Weighing:
    return weighing(FilipozziSettings(), Store(None), lambda done, of: None)


def test_sensors_at_rest_show_gravity_on_the_slope():
    car = loaded(paper_vehicle())
    grade = np.arctan(0.2)
    stands = stood(car, ((0.0, 0.0), (grade, 0.0)))
    # uphill pushes the sensor forward; the body leans back by another degree at most
    assert abs(stands.a_x[0]) < 0.3
    lean = np.arcsin(stands.a_x[1] / 9.80665) - grade - np.arcsin(stands.a_x[0] / 9.80665)
    assert 0.0 < lean < np.radians(2.0)
    assert np.abs(stands.a_y).max() < 1e-9
    rear_heavier = stands.deflection[1, 2:] - stands.deflection[0, 2:]
    assert (rear_heavier > 0).all()


def test_mass_is_exact_by_equilibrium_and_too_small_by_the_cosine_as_printed(found):
    assert found.body_mass == pytest.approx(1788.0 + PAYLOAD)
    for name, estimates in found.estimates.items():
        assert errors(found, estimates[EQUILIBRIUM])[0] == pytest.approx(0.0, abs=1e-3), name
    cosine = 100.0 * (np.cos(np.arctan(0.2)) - 1.0)
    share = found.body_mass / float(found.true.mass)
    as_printed = errors(found, found.estimates["20 % slope"][PRINTED])[0]
    # the leaning body leaves a little less than the cosine on its springs
    assert as_printed == pytest.approx(share * cosine, rel=0.25)
    assert found.stiffness[1.5] == pytest.approx(1788.0 / 1.5, rel=1e-6)
    assert found.stiffness[0.5] == pytest.approx(1788.0 / 0.5, rel=1e-6)


def test_claims_follow_the_numbers(found):
    assert [f.verdict for f in weighing_findings(found)] == [
        "holds in part",
        "holds in part",
        "holds",
    ]
    full = {
        name: {m: e._replace(rank=4) for m, e in estimates.items()}
        for name, estimates in found.estimates.items()
    }
    assert weighing_findings(found._replace(estimates=full))[0].verdict == "holds"
    heavy = found._replace(stiffness={0.5: 1.0, 1.0: 1.0, 1.5: 1.0})
    assert weighing_findings(heavy)[2].verdict == "does not hold"


def test_tables_figures_and_numbers_are_whole(found):
    (table,) = weighing_tables(found)
    assert len(table.rows) == 2 * len(STANDS)
    (figure,) = weighing_figures(found)
    labels = [ax.get_xlabel() for ax in figure.figure.axes]
    assert labels == ["error of mass [%]", "error of $l_F$ [mm]", "error of height [mm]"]
    assert weighing_numbers(found)["true"]["mass"] == float(found.true.mass)
