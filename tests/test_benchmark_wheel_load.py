"""The peers of the wheel-load benchmark find what our estimators find."""

import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks import wheel_load
from benchmarks.peers import load_filterpy, load_numpy
from wheelhop.estimators.joint_load_model import joint_load_filter, joint_load_prior
from wheelhop.estimators.joint_load_params import JointLoadTuning, joint_load_params
from wheelhop.estimators.unbiased_load import unbiased, unbiased_params
from wheelhop.estimators.wheel_load import LoadSample
from wheelhop.estimators.youla_load import unknown_before, youla, youla_params
from wheelhop.filtering import run_batch
from wheelhop.filtering.drive import run
from wheelhop.vehicle.full_vehicle_parameters import as_arrays, suv
from wheelhop.vehicle.load_record import VehicleLoadSample


def loads(observer, params):
    ys = LoadSample(*(jnp.asarray(a[0]) for a in wheel_load.record(1, 400)))
    start = observer.filter.init(unknown_before(), params)
    return np.asarray(run(observer.filter, start, ys, params, keep=wheel_load.normal_load))


def test_scipy_finds_what_the_youla_observer_finds():
    corner = wheel_load.corner()
    params = youla_params(corner, wheel_load.DT, wheel_load.BANDWIDTH)
    peer = load_numpy.youla(params, wheel_load.BANDWIDTH, wheel_load.RELATIVE_LAG)
    found = peer(*(a for a in wheel_load.record(1, 400)))[0]
    np.testing.assert_allclose(found, loads(youla(), params), atol=1e-4)


def test_the_numpy_loop_finds_what_the_unbiased_filter_finds():
    params = unbiased_params(wheel_load.corner(), wheel_load.DT, wheel_load.BANDWIDTH)
    found = load_numpy.unbiased(params)(*(a[0] for a in wheel_load.record(1, 400)))
    # the two begin with different doubts
    np.testing.assert_allclose(found[50:], loads(unbiased(), params)[50:], atol=1e-4)


@pytest.mark.slow
def test_filterpy_finds_what_the_joint_filter_finds():
    pytest.importorskip("filterpy", reason="filterpy comes with the bench extra")
    tuning = JointLoadTuning()
    ys = wheel_load.vehicle_record(30)
    peer = load_filterpy.joint(suv(), wheel_load.DT, wheel_load.WALK, tuning)
    params = joint_load_params(as_arrays(suv()), wheel_load.DT, tuning, wheel_load.WALK)
    filter = joint_load_filter()
    sample = VehicleLoadSample(*(jnp.asarray(column) for column in ys.T))

    def keep(state, info):
        del info
        return state.mean[8:12]

    start = filter.init(joint_load_prior(params), params)
    sample = VehicleLoadSample(*(entry[None] for entry in sample))
    found = run_batch(filter, start, sample, params, keep=keep)
    np.testing.assert_allclose(peer(ys), np.stack([a[0] for a in found], 1), rtol=1e-6)
