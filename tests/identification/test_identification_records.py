"""Records for identification: what is refused, and the road added to a log."""

from dataclasses import replace

import numpy as np
import pytest
from truth import record

from wheelhop.errors import InputError
from wheelhop.identification.drives import prepare, with_road
from wheelhop.vehicle.road.profile import Profile

GOOD = record(0, 15.0, 180e3, 4.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"pressure": None}, "front: pressure: it is missing"),
        ({"pressure": np.full(2000, np.nan)}, "front: pressure: it is missing"),
        ({"elevation": None}, "front: elevation: it is missing"),
        ({"elevation": np.zeros(2000)}, "excites nothing"),
        ({"a_u": 1e-3 * GOOD.a_u}, "a_u: it varies by 0.01[0-9]* m/s"),
    ],
)
def test_refusals_name_record_and_field(changes, said):
    with pytest.raises(InputError, match=said):
        prepare([GOOD, replace(GOOD, **changes)], ["rear", "front"])


def test_a_short_record_is_refused_with_the_length_that_is_needed():
    short = record(0, 15.0, 180e3, 2.5)
    with pytest.raises(InputError, match=r"lasts 2.5 s.*at least 3 s"):
        prepare([short])
    prepare([short], settling=0.4)


@pytest.mark.parametrize(
    ("field", "change", "said"),
    [
        ("a_s", slice(500, None), "a_s: 0 samples count"),
        ("a_u", slice(None), "a_u: 0 samples count"),
        ("elevation", slice(1, None), "elevation: .* excites nothing"),
        ("elevation", slice(600, 1900), "a_s: 100 samples count"),
    ],
)
def test_records_of_which_too_little_counts_are_refused(field, change, said):
    values = getattr(GOOD, field).copy()
    values[change] = np.nan
    with pytest.raises(InputError, match=said):
        prepare([replace(GOOD, **{field: values})])


def test_no_record_and_wrong_names_are_refused():
    with pytest.raises(InputError, match="there is none"):
        prepare([])
    with pytest.raises(InputError, match="2 for 1 records"):
        prepare([GOOD], ["a", "b"])
    with pytest.raises(InputError, match="name of its own"):
        prepare([GOOD, GOOD], ["a", "a"])
    with pytest.raises(InputError, match="settling"):
        prepare([GOOD], settling=float("nan"))


def test_missing_samples_and_settling_do_not_count():
    a_s = GOOD.a_s.copy()
    a_s[1800:1810] = np.nan
    elevation = GOOD.elevation.copy()
    elevation[900:903] = np.nan
    drives = prepare([replace(GOOD, a_s=a_s, elevation=elevation)]).drives
    count = np.asarray(drives.count_s).ravel()
    # from 1 s on, not in the gap of the road and the second after it, not where a_s is missing
    expected = np.ones(2000)
    expected[:500] = 0
    expected[900:1402] = 0
    assert np.asarray(drives.count_u).sum() == expected.sum()
    expected[1800:1810] = 0
    np.testing.assert_array_equal(count[1::2], expected)  # two steps of 1 ms per sample
    assert not count[0::2].any()
    assert np.all(np.isfinite(drives.rise))
    assert drives.rise.shape == (1, 8, 500)
    assert float(drives.dt[0]) == pytest.approx(1e-3)


def test_a_road_under_a_log_is_met_where_the_car_is():
    x = 0.05 * np.arange(4001)
    road = Profile(0.05, 0.01 * np.sin(0.5 * x))
    t = GOOD.t
    speed = 10.0 + 2.0 * np.sin(t)
    found = with_road(replace(GOOD, v=speed, elevation=None), road)
    distance = 10.0 * t + 2.0 * (1.0 - np.cos(t))
    np.testing.assert_allclose(found.elevation, 0.01 * np.sin(0.5 * distance), atol=1e-5)


def test_a_road_that_is_too_short_is_refused():
    with pytest.raises(InputError):
        with_road(GOOD, Profile(0.05, np.zeros(100)))
