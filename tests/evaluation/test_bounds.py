"""Cramer-Rao bounds against closed forms, dense Gaussian likelihoods and the filter's own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve, expm, solve_continuous_lyapunov, solve_triangular

from wheelhop.errors import InputError
from wheelhop.evaluation.bound_cases import BoundSettings, bound_cases, shown_times
from wheelhop.evaluation.bounds import (
    Information,
    bound,
    corner_information,
    deviation,
    pair_information,
    pooled,
    pressure_deviation,
    spectral_information,
)
from wheelhop.evaluation.filter_information import filter_information
from wheelhop.evaluation.linearisation import linearised
from wheelhop.evaluation.spectra import (
    CORNER_UNKNOWNS,
    ROAD_UNKNOWNS,
    IsoRoad,
    SampledSpectrum,
    corner_spectrum,
    pair_spectrum,
)
from wheelhop.vehicle.parameters import brancati_suv
from wheelhop.vehicle.suspension import Suspension
from wheelhop.vehicle.tire import stiffness_from_pressure

CAR = replace(brancati_suv(), suspension=Suspension(33.6e3, 0.0, 2400.0, 0.0))
REAR = replace(brancati_suv("rear"), suspension=CAR.suspension)
ROAD = IsoRoad(4e-6)
SPEED, PRESSURE, WHEELBASE = 60 / 3.6, 180e3, 2.818
ALL = (*CORNER_UNKNOWNS, *ROAD_UNKNOWNS)


def percent(information, name="k_t", minus=None, time=(2.0, 10.0)):
    return 100 * deviation(bound(information, np.array(time)), name, minus)


def pair(coherence, free=("k_t", "level"), cars=(CAR, REAR), pressures=(180e3, 230e3)):
    return pair_information(cars, pressures, ROAD, SPEED, WHEELBASE, coherence, free=free)


# an exact sampled record, written down without the package


def dense_covariance(samples, k_t, level, m_s=CAR.sprung_mass, c_s=2400.0, dt=0.002):
    """Covariance of `samples` pairs (a_s, a_u) of the stationary linear corner, [2n, 2n]."""
    m_u, k_s = 61.14, 33.6e3
    a = np.array(
        [
            [0, 0, 1, -1],
            [0, 0, 0, 1],
            [-k_s / m_s, 0, -c_s / m_s, c_s / m_s],
            [k_s / m_u, -k_t / m_u, c_s / m_u, -c_s / m_u],
        ]
    )
    b = np.array([[0.0], [-1.0], [0.0], [0.0]])
    state = solve_continuous_lyapunov(a, -np.pi * level * SPEED * (b @ b.T))
    c, step = a[2:], expm(a * dt)
    lags, power = [], state
    for _ in range(samples):
        lags.append(c @ power @ c.T)
        power = step @ power
    # C(-l) = C(l)^T
    both = np.array([lag.T for lag in lags[:0:-1]] + lags)
    place = np.arange(samples)
    blocks = both[place[:, None] - place + samples - 1]
    cov = blocks.transpose(0, 2, 1, 3).reshape(2 * samples, 2 * samples)
    return cov + 0.25 * np.eye(2 * samples)


K_T = float(stiffness_from_pressure(PRESSURE, CAR.tire))


def expected_curvature(samples, names, h=2e-3):
    """Minus the second differences of the expected exact log-likelihood at the truth."""
    truth = {"k_t": K_T, "level": ROAD.level, "m_s": CAR.sprung_mass, "c_s": 2400.0}
    here = dense_covariance(samples, **truth)

    def log_likelihood(offset):
        moved = {
            n: v * np.exp(dict(zip(names, offset, strict=True)).get(n, 0.0))
            for n, v in truth.items()
        }
        factor = cho_factor(dense_covariance(samples, **moved), lower=True)
        half_det = np.sum(np.log(np.diag(factor[0])))
        return -half_det - 0.5 * np.trace(cho_solve(factor, here))

    p, unit = len(names), h * np.eye(len(names))
    center = log_likelihood(np.zeros(p))
    result = np.empty((p, p))
    for i in range(p):
        for j in range(i + 1):
            # mixed derivative from the polarisation of two second differences
            both, apart = unit[i] + unit[j], unit[i] - unit[j]
            plus = log_likelihood(both) + log_likelihood(-both)
            minus = 2 * center if i == j else log_likelihood(apart) + log_likelihood(-apart)
            result[i, j] = result[j, i] = -(plus - minus) / (4 * h * h)
    return result


def test_information_is_the_curvature_of_the_exact_likelihood_of_a_short_record():
    names = ("k_t", "level", "c_s")
    # the ends of the record drop out of the difference of two lengths
    gained = expected_curvature(250, names) - expected_curvature(125, names)
    rate = corner_information(CAR, PRESSURE, ROAD, SPEED, free=names).rate
    np.testing.assert_allclose(0.25 * rate, gained, rtol=0.01, atol=0.01 * rate[2, 2] * 0.25)


def test_exact_maximum_likelihood_spreads_as_the_bound_says():
    samples, runs = 200, 400
    rng = np.random.default_rng(7)
    root = np.linalg.cholesky(dense_covariance(samples, K_T, ROAD.level))
    records = root @ rng.standard_normal((2 * samples, runs))
    said = deviation(
        bound(corner_information(CAR, PRESSURE, ROAD, SPEED, free=("k_t",)), np.array([0.4])), "k_t"
    )[0]
    grid = said * np.linspace(-4.5, 4.5, 13)
    value = np.empty((len(grid), runs))
    for i, offset in enumerate(grid):
        factor = np.linalg.cholesky(dense_covariance(samples, K_T * np.exp(offset), ROAD.level))
        white = solve_triangular(factor, records, lower=True)
        value[i] = -np.sum(np.log(np.diag(factor))) - 0.5 * np.sum(white**2, 0)
    best = np.argmax(value, 0)
    assert np.all((best > 0) & (best < len(grid) - 1))
    low, mid, high = (value[best + k, np.arange(runs)] for k in (-1, 0, 1))
    found = grid[best] + 0.5 * (grid[1] - grid[0]) * (low - high) / (low - 2 * mid + high)
    # the spread of 400 runs is itself known to 3.5 %
    assert np.sqrt(np.mean(found**2)) == pytest.approx(said, rel=0.1)
    assert abs(np.mean(found)) < 0.2 * said


@pytest.mark.parametrize(
    ("free", "speed", "level"),
    [(("k_t", "level", "m_s", "k_s", "c_s", "m_u"), SPEED, 4e-6), (("k_t", "level"), 11.0, 64e-6)],
)
def test_the_stationary_filter_gathers_what_the_spectrum_holds(free, speed, level):
    road = IsoRoad(level)
    spectral = corner_information(CAR, PRESSURE, road, speed, free=free).rate
    filtered = filter_information(CAR, PRESSURE, road, speed, free=free).rate
    scale = np.sqrt(np.diag(spectral))
    np.testing.assert_allclose(
        filtered / scale / scale[:, None], spectral / scale / scale[:, None], atol=1e-4
    )


def test_a_coloured_road_is_worth_the_same_to_the_filter_within_its_shaping():
    # the filter's shaping follows the spectrum up to 5 cycles/m and levels off beyond
    road = IsoRoad(4e-6, 1.8)
    args = (CAR, PRESSURE, road, SPEED)
    ratio = filter_information(*args).rate / corner_information(*args).rate
    np.testing.assert_allclose(ratio, 1.0, atol=0.03)


def test_information_of_an_autoregression_is_its_textbook_value():
    phi, variance, rate = 0.6, 2.0, 50.0
    f = rate / 2 * (np.arange(4000) + 0.5) / 4000
    across = 1 - phi * np.exp(-2j * np.pi * f / rate)
    density = variance / rate / np.abs(across) ** 2
    by_phi = density * 2 * np.real(np.exp(-2j * np.pi * f / rate) / across)
    spectrum = SampledSpectrum(
        f,
        density[:, None, None].astype(complex),
        {"phi": by_phi[:, None, None], "log variance": density[:, None, None]},
    )
    found = spectral_information(spectrum, ("phi", "log variance")).rate / rate
    np.testing.assert_allclose(found, np.diag([1 / (1 - phi**2), 0.5]), atol=1e-9)


def test_slopes_are_the_derivatives_of_the_spectrum():
    road, h = IsoRoad(4e-6, 2.2), 1e-5

    def moved(name, by):
        factor, s = np.exp(by), CAR.suspension
        tire = replace(CAR.tire, stiffness=CAR.tire.stiffness * factor)
        cars = {
            "k_t": replace(CAR, tire=tire),
            "m_s": replace(CAR, sprung_mass=CAR.sprung_mass * factor),
            "m_u": replace(CAR, unsprung_mass=CAR.unsprung_mass * factor),
            "k_s": replace(CAR, suspension=replace(s, stiffness=s.stiffness * factor)),
            "c_s": replace(CAR, suspension=replace(s, damping=s.damping * factor)),
        }
        roads = {
            "level": IsoRoad(road.level * factor, road.waviness),
            "waviness": IsoRoad(road.level, road.waviness + by),
        }
        return cars.get(name, CAR), roads.get(name, road)

    def single(car, road):
        return corner_spectrum(car, PRESSURE, road, SPEED)

    def double(car, road, shift=0.0):
        delay = WHEELBASE / SPEED + shift
        return pair_spectrum((car, REAR), (180e3, 230e3), road, SPEED, delay, 0.9)

    paired = ("k_t", "level", "waviness")
    for name in ALL:
        for spectrum in (single, double) if name in paired else (single,):
            high, low = (spectrum(*moved(name, way * h)).density for way in (1, -1))
            slopes = spectrum(CAR, road).slopes
            slope = slopes.get(name, slopes.get(f"{name} front"))
            np.testing.assert_allclose(
                slope, (high - low) / (2 * h), rtol=0, atol=1e-7 * np.abs(slope).max()
            )
    h = 1e-7
    high, low = (double(CAR, road, way * h).density for way in (1, -1))
    slope = double(CAR, road).slopes["delay"]
    np.testing.assert_allclose(
        slope, (high - low) / (2 * h), rtol=0, atol=1e-4 * np.abs(slope).max()
    )


def test_the_information_does_not_depend_on_units():
    spectrum = corner_spectrum(CAR, PRESSURE, ROAD, SPEED)
    units = np.diag([9.81, 1e-3])
    scaled = SampledSpectrum(
        spectrum.frequency,
        units @ spectrum.density @ units,
        {name: units @ slope @ units for name, slope in spectrum.slopes.items()},
    )
    np.testing.assert_allclose(
        spectral_information(scaled, ALL).rate, spectral_information(spectrum, ALL).rate, rtol=1e-9
    )


def test_information_is_semidefinite_and_more_unknowns_never_help():
    whole = corner_information(CAR, PRESSURE, ROAD, SPEED, free=ALL).rate
    scale = np.sqrt(np.diag(whole))
    assert np.linalg.eigvalsh(whole / scale / scale[:, None]).min() > -1e-12
    before = 0.0
    for count in range(1, len(ALL) + 1):
        free = ("k_t", "level", "waviness", "c_s", "m_s", "k_s", "m_u")[:count]
        now = percent(corner_information(CAR, PRESSURE, ROAD, SPEED, free=free))[0]
        assert now >= before
        before = now
    # a common factor of all masses, springs and dampers cannot be seen
    assert before == np.inf


def test_less_noise_and_a_higher_rate_never_hurt():
    def at(noise, rate):
        return percent(corner_information(CAR, PRESSURE, ROAD, SPEED, (noise, noise), rate=rate))[0]

    assert at(0.1, 500.0) < at(0.5, 500.0) < at(2.0, 500.0)
    assert at(0.5, 1000.0) < at(0.5, 500.0) < at(0.5, 250.0)


def test_the_sampling_rate_alone_limits_a_known_road():
    # far above the resonance ln S = 2 ln k_t + ...: 4 x 250 Hz of information a second, without
    # noise; the resonance adds a little
    quiet = corner_information(CAR, PRESSURE, IsoRoad(1e-3), SPEED, free=("k_t",))
    floor = 100 / np.sqrt(4 * 250 * 2.0)
    assert 0.94 * floor < percent(quiet)[0] < floor


@pytest.mark.parametrize("kmh", [40, 80])
@pytest.mark.parametrize(("letter", "known"), [("A", (2.7, 3.2)), ("D", (2.15, 2.3))])
def test_table_of_the_corner(kmh, letter, known):
    road = IsoRoad({"A": 1e-6, "D": 64e-6}[letter])

    def at(*free):
        return percent(corner_information(CAR, PRESSURE, road, kmh / 3.6, free=("k_t", *free)))

    assert known[0] < at()[0] < known[1]
    assert 11.2 < at("level")[0] < 11.9
    assert 5.0 < at("level")[1] < 5.35
    assert at("level", "m_s", "k_s", "c_s")[0] < 1.03 * at("level")[0]


@pytest.mark.parametrize(
    ("coherence", "said"), [(0.99, (4.5, 2.0)), (0.9, (7.2, 3.2)), (0.0, (7.9, 3.5))]
)
def test_table_of_the_axle_pair(coherence, said):
    np.testing.assert_allclose(percent(pair(coherence), "k_t front"), said, rtol=0.03)


def test_equal_wheels_in_one_track_tell_their_difference_only():
    same = pair(1.0, cars=(CAR, CAR), pressures=(180e3, 180e3))
    lone = percent(corner_information(CAR, PRESSURE, ROAD, SPEED))
    # the rear wheel repeats the front wheel: no second look at the pressure of both
    np.testing.assert_allclose(percent(same, "k_t front"), lone, rtol=0.03)
    assert percent(same, "k_t front", "k_t rear")[0] < 0.06 * lone[0]


def test_the_better_the_coherence_the_better_the_difference():
    found = [percent(pair(c), "k_t front", "k_t rear")[0] for c in (1.0, 0.99, 0.9, 0.0)]
    assert found == sorted(found)
    assert found[-1] > 5 * found[0]


def test_an_incoherent_pair_is_two_corners_of_one_level():
    both = pair(0.0, ("k_t", "level", "c_s"))
    corners = {
        "front": corner_information(CAR, 180e3, ROAD, SPEED, free=("k_t", "level", "c_s")),
        "rear": corner_information(REAR, 230e3, ROAD, SPEED, free=("k_t", "level", "c_s")),
    }
    apart = pooled(corners)
    order = [apart.names.index(name) for name in both.names]
    np.testing.assert_allclose(both.rate, apart.rate[np.ix_(order, order)], rtol=1e-9, atol=1e-9)


def test_a_delay_that_nothing_tells_is_not_determined_and_harms_nothing():
    unknown, known = pair(0.0, ("k_t", "level", "delay")), pair(0.0)
    np.testing.assert_allclose(percent(unknown, "k_t front"), percent(known, "k_t front"))
    assert np.all(np.isinf(percent(unknown, "delay")))


def test_four_corners_share_a_level():
    one = corner_information(CAR, PRESSURE, ROAD, SPEED)
    known = corner_information(CAR, PRESSURE, ROAD, SPEED, free=("k_t",))
    four = pooled(dict.fromkeys(("FL", "FR", "RL", "RR"), one))
    assert four.names == ("k_t FL", "level", "k_t FR", "k_t RL", "k_t RR")
    assert percent(known)[0] < percent(four, "k_t FL")[0] < percent(one)[0]
    # the common level drops out of a difference
    np.testing.assert_allclose(
        percent(four, "k_t FL", "k_t RR"), np.sqrt(2) * percent(known), rtol=1e-9
    )


def test_a_prior_and_a_walk_follow_the_scalar_riccati_equation():
    rate, prior, walk = 40.0, 0.3, 0.05
    t = np.array([0.0, 0.1, 1.0, 7.0, 900.0])
    scalar = Information(("k_t",), np.array([[rate]]))
    found = deviation(bound(scalar, t, {"k_t": prior}, {"k_t": walk}), "k_t") ** 2
    steady = walk / np.sqrt(rate)
    # P' = walk^2 - rate P^2 has the solution steady tanh or coth
    phase = np.arctanh(steady / prior**2)
    exact = steady / np.tanh(walk * np.sqrt(rate) * t + phase)
    np.testing.assert_allclose(found, exact, rtol=1e-9)
    still = deviation(bound(scalar, t, {"k_t": prior}), "k_t")
    np.testing.assert_allclose(still, 1 / np.sqrt(rate * t + prior**-2))


def test_a_tiny_walk_changes_nothing_and_a_walk_never_helps():
    four = pooled(dict.fromkeys(("FL", "FR"), corner_information(CAR, PRESSURE, ROAD, SPEED)))
    t = np.array([0.0, 1.0, 30.0])
    still = bound(four, t)
    tiny = bound(four, t, walk={"k_t FL": 1e-7, "level": 1e-7})
    largest = still.information.max()
    np.testing.assert_allclose(tiny.information, still.information, rtol=0, atol=1e-7 * largest)
    moving = bound(four, t, walk={"level": 0.1})
    for pick in (("k_t FL",), ("level",), ("k_t FL", "k_t FR")):
        assert np.all(deviation(moving, *pick)[1:] >= deviation(still, *pick)[1:] * (1 - 1e-9))
    assert deviation(moving, "level")[-1] > 1.5 * deviation(still, "level")[-1]


def test_pressure_follows_from_the_tyre():
    relative, h = np.array([0.01]), 10.0
    slope = (stiffness_from_pressure(PRESSURE + h, CAR.tire) - K_T) / h
    assert pressure_deviation(relative, CAR, PRESSURE)[0] == pytest.approx(0.01 * K_T / slope)


def test_linearisation_moves_springs_and_dampers_with_the_road():
    car = brancati_suv()
    smooth, rough = (linearised(car, PRESSURE, IsoRoad(g), SPEED).suspension for g in (1e-8, 64e-6))
    assert smooth.damping == pytest.approx(2400.0, rel=0.01)
    assert smooth.stiffness == pytest.approx(33.6e3, rel=0.001)
    assert (rough.cubic_stiffness, rough.quadratic_damping) == (0.0, 0.0)
    # the stationary covariance of the linear corner, by Lyapunov's equation
    m_s, m_u = car.sprung_mass, car.unsprung_mass
    k, c = rough.stiffness, rough.damping
    a = np.array(
        [
            [0, 0, 1, -1],
            [0, 0, 0, 1],
            [-k / m_s, 0, -c / m_s, c / m_s],
            [k / m_u, -K_T / m_u, c / m_u, -c / m_u],
        ]
    )
    q = np.zeros((4, 4))
    q[1, 1] = np.pi * 64e-6 * SPEED
    cov = solve_continuous_lyapunov(a, -q)
    velocity = np.array([0, 0, 1, -1])
    sigma = np.sqrt(velocity @ cov @ velocity)
    assert c == pytest.approx(2400 + 500 * np.sqrt(8 / np.pi) * sigma, rel=2e-3)
    assert k == pytest.approx(33.6e3 + 3e5 * cov[0, 0], rel=2e-3)


def test_cases_are_those_of_the_single_calls():
    settings = BoundSettings((CAR, REAR), (180e3, 230e3), ROAD, SPEED, WHEELBASE, prior=0.3)
    cases = {case.key: case for case in bound_cases(settings, np.array([2.0, 10.0]))}
    lone = corner_information(CAR, PRESSURE, ROAD, SPEED)
    alone = deviation(bound(lone, np.array([2.0, 10.0]), {"k_t": 0.3}), "k_t")
    np.testing.assert_allclose(cases["unknown"].relative, alone, rtol=1e-9)
    assert cases["known"].relative[0] < cases["four"].relative[0] < cases["unknown"].relative[0]
    assert [key for key, case in cases.items() if case.difference] == [
        "four_difference",
        *(f"pair_{c}_difference" for c in ("1", "0.99", "0.9", "0")),
    ]
    assert shown_times(10.0) == [1.0, 2.0, 5.0, 10.0]
    assert shown_times(12.0, 3) == [5.0, 10.0, 12.0]


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: corner_information(CAR, PRESSURE, ROAD, SPEED, free=("k_t", "delay")), "delay"),
        (lambda: corner_information(CAR, PRESSURE, ROAD, SPEED, free=()), "names none"),
        (lambda: corner_information(CAR, PRESSURE, ROAD, 0.1), "speed"),
        (lambda: corner_information(CAR, PRESSURE, IsoRoad(4e-6, 5.0), SPEED), "waviness"),
        (lambda: corner_information(CAR, PRESSURE, ROAD, SPEED, (0.0, 0.5)), "noise"),
        (lambda: pair(1.2), "coherence"),
        (lambda: filter_information(CAR, PRESSURE, ROAD, SPEED, free=("delay",)), "delay"),
        (lambda: pooled({}), "none"),
        (lambda: bound(pair(0.0), np.array([2.0, 1.0])), "increasing"),
        (lambda: bound(pair(0.0), np.array([1.0]), {"k_t": 0.1}), "k_t front"),
        (lambda: bound(pair(0.0), np.array([1.0]), {"level": -0.1}), "positive"),
    ],
)
def test_bad_input_says_what_to_do(call, says):
    with pytest.raises(InputError, match=says):
        call()
