"""Chains of derivatives against SciPy's discretisations and the stated accuracy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import bilinear, cont2discrete, dlsim, freqresp, lfilter, lsim

from wheelhop.filtering import rational

DT = 2e-3
SCALE = 2 * np.pi * 20.0
D = [1.0, 1.7, 1.3, 0.45, 0.06]  # of p = s / SCALE, ascending
NUMERATORS = ([3.0], [0.2, 0.01, 4e-5], [1.0, -0.02, 3e-5, 1e-7, 2e-9])
SAMPLES = 300


def chain(method="exact", dt=DT):
    return rational.chain(jnp.asarray(D), SCALE, dt, method)


def continuous(numerator):
    """The same N / D in s for SciPy, descending."""
    return numerator[::-1], [d / SCALE**i for i, d in enumerate(D)][::-1]


@jax.jit
def response(of, u, variance, weights):
    """Sums of the entries over a record [numerators, time], and their variances at its end."""
    state = rational.begin(of, jnp.zeros(()), jnp.zeros(()))

    def step(state, now):
        state = rational.advance(of, state, now, variance)
        return state, jax.vmap(lambda w: rational.value(state, w))(weights)

    state, sums = jax.lax.scan(step, state, u)
    return sums.T, jax.vmap(lambda w: rational.covariance(state, w, w))(weights)


def driven(of, u, variance=0.0):
    weights = jnp.stack([rational.combination(of, list(n)) for n in NUMERATORS])
    return jax.tree.map(np.asarray, response(of, jnp.asarray(u), variance, weights))


@pytest.fixture(scope="module")
def noise():
    return np.random.default_rng(0).normal(size=SAMPLES)


def test_exact_is_scipys_first_order_hold(noise):
    """SciPy's "foh" is the one that is linear between samples; lsim interpolates so too."""
    sums, _ = driven(chain(), noise)
    for numerator, found in zip(NUMERATORS, sums, strict=True):
        discrete = cont2discrete(continuous(numerator), DT, method="foh")
        _, expected = dlsim(discrete, noise)
        np.testing.assert_allclose(found, expected[:, 0], rtol=1e-7, atol=1e-7)
    t = np.arange(SAMPLES + 1) * DT
    _, expected, _ = lsim(continuous(NUMERATORS[1]), np.append(0.0, noise), t)
    np.testing.assert_allclose(sums[1], expected[1:], rtol=1e-8, atol=1e-8)


def test_bilinear_is_scipys(noise):
    sums, _ = driven(chain("bilinear"), noise)
    for numerator, found in zip(NUMERATORS, sums, strict=True):
        expected = lfilter(*bilinear(*continuous(numerator), fs=1 / DT), noise)
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("method", ["exact", "bilinear"])
def test_response_is_that_of_the_running_chain(method, noise):
    """Fourier transform of the response to a pulse."""
    of = chain(method)
    pulse = np.zeros(SAMPLES)
    pulse[0] = 1.0
    sums, _ = driven(of, pulse)
    hz = np.array([0.0, 3.0, 40.0, 220.0])
    turn = np.exp(-2j * np.pi * hz[:, None] * np.arange(SAMPLES) * DT)
    for numerator, found in zip(NUMERATORS, sums, strict=True):
        np.testing.assert_allclose(
            rational.response(of, numerator, hz), turn @ found, rtol=1e-6, atol=1e-6
        )


def test_a_signal_linear_between_samples_is_seen_with_all_its_images():
    """sinc^2 is the weight of the frequency itself; what N / D passes about the sampling rate and
    its multiples adds to it."""
    hz = np.array([0.5, 5.0, 30.0, 150.0])
    k = np.arange(-400, 401)
    for numerator in NUMERATORS[:2]:
        images = hz[:, None] + k / DT
        passed = freqresp(continuous(numerator), 2 * np.pi * images.ravel())[1]
        expected = (np.sinc(images * DT) ** 2 * passed.reshape(images.shape)).sum(1)
        found = rational.response(chain(), numerator, hz)
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_bilinear_warps_frequencies_exactly():
    hz = np.array([0.5, 5.0, 30.0, 150.0])
    warped = np.tan(np.pi * hz * DT) / (np.pi * DT)
    for numerator in NUMERATORS:
        expected = freqresp(continuous(numerator), 2 * np.pi * warped)[1]
        found = rational.response(chain("bilinear"), numerator, hz)
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_the_stated_figures_hold_at_a_twentieth_of_the_sampling_rate():
    """0.3 % at f dt = 0.03, where the low-pass has faded before the sampling rate."""
    hz = 0.03 / DT
    assert 1 - np.sinc(hz * DT) ** 2 == pytest.approx(0.003, abs=1e-4)
    assert np.tan(np.pi * hz * DT) / (np.pi * hz * DT) - 1 == pytest.approx(0.003, abs=1e-4)
    ideal = freqresp(continuous([1.0]), [2 * np.pi * hz])[1]
    found = rational.response(chain(), [1.0], [hz])
    np.testing.assert_allclose(found / ideal, np.sinc(hz * DT) ** 2, rtol=2e-4)


def test_order_of_convergence_is_two():
    """Half the interval, a quarter of the error, for both methods and every numerator."""
    hz = np.array([2.0, 11.0])
    for numerator in NUMERATORS:
        ideal = freqresp(continuous(numerator), 2 * np.pi * hz)[1]
        for method in ("exact", "bilinear"):
            errors = [
                abs(rational.response(chain(method, dt), numerator, hz) - ideal)
                for dt in (4e-4, 2e-4)
            ]
            np.testing.assert_allclose(errors[0] / errors[1], 4.0, rtol=0.02)


def test_covariance_is_that_of_the_pulse_response():
    """Of white noise, the sum of squares of the pulse response."""
    pulse = np.zeros(SAMPLES)
    pulse[0] = 1.0
    for method in ("exact", "bilinear"):
        sums, variances = driven(chain(method), pulse, 0.7**2)
        np.testing.assert_allclose(variances, 0.7**2 * (sums**2).sum(1), rtol=1e-6)


def test_a_constant_signal_stays():
    of = chain()
    state = rational.begin(of, jnp.asarray(0.4), jnp.asarray(9.0))
    moved = rational.advance(of, state, jnp.asarray(0.4), 0.0)
    np.testing.assert_allclose(moved.entries, [0.4, 0.0, 0.0, 0.0, 0.4], atol=1e-12)
    weights = rational.combination(of, [1.0, 0.3, 0.1])
    np.testing.assert_allclose(rational.value(state, weights), 0.4)
    np.testing.assert_allclose(rational.covariance(state, weights, weights), 9.0)


def test_a_lost_sample_is_the_one_before():
    of = chain()
    state = rational.begin(of, jnp.asarray(0.4), jnp.asarray(0.0))
    state = rational.advance(of, state, jnp.asarray(0.7), 0.0)
    for lost in (np.nan, np.inf):
        found = rational.advance(of, state, jnp.asarray(lost), 0.0)
        expected = rational.advance(of, state, jnp.asarray(0.7), 0.0)
        np.testing.assert_array_equal(found.entries, expected.entries)


def test_a_lost_sample_tells_nothing():
    """A held value is uncertain as the sample that it repeats, or as the prior."""
    of = chain()
    state = rational.begin(of, jnp.asarray(0.4), jnp.asarray(9.0))
    for _ in range(50):
        state = rational.advance(of, state, jnp.asarray(np.nan), 1e-4)
    weights = rational.combination(of, [1.0])
    assert float(rational.covariance(state, weights, weights)) >= 9.0 * (1 - 1e-9)


def test_mixture_has_the_moments_of_its_parts():
    rng = np.random.default_rng(1)
    entries = rng.normal(size=(3, 5))
    roots = rng.normal(size=(3, 5, 5))
    cov = roots @ roots.transpose(0, 2, 1)
    weights = np.array([0.2, 0.5, 0.3])
    found = rational.mixed(
        jnp.asarray(weights), rational.Chained(jnp.asarray(entries), jnp.asarray(cov))
    )
    mean = weights @ entries
    second = np.einsum("m,mij->ij", weights, cov + entries[:, :, None] * entries[:, None])
    np.testing.assert_allclose(found.entries, mean)
    np.testing.assert_allclose(found.cov, second - np.outer(mean, mean))


def test_refusals():
    with pytest.raises(ValueError, match="positive sampling interval"):
        chain(dt=0.0)
    with pytest.raises(ValueError, match="positive sampling interval"):
        chain(dt=float("nan"))
    with pytest.raises(ValueError, match="more poles"):
        rational.combination(chain(), [1.0] * 6)
