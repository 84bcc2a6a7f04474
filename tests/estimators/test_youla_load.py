"""The Youla observer against the feedback loop that it stands for, in SciPy, and the true loads."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import butter, tf2ss
from scipy.stats import chi2

from tests.oracles import quarter_car_lti as lti
from wheelhop.errors import InputError
from wheelhop.estimators.inverse_load import LoadSensors
from wheelhop.estimators.wheel_load import LoadSample
from wheelhop.estimators.youla_load import unknown_before, youla, youla_params
from wheelhop.filtering import run_batch
from wheelhop.filtering.drive import run
from wheelhop.vehicle.corner_suspension import CornerSuspension, static_load

DT, SAMPLES, BANDWIDTH = 1e-3, 400, 30.0
CAR = lti.Car()
OBSERVER = youla()
WEIGHT = (CAR.m_s + CAR.m_u) * lti.GRAVITY
REST = (WEIGHT, 0.0)
HZ = np.array([0.7, 3.1, 9.0, 17.0])
NORMAL, TRANSFER = np.array([400.0, 250.0, 300.0, 100.0]), np.array([300.0, 150.0, 50.0, 20.0])
PHASE = np.array([0.3, 1.9, 4.0, 5.5])
SETTLED = slice(150, None)


def corner_of(car, dtype=float):
    return CornerSuspension(*(jnp.asarray(x, dtype) for x in car))


def params(car=CAR, method="exact", **sensors):
    return youla_params(
        corner_of(car), DT, BANDWIDTH, sensors=LoadSensors(**sensors), method=method
    )


def loads(t):
    angle = 2 * np.pi * HZ * t[:, None] + PHASE
    return np.c_[WEIGHT + np.sin(angle) @ NORMAL, np.cos(angle) @ TRANSFER]


def keep(state, info):
    return OBSERVER.load(state), info.flags.missing


def observe(y, p):
    state = OBSERVER.filter.init(unknown_before(), p)
    return run(OBSERVER.filter, state, y, p, keep=keep)


compiled = jax.jit(observe)


def sample(y):
    return LoadSample(jnp.asarray(y[:, 0]), jnp.asarray(y[:, 1]))


def estimate(y, p):
    """(F, dF) [time, 2]."""
    found, _ = compiled(sample(y), p)
    return np.stack([np.asarray(x) for x in found.mean], 1)


@pytest.fixture(scope="module")
def drive():
    """(t, loads, (a_s, q, q')) of the matched corner from rest on."""
    return lti.driven(lti.corner(CAR), REST, loads, DT, SAMPLES)


def discrete_youla(hz, method):
    """M_T G^-1 as a discrete filter passes it, [frequencies, 2, 2]."""
    k = np.arange(-300, 301) if method == "exact" else np.zeros(1)
    seen = hz[:, None] + k / DT
    weight = np.sinc(seen * DT) ** 2
    if method == "bilinear":
        seen, weight = np.tan(np.pi * seen * DT) / (np.pi * DT), 1.0
    s = 2j * np.pi * seen
    one = np.ones_like(s)
    strut = CAR.k + CAR.b * s
    inverse = np.array([[CAR.m_u * one, CAR.m_u * s**2 + strut], [-CAR.m_s * one, strut]])
    return np.moveaxis((inverse * weight * lti.low_pass(seen, BANDWIDTH)).sum(-1), -1, 0)


@pytest.mark.parametrize("method", ["exact", "bilinear"])
def test_loads_within_the_bandwidth_are_found_to_the_low_pass(drive, method):
    """The estimate is Y_d G_p u with Y_d as stated, and so M_T u within the stated accuracy."""
    t, true, y = drive
    found = estimate(y, params(method=method))[SETTLED]
    plant = lti.transfer(lti.corner(CAR), HZ)[:, :2, :2]
    phasor = np.c_[NORMAL * np.exp(1j * (PHASE - np.pi / 2)), TRANSFER * np.exp(1j * PHASE)]
    moving = np.exp(2j * np.pi * HZ * t[SETTLED, None])
    sampled = np.einsum("fij,fjk,fk->fi", discrete_youla(HZ, method), plant, phasor)
    rest = np.array([WEIGHT, 0.0])
    np.testing.assert_allclose(found, rest + (moving @ sampled).real, atol=0.05)

    passed = lti.low_pass(HZ, BANDWIDTH)[:, None] * phasor
    np.testing.assert_allclose(found, rest + (moving @ passed).real, atol=1.0)
    bound = (abs(1 - lti.low_pass(HZ, BANDWIDTH)) * abs(phasor).T).sum(1) + 1.0
    error = abs(found - true[SETTLED]).max(0)
    assert np.all(error <= bound)
    assert np.all(error > 0.3 * bound)  # the bound is no idle one


def test_chirp_up_to_the_wheel_hop():
    """0.5 to 12 Hz; the error is that of M_T at the frequency of the moment, no more."""
    rate = (12.0 - 0.5) / (SAMPLES * DT)

    def sweep(t):
        angle = 2 * np.pi * (0.5 * t + 0.5 * rate * t * t)
        return np.c_[WEIGHT + 800 * np.sin(angle), 300 * np.cos(angle)]

    t, true, y = lti.driven(lti.corner(CAR), REST, sweep, DT, SAMPLES)
    error = abs(estimate(y, params()) - true)[SETTLED]
    away = abs(1 - lti.low_pass(0.5 + rate * t[SETTLED], BANDWIDTH))[:, None]
    assert np.all(error <= away * [800, 300] + 6.0)


def feedback_loop(car):
    """Controller of Eq. 13 around the model of Eq. 2-4: from (a_s, q, 1) to the estimate."""
    w = 2 * np.pi * BANDWIDTH
    # in p = s / w, for the sake of the numbers
    whole = np.polymul([1, 2 * np.sqrt(0.5), 1], np.polymul([0.1, 1], [0.1, 1]))
    below = np.polysub(whole, [1])
    m_u, b, k = car.m_u * w * w, car.b * w, car.k
    columns = [([[car.m_u], [-car.m_s]]), ([[m_u, b, k], [0, b, k]])]
    parts = [tf2ss(np.atleast_2d(n), below) for n in columns]
    a_c = w * np.block([[parts[0][0], np.zeros((4, 4))], [np.zeros((4, 4)), parts[1][0]]])
    b_c = w * np.block([[parts[0][1], np.zeros((4, 1))], [np.zeros((4, 1)), parts[1][1]]])
    c_c = np.hstack([parts[0][2], parts[1][2]])
    assert not np.any([p[3] for p in parts])
    a, b, c, d = lti.corner(car)
    c, d = c[:2], d[:2]
    # u = c_c z, e = y - (c x + d (u, 1)), x' = a x + b (u, 1), z' = a_c z + b_c e
    n = len(a)
    closed = np.zeros((n + 8, n + 8))
    closed[:n, :n], closed[:n, n:] = a, b[:, :2] @ c_c
    closed[n:, :n], closed[n:, n:] = -b_c @ c, a_c - b_c @ d[:, :2] @ c_c
    into = np.zeros((n + 8, 3))
    into[:n, 2] = b[:, 2]
    into[n:, :2], into[n:, 2] = b_c, -b_c @ d[:, 2]
    return closed, into, np.hstack([np.zeros((2, n)), c_c]), np.zeros((2, 3))


@pytest.mark.parametrize("matched", [True, False])
def test_equals_the_feedback_loop(drive, matched):
    """Whatever the car is: the loop sees the same record, linear between samples."""
    y = drive[2]
    car = CAR if matched else CAR._replace(k=50e3, b=1500.0, m_u=40.0)
    loop = feedback_loop(car)
    expected = lti.piecewise_linear(loop, np.c_[y[:, :2], np.ones(SAMPLES)], DT)
    found = estimate(y, params(car))
    np.testing.assert_allclose(found[SETTLED], expected[SETTLED], atol=0.01)
    assert abs(found - drive[1])[SETTLED].max() > 10


def test_converges_uninitialised_in_a_tenth_of_a_second():
    """From a deflection 0.13 m off, without knowing it: the spring's free length as zero."""
    car = CAR._replace(preload=0.0)
    t, _, y = lti.driven(lti.corner(car), REST, loads, DT, SAMPLES)
    assert abs(y[0, 1]) > 0.1
    found = estimate(y, params(car))[:, 0]
    assert abs(found[0] - WEIGHT) > 4000
    error = abs(found - loads_passed(t))
    assert error[75:].max() < 0.01 * WEIGHT
    assert error[100:].max() < 2


@pytest.mark.parametrize("preload", [CAR.preload, 0.0, 1234.0])
def test_rest_gives_the_weight(preload):
    car = CAR._replace(preload=preload)
    system = lti.corner(car)
    _, _, y = lti.driven(system, REST, lambda t: np.c_[WEIGHT + 0 * t, 0 * t], DT, SAMPLES, 1, 0.0)
    assert y[-1, 1] == pytest.approx((CAR.m_s * lti.GRAVITY - preload) / CAR.k, abs=1e-12)
    found = estimate(y, params(car))
    np.testing.assert_allclose(found[300:], [REST] * (SAMPLES - 300), atol=1e-6)
    assert float(static_load(corner_of(car))) == pytest.approx(WEIGHT)


def varied(runs, seed):
    """Cars within a third of the usual one, [runs] each."""
    size = 1 + 0.3 * np.random.default_rng(seed).uniform(-1, 1, (6, runs))
    return lti.Car(*(np.asarray(CAR)[:, None] * size))


def test_sigma_is_the_spread_of_runs_whose_corners_differ():
    """White noise on both sensors; each run in its own units, chi-square at three times."""
    runs, noise = 512, {"acceleration_noise": 0.08, "deflection_noise": 3e-4}
    rng = np.random.default_rng(3)
    cars = varied(runs, 4)
    q = (cars.m_s * lti.GRAVITY - cars.preload) / cars.k
    ys = LoadSample(
        jnp.asarray(rng.normal(scale=0.08, size=(runs, SAMPLES))),
        jnp.asarray(q[:, None] + rng.normal(scale=3e-4, size=(runs, SAMPLES))),
    )
    p = replace(params(**noise), corner=corner_of(cars))
    by_run = replace(jax.tree.map(lambda _: None, p), corner=CornerSuspension(*[0] * 6))
    state = OBSERVER.filter.init(unknown_before(), params(**noise))
    loads, _ = run_batch(OBSERVER.filter, state, ys, p, keep=keep, in_axes=(None, 0, by_run, None))
    off = np.stack(
        [
            np.asarray(loads.mean.normal) - ((cars.m_s + cars.m_u) * lti.GRAVITY)[:, None],
            np.asarray(loads.mean.transfer),
        ]
    )
    cov = jax.tree.map(np.asarray, loads.cov)
    at = [200, 300, 399]
    square = np.zeros(3)
    for k in at:
        full = np.array([[cov[0][0], cov[1][0]], [cov[1][0], cov[1][1]]])[:, :, :, k]
        e = off[:, :, k]
        joint = np.einsum(
            "ir,ijr,jr->r", e, np.linalg.inv(full.transpose(2, 0, 1)).transpose(1, 2, 0), e
        )
        square += [(e[0] ** 2 / full[0, 0]).sum(), (e[1] ** 2 / full[1, 1]).sum(), joint.sum()]
    for found, freedom in zip(square, runs * len(at) * np.array([1, 1, 2]), strict=True):
        assert chi2.ppf(0.0005, freedom) < found < chi2.ppf(0.9995, freedom)

    for r in (0, 77, 511):
        one = lti.Car(*(x[r] for x in cars))
        y = jax.tree.map(lambda x, r=r: x[r], ys)
        single, _ = compiled(y, replace(p, corner=corner_of(one)))
        for a, b in zip(jax.tree.leaves(single), jax.tree.leaves(loads), strict=True):
            np.testing.assert_allclose(b[r][1:], a[1:], rtol=1e-9, atol=1e-6)


def test_vmap_equals_single_runs(drive):
    y = sample(drive[2])
    ks = jnp.asarray([20e3, 33.6e3, 60e3])
    p = params()

    def of(k):
        return observe(y, replace(p, corner=replace(p.corner, stiffness=k)))[0].mean.normal

    found = jax.jit(jax.vmap(of))(ks)
    for k, row in zip(ks, found, strict=True):
        single = estimate(drive[2], replace(p, corner=replace(p.corner, stiffness=k)))
        np.testing.assert_allclose(row, single[:, 0], rtol=1e-10)


def test_sensors_of_finite_bandwidth_are_undone(drive):
    """Second-order Butterworths of 40 and 60 Hz; believed to be ideal, they spoil the load.

    With as many zeros as poles Y stays large up to the sampling rate, so that a signal that is
    taken as linear between samples costs far more than sinc^2; Tustin's rule does not mind.
    """
    fine = 10
    system = lti.corner(CAR)
    _, _, y = lti.driven(system, REST, loads, DT / fine, SAMPLES * fine, 1)
    measured = []
    for signal, hz in ((y[:, 0], 40.0), (y[:, 1], 60.0)):
        sensor = tf2ss(*butter(2, 2 * np.pi * hz, analog=True))
        measured.append(lti.piecewise_linear(sensor, signal[:, None], DT / fine)[::fine, 0])
    measured = np.stack(measured, 1)
    slow = {"acceleration_bandwidth": 40.0, "deflection_bandwidth": 60.0}
    passed = loads_passed(drive[0])
    for method, close in (("bilinear", 0.5), ("exact", 30.0)):
        undone = estimate(measured, params(method=method, **slow))[SETTLED, 0]
        believed = estimate(measured, params(method=method))[SETTLED, 0]
        assert abs(undone - passed[SETTLED]).max() < close
        assert abs(believed - passed[SETTLED]).max() > 75


def test_a_lost_sample_is_held_and_flagged(drive):
    y = drive[2][:, :2].copy()
    lost, held = y.copy(), y.copy()
    lost[200:203, 1], held[200:203, 1] = np.nan, y[199, 1]
    lost[202, 0], held[202, 0] = np.inf, y[201, 0]
    found, missing = compiled(sample(lost), params())
    np.testing.assert_array_equal(np.flatnonzero(missing), [200, 201, 202])
    np.testing.assert_array_equal(missing[200:203], [1, 1, 2])
    np.testing.assert_allclose(found.mean.normal, estimate(held, params())[:, 0], rtol=1e-12)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(found))


def test_a_sensor_that_never_spoke_leaves_the_prior(drive):
    """Nothing of the deflection is known but its usual size, 3 cm; k times that is the sigma."""
    y = drive[2][:, :2].copy()
    y[:, 1] = np.nan
    found, _ = compiled(sample(y), params())
    assert float(found.cov[0][0][-1]) ** 0.5 > 0.99 * CAR.k * 0.03


def test_gradients_are_those_of_finite_differences(drive):
    y, true = sample(drive[2]), jnp.asarray(drive[1][:, 0])
    p = params()

    def loss(k, b):
        corner = replace(p.corner, stiffness=k, damping=b)
        found, _ = observe(y, replace(p, corner=corner))
        return jnp.mean((found.mean.normal - true)[150:] ** 2) + found.cov[0][0][-1] * 1e-4

    k, b = jnp.asarray(1.2 * CAR.k), jnp.asarray(0.8 * CAR.b)
    slopes = jax.jit(jax.grad(loss, (0, 1)))(k, b)
    value = jax.jit(loss)
    for found, up, down, step in (
        (slopes[0], (k + 50.0, b), (k - 50.0, b), 100.0),
        (slopes[1], (k, b + 5.0), (k, b - 5.0), 10.0),
    ):
        expected = (value(*up) - value(*down)) / step
        assert np.isfinite(found)
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_single_precision(drive, float32):
    y = LoadSample(*(jnp.asarray(drive[2][:, i], jnp.float32) for i in (0, 1)))
    p = youla_params(corner_of(CAR, jnp.float32), DT, BANDWIDTH)
    found, _ = jax.jit(observe)(y, p)
    assert {x.dtype for x in jax.tree.leaves(found)} == {jnp.dtype("float32")}
    passed = loads_passed(drive[0])
    np.testing.assert_allclose(found.mean.normal[SETTLED], passed[SETTLED], atol=2.0)


def loads_passed(t):
    """M_T F in the steady state."""
    phasor = NORMAL * np.exp(1j * (PHASE - np.pi / 2)) * lti.low_pass(HZ, BANDWIDTH)
    return WEIGHT + (np.exp(2j * np.pi * HZ * t[:, None]) @ phasor).real


@pytest.mark.parametrize(
    ("field", "changes"),
    [
        ("dt", {"dt": 0.0}),
        ("bandwidth", {"bandwidth": 501.0}),
        ("bandwidth", {"bandwidth": float("nan")}),
        ("damping", {"damping": 0.0}),
        ("lag", {"lag": -1e-3}),
        ("sensors.acceleration_noise", {"sensors": LoadSensors(acceleration_noise=-1.0)}),
        ("sensors.deflection_bandwidth", {"sensors": LoadSensors(deflection_bandwidth=0.0)}),
    ],
)
def test_refusals_name_the_field(field, changes):
    with pytest.raises(InputError) as refusal:
        youla_params(**({"corner": corner_of(CAR), "dt": DT} | changes))
    assert refusal.value.field == field
