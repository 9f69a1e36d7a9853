"""What every backend keeps: order, truth, calibration, read-only packets."""

import numpy as np
import pytest

from snakeslam.backends.replay.backend import ReplayBackend
from snakeslam.backends.sim.backend import SimBackend
from snakeslam.backends.sim.settings import SimSettings
from snakeslam.calibration import SensorRig
from snakeslam.messages import CameraFrame, ImuSample, JointState, JointTarget
from snakeslam.recording.settings import ReplaySettings
from snakeslam.robot.model import PRESETS
from tests.small_recordings import write_euroc


def _simulator(folder):
    del folder
    return SimBackend(PRESETS["orthogonal24"], SimSettings(world="blank"), 2)


def _recording(folder):
    return ReplayBackend(write_euroc(folder / "recording"), ReplaySettings())


@pytest.fixture(params=[_simulator, _recording], ids=["simulator", "replay"])
def backend(request, tmp_path):
    made = request.param(tmp_path)
    yield made
    made.close()


def _played(backend, steps=30):
    """Packets and truth of each step, with the time after it."""
    played = []
    for _ in range(steps):
        target = None if backend.model is None else JointTarget(backend.t_ns, backend.model.rest_q_rad)
        packets = backend.step(target)
        if packets is None:
            break
        played.append((packets, backend.take_ground_truth(), backend.t_ns))
    return played


def test_packets_are_in_time_order_and_not_from_the_future(backend):
    start_ns, last_ns = backend.t_ns, 0
    played = _played(backend)
    assert played
    for packets, _, t_ns in played:
        for packet in packets:
            assert isinstance(packet.t_ns, int)
            assert last_ns <= packet.t_ns <= t_ns
            last_ns = packet.t_ns
    assert played[-1][2] > start_ns


def test_stamps_of_one_sensor_rise(backend):
    packets = [packet for step in _played(backend) for packet in step[0]]
    for kind in (ImuSample, CameraFrame, JointState):
        assert np.all(np.diff([p.t_ns for p in packets if isinstance(p, kind)]) > 0)
    assert np.all(np.diff([p.seq for p in packets if isinstance(p, CameraFrame)]) == 1)


def test_truth_is_given_once_in_order_and_not_from_the_future(backend):
    last_ns = -1
    for _, truth, t_ns in _played(backend):
        for sample in truth:
            assert last_ns < sample.t_ns <= t_ns
            assert sample.T_WI.shape == (4, 4)
            last_ns = sample.t_ns
    assert last_ns > 0


def test_frames_fit_the_calibration(backend):
    assert isinstance(backend.rig, SensorRig)
    width, height = backend.rig.cam0.resolution
    frames = [p for step in _played(backend) for p in step[0] if isinstance(p, CameraFrame)]
    assert frames
    for frame in frames:
        assert frame.gray.shape == (height, width)
        assert frame.depth_m is None or frame.depth_m.shape == (height, width)


def test_an_imu_has_its_calibration_and_feels_gravity(backend):
    samples = [p for step in _played(backend) for p in step[0] if isinstance(p, ImuSample)]
    assert samples
    assert backend.rig.imu0 is not None
    for sample in samples:
        assert sample.gyro_I.shape == sample.accel_I.shape == (3,)
        assert 5.0 < np.linalg.norm(sample.accel_I) < 15.0


def test_joint_states_fit_the_model(backend):
    states = [p for step in _played(backend) for p in step[0] if isinstance(p, JointState)]
    if backend.model is None:
        assert states == []
        return
    assert states
    for state in states:
        for values in (state.q_rad, state.dq_rad_s, state.current_a, state.temperature_degc):
            assert values.shape == (backend.model.joint_count,)
            assert np.all(np.isfinite(values))


def test_packets_cannot_be_written(backend):
    for packets, _, _ in _played(backend, 8):
        for packet in packets:
            arrays = [getattr(packet, name) for name in packet.__slots__]
            assert not any(a.flags.writeable for a in arrays if isinstance(a, np.ndarray))


def test_closing_twice_is_safe(backend):
    backend.close()
    backend.close()
