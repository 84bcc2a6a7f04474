"""Sensors of a corner: Eq. 18 and the invariant zeros built again in NumPy and SciPy."""

import re
from itertools import combinations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import eigvals
from scipy.signal import cont2discrete

from tests.oracles import quarter_car_lti as lti
from wheelhop.errors import InputError
from wheelhop.estimators.load_observability import SIGNALS, load_observability
from wheelhop.vehicle.corner_suspension import CornerSuspension

DT = 1e-3
CAR = lti.Car()
CORNER = CornerSuspension(*(jnp.asarray(x) for x in CAR))
SUBSETS = [s for size in range(1, 5) for s in combinations(SIGNALS, size)]
WORDS = {
    "the body's acceleration": "body_acceleration",
    "the deflection": "deflection",
    "the deflection's rate": "deflection_rate",
    "the wheel carrier's acceleration": "wheel_acceleration",
}


def system(signals, car=CAR):
    """(A, H, C, G) of Eq. 17 with the states (q, q'), q' in units that suit the numbers."""
    ease = 1 / car.m_s + 1 / car.m_u
    unit = np.sqrt(car.k * ease)
    a = np.array([[0.0, unit], [-car.k * ease / unit, -car.b * ease]])
    b = np.array([[0.0, 0.0], [1 / car.m_u, 1 / car.m_s]]) / unit
    strut = np.array([car.k, car.b * unit])
    rows = {
        "body_acceleration": (strut / car.m_s, [0.0, -1 / car.m_s]),
        "deflection": (np.array([1.0, 0.0]), [0.0, 0.0]),
        "deflection_rate": (np.array([0.0, unit]), [0.0, 0.0]),
        "wheel_acceleration": (-strut / car.m_u, [1 / car.m_u, 0.0]),
    }
    c, g = (np.array([rows[s][i] for s in signals]) for i in (0, 1))
    f, h, *_ = cont2discrete((a, b, c, g), DT, method="zoh")
    size = np.linalg.norm(np.hstack([c, g]), axis=1, keepdims=True)
    c, g = c / size, g / size
    by_load = 1 / np.linalg.norm(np.vstack([h, g]), axis=0)
    return f, h * by_load, c, g * by_load


def printed_matrix(f, h, c, g):
    """Eq. 18 for n = 2, the zero columns of the last G removed."""
    seen_now = g[:, np.abs(g).max(0) > 0]
    top = np.hstack([c, g, 0 * seen_now])
    return np.vstack([top, np.hstack([c @ f, c @ h, seen_now])])


def rank(m, tolerance=1e-9):
    m = m / np.maximum(np.linalg.norm(m, axis=0), 1e-30)
    return 0 if not m.size else int((np.linalg.svd(m, compute_uv=False) > tolerance).sum())


def zeros(f, h, c, g):
    """Invariant zeros: values that two random squares of the Rosenbrock pencil share."""
    n, p = len(f), h.shape[1]
    rng = np.random.default_rng(0)
    found = []
    for _ in range(2):
        mix = np.eye(p) if len(c) == p else rng.normal(size=(p, len(c)))
        left = np.block([[f, h], [mix @ c, mix @ g]])
        right = np.zeros_like(left)
        right[:n, :n] = np.eye(n)
        values = eigvals(left, right)
        found.append(values[np.isfinite(values) & (abs(values) < 1e3)])
    return [z for z in found[0] if found[1].size and abs(found[1] - z).min() < 1e-6]


def determined(f, h, c, g):
    """Rank of [C H V2, G V1]: each load by the sample and the next one."""
    _, sizes, v = np.linalg.svd(g)
    seen = int((sizes > 1e-9).sum())
    v1, v2 = v[:seen].T, v[seen:].T
    return rank(np.hstack([c @ h @ v2, g @ v1]), 1e-6) == h.shape[1]


def strong(signals):
    m = printed_matrix(*system(signals))
    return rank(m) == m.shape[1]


def usable(signals):
    parts = system(signals)
    return determined(*parts) and all(abs(z) < 1 - 1e-6 for z in zeros(*parts))


@pytest.mark.parametrize("signals", SUBSETS, ids="+".join)
def test_every_set_of_sensors(signals):
    """Rank of Eq. 18, zeros, whether a filter exists, and the cure in the sentence."""
    found = load_observability(CORNER, DT, signals)
    matrix = printed_matrix(*system(signals))
    assert (found.rank, found.columns) == (rank(matrix), matrix.shape[1])
    assert found.strongly_observable == strong(signals) == (found.rank == found.columns)
    assert found.usable == usable(signals)
    if determined(*system(signals)):
        np.testing.assert_allclose(
            np.sort(abs(found.zeros)), np.sort(np.abs(zeros(*system(signals)))), rtol=1e-6
        )

    claimed = re.search(r"; measure (.*) as well\.$", found.missing)
    assert ("not determine" not in found.missing) == found.usable
    assert (claimed is None) == (found.usable and found.strongly_observable)
    if claimed is None:
        return
    enough = (lambda s: strong(s) and usable(s)) if found.usable else usable
    cures = {s for s in SIGNALS if s not in signals and enough((*signals, s))}
    if cures:
        assert {WORDS[w] for w in claimed[1].split(" or ")} == cures
    else:
        assert claimed[1] == "at least two more signals"


def test_the_papers_claim():
    """a_s and q are not strongly observable, with q' they are; and a_s, q and the wheel's a."""
    pair = load_observability(CORNER, DT, ("body_acceleration", "deflection"))
    assert not pair.strongly_observable
    assert "not strongly" in pair.missing
    assert "the deflection's rate" in pair.missing
    three = load_observability(CORNER, DT, ("body_acceleration", "deflection", "deflection_rate"))
    assert three.strongly_observable
    assert three.usable
    assert (three.rank, three.columns) == (5, 5)
    assert not three.zeros.size


def test_momenta_of_body_and_wheel_are_not_told_apart():
    """The paper's three states (p_s, p_u, q) are not observable: their system is reduced to two."""
    a, _, c, _ = lti.corner(CAR)
    observability = np.vstack([c, c @ a, c @ a @ a])
    _, sizes, v = np.linalg.svd(observability / np.linalg.norm(observability, axis=1)[:, None])
    assert sizes[2] < 1e-9 * sizes[0] < sizes[1]
    hidden = v[2] / v[2][0]
    np.testing.assert_allclose(hidden, [1.0, CAR.m_u / CAR.m_s, 0.0], atol=1e-9)


def test_order_of_the_signals_does_not_matter():
    forth = load_observability(CORNER, DT, SIGNALS[:3])
    back = load_observability(CORNER, DT, SIGNALS[2::-1])
    assert (forth.rank, forth.strongly_observable, forth.usable) == (
        back.rank, back.strongly_observable, back.usable
    )  # fmt: skip


@pytest.mark.parametrize("dt", [1e-4, 1e-2])
@pytest.mark.parametrize("scale", [0.05, 20.0])
def test_other_cars_and_rates(dt, scale):
    """A kart and a lorry: what a sensor can tell does not depend on the sizes."""
    car = CornerSuspension(*(jnp.asarray(scale * x) for x in CAR))
    for signals in (SIGNALS[:2], SIGNALS[:3], SIGNALS[::2]):
        ours, usual = (load_observability(*given, signals) for given in ((car, dt), (CORNER, DT)))
        assert ours.strongly_observable == usual.strongly_observable
        assert ours.usable == usual.usable
        assert ours.rank == usual.rank


def test_refusals_name_the_field():
    for signals in ((), ("deflection", "speed")):
        with pytest.raises(InputError) as refusal:
            load_observability(CORNER, DT, signals)
        assert refusal.value.field == "signals"
