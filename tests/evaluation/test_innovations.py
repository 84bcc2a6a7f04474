"""The innovation report accepts a filter whose model is right and rejects wrong ones."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from wheelhop.evaluation.innovations import innovation_report
from wheelhop.filtering import StateSpaceModel, drive, extended, independent


class Walk(NamedTuple):
    level: Any


class Reading(NamedTuple):
    level: Any


def random_walk():
    """x' = x + w, y = x + v; params are the two variances the filter believes in."""
    return StateSpaceModel(
        lambda x, p: x, lambda x, p: Reading(x.level), lambda x, p: ((p[0],),), lambda p: ((p[1],),)
    )


def report(q, r, steps=4000, gaps=False, **options):
    rng = np.random.default_rng(5)
    x = np.cumsum(rng.normal(size=steps) * 0.3)
    y = x + rng.normal(size=steps)
    if gaps:
        y[100:200] = np.nan
    filter = extended(random_walk())
    info = drive.run(
        filter, independent(Walk(0.0), Walk(1.0)), Reading(jnp.asarray(y)), (q, r)
    ).info
    return innovation_report(info, **options)


def test_the_right_model_is_consistent_with_and_without_gaps():
    for gaps in (False, True):
        found = report(0.09, 1.0, gaps=gaps)
        assert found.consistent
        assert found.dof.sum() == 4000 - 100 * gaps
        assert np.isnan(found.normalised).sum() == 100 * gaps


@pytest.mark.parametrize(("q", "r"), [(0.09, 0.5), (0.09, 2.0), (0.9, 0.3), (0.002, 1.25)], ids=str)
def test_wrong_variances_are_not(q, r):
    assert not report(q, r).consistent


def test_a_sluggish_filter_of_the_right_size_is_found_by_its_colour():
    """Too small a Q with R raised until the NIS fits: only the autocorrelation tells."""
    found = report(0.002, 2.88)
    assert found.mean_nis == pytest.approx(1.0, abs=0.06)
    assert found.outside[0] > 0.2
    assert not found.consistent


def test_autocorrelation_is_that_of_numpy():
    found = report(0.09, 0.5, lags=10)
    x = found.normalised[:, 0]
    full = np.correlate(x, x, "full")[len(x) - 1 :][:11]
    np.testing.assert_allclose(found.autocorrelation[:, 0], full / full[0], rtol=1e-12)


def test_impossible_requests_are_named():
    with pytest.raises(ValueError, match="longer than the largest lag"):
        report(0.09, 1.0, steps=30)
    with pytest.raises(ValueError, match=r"probability=1\.0"):
        report(0.09, 1.0, probability=1.0)
