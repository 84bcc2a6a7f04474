"""Mass and centre of mass at rest: exact on exact data, rank, noise, and the full vehicle."""

import re
from dataclasses import replace
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from tests.oracles.vehicle_numpy import gravity, plain, tire_stiffness
from tests.vehicle.driving import rest, surroundings
from wheelhop.errors import InputError
from wheelhop.estimators.mass_at_rest import mass_at_rest
from wheelhop.estimators.resting_stretch import Stands, at_rest
from wheelhop.vehicle.full_vehicle_parameters import suv, with_payload

G = 9.80665
CAR = suv()
C, K = plain(CAR.chassis), plain(CAR.strut)
BASE = float(C["front_arm"] + C["rear_arm"])
TRACK = 0.5 * float(C["front_track"] + C["rear_track"])
WHEELS = float(C["wheel_mass"].sum())
NOMINAL = np.full(4, 250e3)
SIGMA = 5e-5
SLOPE = np.arctan(0.2)


def told(estimate):
    return np.array([float(v) for v in estimate.distribution[:4]])


def eq_31(mass, front, left, height, a_x, a_y):
    """The four loads, each term written out."""
    rear, right = BASE - front, TRACK - left
    lw = BASE * TRACK
    return np.array(
        [
            mass * G * rear * right / lw - mass * height * (right * a_x + rear * a_y) / lw,
            mass * G * rear * left / lw - mass * height * (left * a_x - rear * a_y) / lw,
            mass * G * front * right / lw + mass * height * (right * a_x - front * a_y) / lw,
            mass * G * front * left / lw + mass * height * (left * a_x + front * a_y) / lw,
        ]
    )


def printed_stands(truth, slopes):
    q = [(eq_31(*truth, *slope) - K["preload"]) / K["stiffness"] for slope in slopes]
    return Stands(np.array(q), *np.array(slopes, float).T)


# height of the whole as designed, on linear tyres; hubs stand a loaded radius above the road
TIRE = plain(CAR.tire.vertical)
ARMS = np.array([C["front_arm"], C["front_arm"], -C["rear_arm"], -C["rear_arm"]])
LOAD = G * (0.5 * C["body_mass"] * np.abs(ARMS)[[2, 3, 0, 1]] / BASE + C["wheel_mass"])
RADIUS = TIRE["unloaded_radius"] - LOAD / tire_stiffness(TIRE, NOMINAL)
CENTRE = np.mean(C["hub_drop"] + RADIUS)
HEIGHT = float(CENTRE - C["wheel_mass"] @ C["hub_drop"] / (C["body_mass"] + WHEELS))
BODY = (2100.0, 1.38, 0.78, 0.65)


@pytest.mark.parametrize(
    ("slopes", "kept"),
    [
        ([(0.0, 0.0)], ("height",)),
        ([(1.9, 0.0)], ("height",)),
        ([(1.9, 1.1)], ()),
        ([(0.0, 0.0), (1.9, 0.0)], ()),
        ([(0.0, 0.0), (0.0, -1.5), (0.7, 0.0)], ()),
    ],
)
def test_the_printed_equations_are_solved_exactly(slopes, kept):
    """Where the stands do not tell the height the prior is given the true one."""
    raised = BODY[3] - HEIGHT if kept else 0.0
    found = mass_at_rest(printed_stands(BODY, slopes), CAR, SIGMA, method="printed", raised=raised)
    assert found.kept == kept
    assert found.body_mass == pytest.approx(BODY[0], rel=1e-9)
    expected = (BODY[0] + WHEELS, *BODY[1:])
    np.testing.assert_allclose(told(found), expected, rtol=1e-8)


def scaled_jacobian(slopes):
    """Of Eq. 31 by central differences, which its products of two unknowns make exact."""
    columns = []
    for k, size in enumerate((C["body_mass"], BASE, TRACK, HEIGHT)):
        step = 0.1 * size * np.eye(4)[k]
        pairs = [[eq_31(*(BODY + sign * step), *s) for s in slopes] for sign in (1, -1)]
        columns.append(np.ravel(np.subtract(*pairs)) / 0.2 / (C["body_mass"] * G))
    return np.stack(columns, axis=1)


def test_what_eq_35_tells_and_what_not():
    """Rank 3 on the level and on a slope one way; sloping both ways the height is a small term."""
    values = {}
    for name, slopes in {
        "level": [(0.0, 0.0)],
        "one way": [(1.9, 0.0)],
        "both ways": [(1.9, 1.1)],
        "two stands": [(0.0, 0.0), (1.9, 0.0)],
    }.items():
        expected = np.linalg.svd(scaled_jacobian(slopes), compute_uv=False)
        raised = BODY[3] - HEIGHT if len(slopes) == 1 and not all(slopes[0]) else 0.0
        seen = printed_stands(BODY, slopes)
        found = mass_at_rest(seen, CAR, SIGMA, method="printed", raised=raised)
        np.testing.assert_allclose(found.singular_values, expected, rtol=1e-6, atol=1e-14)
        values[name] = (found, expected[3] / expected[0])
    assert [values[n][0].rank for n in values] == [3, 3, 4, 4]
    assert values["level"][1] < 1e-15
    assert values["one way"][1] < 1e-12
    assert 60 < values["both ways"][0].condition < 300
    assert any("warp" in r for r in values["both ways"][0].remarks)
    assert not any("warp" in r for r in values["two stands"][0].remarks)
    # on the one-way slope m g l_F + m h a_x stands still along this direction
    null = np.array([0.0, 1.9 / G / BASE, 0.0, -1.0 / HEIGHT])
    np.testing.assert_allclose(scaled_jacobian([(1.9, 0.0)]) @ null, 0.0, atol=1e-14)


def test_two_centres_of_mass_make_the_same_printed_loads():
    """The height enters squared: its mirror below the road fits as well."""
    a_x, a_y = 1.9, 1.1
    mass, front, left, height = BODY
    mirrored = (mass, front + 2 * height * a_x / G, left + 2 * height * a_y / G, -height)
    np.testing.assert_allclose(eq_31(*mirrored, a_x, a_y), eq_31(*BODY, a_x, a_y), rtol=1e-13)


def stands(car, slopes):
    """Deflections of the full vehicle, and what accelerometers on its leaning body show."""
    q, felt = [], []
    for slope in slopes:
        found = rest(car, NOMINAL, surroundings(**slope))
        turn = Rotation.from_euler("ZYX", [0.0, float(found.pitch), float(found.roll)]).as_matrix()
        q.append(np.asarray(found.compression))
        felt.append(-turn.T @ gravity(slope.get("grade", 0.0), slope.get("bank", 0.0)))
    return Stands(np.array(q), *np.array(felt)[:, :2].T)


def moved(car, ahead, up):
    """The same vehicle with the body's centre of mass elsewhere."""
    c = car.chassis
    c = replace(
        c,
        front_arm=c.front_arm - ahead,
        rear_arm=c.rear_arm + ahead,
        hub_drop=c.hub_drop + up,
    )
    return replace(car, chassis=c)


def whole(car):
    """Mass, l_F and w_L from all masses."""
    c = plain(car.chassis)
    mass = float(c["body_mass"] + c["wheel_mass"].sum())
    arms = np.array([0.0, 0.0, BASE, BASE])
    front = (c["body_mass"] * c["front_arm"] + c["wheel_mass"] @ arms) / mass
    return np.array([mass, float(front), TRACK / 2])


LADEN = moved(with_payload(CAR, 450.0), -0.12, 0.05)
PLACES = {
    "level": [{}],
    "grade": [{"grade": SLOPE}],
    "both ways": [{"grade": SLOPE, "bank": 0.1}],
    "two stands": [{}, {"grade": SLOPE}],
    "two grades": [{"grade": SLOPE}, {"grade": -SLOPE}],
}


@pytest.mark.parametrize("place", PLACES)
def test_equilibrium_finds_the_full_vehicle(place):
    """A payload of 450 kg behind and above; believed height right where stands do not tell it."""
    seen = stands(LADEN, PLACES[place])
    single = len(PLACES[place]) == 1
    found = mass_at_rest(seen, CAR, SIGMA, raised=0.05 if single else 0.0)
    assert found.kept == (("height",) if single else ())
    assert found.rank == (3 if single else 4)
    np.testing.assert_allclose(told(found)[:3], whole(LADEN), rtol=1e-7)
    assert found.body_mass == pytest.approx(whole(LADEN)[0] - WHEELS, rel=1e-9)
    assert found.chi_square < 1e-6
    if not single:
        right = mass_at_rest(seen, CAR, SIGMA, raised=0.05)
        assert told(found)[3] == pytest.approx(told(right)[3], abs=1e-7)
        level = mass_at_rest(stands(LADEN, [{}]), CAR, SIGMA, raised=0.05)
        # the struts sink differently on a slope, so that the height differs by millimetres
        assert told(found)[3] == pytest.approx(told(level)[3], abs=0.01)


def test_what_the_printed_method_makes_of_the_full_vehicle():
    """On a 20 % grade its mass is that of the cosine; sloping both ways bars make its warp."""
    seen = stands(LADEN, PLACES["grade"])
    light = mass_at_rest(seen, CAR, SIGMA, method="printed")
    cosine = np.sqrt(1 - (seen.a_x[0] / G) ** 2)
    assert 0.97 < cosine < 0.98
    assert light.body_mass / (whole(LADEN)[0] - WHEELS) == pytest.approx(cosine, abs=1e-5)
    both_ways = stands(LADEN, PLACES["both ways"])
    misled = mass_at_rest(both_ways, CAR, SIGMA, method="printed")
    right = told(mass_at_rest(both_ways, CAR, SIGMA, raised=0.05))
    assert misled.kept == ()
    assert abs(told(misled)[3] - right[3]) > 10 * misled.sigma[3]
    assert any("warp" in remark for remark in misled.remarks)
    assert any("bars are left out" in remark for remark in misled.remarks)
    unladen = mass_at_rest(stands(CAR, PLACES["both ways"]), CAR, SIGMA, method="printed")
    assert unladen.kept == ("height",)
    assert any("contradict" in remark for remark in unladen.remarks)
    # what the springs carry, by the height that moves the whole: h M / m_s
    two = told(mass_at_rest(stands(CAR, PLACES["two grades"]), CAR, SIGMA, method="printed"))
    share = float(C["body_mass"]) / (float(C["body_mass"]) + WHEELS)
    assert two[3] * share == pytest.approx(HEIGHT, rel=0.02)


def test_a_load_to_one_side_is_found_by_energy():
    """Level ground: deflections that minimise the potential energy of body, wheels, all springs."""
    body, place = 2100.0, np.array([-0.1, 0.06, 0.04])
    tires = tire_stiffness(TIRE, NOMINAL)
    x = ARMS
    y = 0.5 * jnp.array([C["front_track"], -C["front_track"], C["rear_track"], -C["rear_track"]])
    bars = [float(CAR.anti_roll.front), float(CAR.anti_roll.rear)]

    def energy(free):
        z, roll, pitch, q = free[0], free[1], free[2], free[3:]
        up = jnp.stack([-jnp.sin(pitch), jnp.sin(roll) * jnp.cos(pitch)])
        up = jnp.append(up, jnp.cos(roll) * jnp.cos(pitch))
        hubs = z + up @ jnp.stack([x, y, q - C["hub_drop"]])
        weight = G * (body * (z + up @ place) + jnp.sum(C["wheel_mass"] * hubs))
        springs = jnp.sum(K["preload"] * q + 0.5 * K["stiffness"] * q**2)
        twist = 0.5 * (bars[0] * (q[0] - q[1]) ** 2 + bars[1] * (q[2] - q[3]) ** 2)
        sunk = TIRE["unloaded_radius"] - hubs
        return weight + springs + twist + 0.5 * jnp.sum(tires * sunk**2)

    slope, curvature = jax.jit(jax.grad(energy)), jax.jit(jax.hessian(energy))
    start = np.r_[float(np.mean(C["hub_drop"])) + 0.34, np.zeros(6)]
    found = root(lambda f: np.asarray(slope(jnp.asarray(f))), start, jac=curvature).x
    assert np.abs(slope(jnp.asarray(found))).max() < 1e-6
    assert 0.002 < abs(found[1]) < 0.05
    assert np.abs(found[3:]).max() < 0.06
    turn = Rotation.from_euler("ZYX", [0.0, found[2], found[1]]).as_matrix()
    felt = turn.T @ [0.0, 0.0, G]
    seen = Stands(found[None, 3:], felt[:1], felt[1:2])
    mass = body + WHEELS
    ahead = (body * place[0] + C["wheel_mass"] @ ARMS) / mass
    expected = [mass, C["front_arm"] - ahead, TRACK / 2 - body * place[1] / mass]
    estimate = mass_at_rest(seen, CAR, SIGMA, raised=0.04)
    np.testing.assert_allclose(told(estimate)[:3], expected, rtol=1e-7)
    # without bars, as printed, the left distance is off
    printed = mass_at_rest(seen, CAR, SIGMA, method="printed")
    assert abs(told(printed)[2] - expected[2]) > 5e-3


def free_springs(stiffer=1.0):
    """Deflections counted from the free spring: no preload is known, the stops are far away."""
    k = CAR.strut.stiffness
    strut = replace(
        CAR.strut,
        preload=jnp.zeros(4),
        stiffness=stiffer * k,
        bump_clearance=jnp.full(4, 0.9),
        rebound_clearance=jnp.full(4, 0.9),
    )
    drop = CAR.chassis.hub_drop + CAR.strut.preload / (stiffer * k)
    return replace(CAR, strut=strut, chassis=replace(CAR.chassis, hub_drop=drop))


@pytest.mark.parametrize("method", ["equilibrium", "printed"])
def test_a_wrong_stiffness_is_a_wrong_mass(method):
    """Springs 50 % stiffer than believed: a third of the mass is missed, as of the load transfer
    (700 N become 467 N; the paper reads 450 N in Fig. 8). Known preloads leave that to what is
    laden."""
    true, body = free_springs(1.5), float(C["body_mass"])
    seen = stands(replace(true, anti_roll=CAR.anti_roll), [{}])
    found = mass_at_rest(seen, free_springs(), SIGMA, method=method)
    assert found.body_mass / body == pytest.approx(1 / 1.5, rel=1e-3)
    believed = mass_at_rest(seen, free_springs(1.5**2), SIGMA, method=method)
    assert believed.body_mass / body == pytest.approx(1.5, rel=1e-3)
    laden = stands(with_payload(CAR, 300.0), [{}])
    stiff = replace(CAR, strut=replace(CAR.strut, stiffness=1.5 * CAR.strut.stiffness))
    found = mass_at_rest(laden, stiff, SIGMA, method=method)
    assert found.body_mass - body == pytest.approx(1.5 * 300, rel=1e-3)


@lru_cache
def stands_of_the_pair():
    with jax.enable_x64(True):
        return stands(LADEN, PLACES["two stands"])


def test_errors_of_noise_have_the_stated_covariance():
    """40 draws; their squared Mahalanobis distances are chi-square of 4 degrees each."""
    exact, draws = stands_of_the_pair(), 40
    rng = np.random.default_rng(2)
    truth = told(mass_at_rest(exact, CAR, SIGMA))
    distance, errors = 0.0, []
    for _ in range(draws):
        noisy = Stands(
            exact.deflection + rng.normal(0, SIGMA, (2, 4)),
            exact.a_x + rng.normal(0, 0.01, 2),
            exact.a_y + rng.normal(0, 0.01, 2),
        )
        found = mass_at_rest(noisy, CAR, SIGMA, acceleration_sigma=0.01)
        error = told(found) - truth
        distance += error @ np.linalg.solve(found.cov, error)
        errors.append(error / found.sigma)
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 4 * draws)
    assert low < distance < high
    assert np.std(errors, axis=0) == pytest.approx(np.ones(4), abs=0.4)


def test_single_precision_outside_changes_nothing(float32):
    seen = stands_of_the_pair()
    car = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), CAR)
    found = mass_at_rest(seen, car, SIGMA)
    np.testing.assert_allclose(told(found)[:3], whole(LADEN), rtol=1e-6)
    assert jnp.asarray(0.0).dtype == jnp.float32


@pytest.mark.parametrize("method", ["equilibrium", "printed"])
def test_a_believed_height_spreads_into_the_distances(method):
    """On a slope l_F moves with the prior of the height; its sigma says so."""
    seen = stands(LADEN, PLACES["grade"])
    low, high = (mass_at_rest(seen, CAR, SIGMA, method=method, raised=r) for r in (0.0, 0.1))
    assert low.kept == ("height",)
    shift = told(high) - told(low)
    assert abs(shift[1]) > 0.015
    noise = mass_at_rest(seen, CAR, SIGMA, method=method, raised_sd=1e-6).cov
    np.testing.assert_allclose(low.cov - noise, np.outer(shift, shift), rtol=0.01, atol=1e-7)
    (said,) = (re.search(r"l_F would be ([-+.0-9]+) mm", r) for r in low.remarks if "kept at" in r)
    assert float(said[1]) == pytest.approx(100 * shift[1] / shift[3], abs=0.2)


def log(standing=3.0, rate=100.0, seed=0):
    """Noise about a stand, then driving off."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, standing + 4.0, 1 / rate)
    going = np.maximum(t - standing, 0.0)
    mean = np.array([0.02, 0.021, 0.03, 0.031])
    q = mean + 0.01 * np.sin(8 * going)[:, None] + rng.normal(0, 5e-4, (len(t), 4))
    speed = 2.0 * going + rng.normal(0, 0.02, len(t))
    return t, q, speed, 1.5 + going, mean


def test_the_calm_start_of_a_log():
    t, q, speed, a_x, mean = log()
    q[5, 2] = np.nan
    found = at_rest(t, q, speed, a_x)
    assert (found.begin, found.end) == (0, 300)
    assert found.deflection_sigma == pytest.approx(5e-4 / np.sqrt(300), rel=0.1)
    assert np.abs(found.stand.deflection[0] - mean).max() < 4 * found.deflection_sigma
    np.testing.assert_allclose([found.stand.a_x[0], found.stand.a_y[0]], [1.5, 0.0])
    assert mass_at_rest(found.stand, CAR, found.deflection_sigma).kept == ("height",)


def test_a_log_that_never_rests_is_refused():
    t, q, speed, _, _ = log()
    with pytest.raises(InputError, match="Log some seconds at rest"):
        at_rest(t, q, speed + 1.0)
    with pytest.raises(InputError, match=r"no 0\.5 s below"):
        at_rest(t, q + 0.02 * t[:, None], speed)
    with pytest.raises(InputError, match="one length"):
        at_rest(t, q[:, :3], speed)


def test_a_log_with_broken_columns_is_refused_by_their_names():
    t, q, speed, _, _ = log()
    for time in (np.full(len(t), 3.0), np.where(t == t[7], np.nan, t)):
        with pytest.raises(InputError, match="t: it does not rise"):
            at_rest(time, q, speed)
    dead = q.copy()
    dead[:, 2] = np.nan
    with pytest.raises(InputError, match="deflection RL: it has no sample"):
        at_rest(t, dead, speed)
    with pytest.raises(InputError, match=r"deflection FL: it reaches .* m, beyond 0\.3 m"):
        at_rest(t, 1e3 * q, speed)


def test_inputs_that_cannot_be_are_refused():
    good = Stands(np.zeros((1, 4)), np.zeros(1), np.zeros(1))
    for bad, match in (
        (good._replace(a_x=np.zeros(2)), "stands"),
        (good._replace(deflection=np.full((1, 4), np.nan)), "deflection"),
        (good._replace(a_y=np.full(1, 9.0)), "a_y"),
    ):
        with pytest.raises(InputError, match=match):
            mass_at_rest(bad, CAR, SIGMA)
    with pytest.raises(InputError, match="deflection_sigma"):
        mass_at_rest(good, CAR, 0.0)
    with pytest.raises(InputError, match="method"):
        mass_at_rest(good, CAR, SIGMA, method="guess")
