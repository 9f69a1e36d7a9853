"""What every backend keeps: order, truth, calibration, read-only packets."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from snakeslam.backends.base import Backend
from snakeslam.backends.replay.backend import ReplayBackend
from snakeslam.backends.sim.backend import SimBackend
from snakeslam.backends.sim.settings import SimSettings
from snakeslam.calibration import SensorRig
from snakeslam.messages import CameraFrame, GroundTruth, ImuSample, JointState, JointTarget, Packet
from snakeslam.recording.settings import ReplaySettings
from snakeslam.robot.model import PRESETS
from tests.small_recordings import write_euroc


def _simulator(folder):
    del folder
    return SimBackend(PRESETS["orthogonal24"], SimSettings(world="blank"), 2)


def _recording(folder):
    return ReplayBackend(write_euroc(folder / "recording"), ReplaySettings())


@dataclass
class Played:
    """A backend, the time before its first step, and of each step the packets, the truth and the time after it."""

    backend: Backend
    start_ns: int
    steps: list[tuple[Sequence[Packet], Sequence[GroundTruth], int]] = field(default_factory=list)

    def packets(self, kind=object):
        return [packet for packets, _, _ in self.steps for packet in packets if isinstance(packet, kind)]


@pytest.fixture(scope="module", params=[_simulator, _recording], ids=["simulator", "replay"])
def played(request, tmp_path_factory):
    backend = request.param(tmp_path_factory.mktemp("contract"))
    record = Played(backend, backend.t_ns)
    for _ in range(30):
        target = None if backend.model is None else JointTarget(backend.t_ns, backend.model.rest_q_rad)
        packets = backend.step(target)
        if packets is None:
            break
        record.steps.append((packets, backend.take_ground_truth(), backend.t_ns))
    yield record
    backend.close()
    # Closing twice is safe.
    backend.close()


def test_packets_are_in_time_order_and_not_from_the_future(played):
    assert played.steps
    last_ns = 0
    for packets, _, t_ns in played.steps:
        for packet in packets:
            assert isinstance(packet.t_ns, int)
            assert last_ns <= packet.t_ns <= t_ns
            last_ns = packet.t_ns
    assert played.steps[-1][2] > played.start_ns


def test_stamps_of_one_sensor_rise(played):
    for kind in (ImuSample, CameraFrame, JointState):
        assert np.all(np.diff([packet.t_ns for packet in played.packets(kind)]) > 0)
    assert np.all(np.diff([frame.seq for frame in played.packets(CameraFrame)]) == 1)


def test_truth_is_given_once_in_order_and_not_from_the_future(played):
    last_ns = -1
    for _, truth, t_ns in played.steps:
        for sample in truth:
            assert last_ns < sample.t_ns <= t_ns
            assert sample.T_WI.shape == (4, 4)
            last_ns = sample.t_ns
    assert last_ns > 0
    assert list(played.backend.take_ground_truth()) == []


def test_frames_fit_the_calibration(played):
    assert isinstance(played.backend.rig, SensorRig)
    width, height = played.backend.rig.cam0.resolution
    frames = played.packets(CameraFrame)
    assert frames
    for frame in frames:
        assert frame.gray.shape == (height, width)
        assert frame.depth_m is None or frame.depth_m.shape == (height, width)


def test_an_imu_has_its_calibration_and_feels_gravity(played):
    samples = played.packets(ImuSample)
    assert samples
    assert played.backend.rig.imu0 is not None
    for sample in samples:
        assert sample.gyro_I.shape == sample.accel_I.shape == (3,)
        assert 5.0 < np.linalg.norm(sample.accel_I) < 15.0


def test_joint_states_fit_the_model(played):
    states, model = played.packets(JointState), played.backend.model
    if model is None:
        assert states == []
        return
    assert states
    for state in states:
        for values in (state.q_rad, state.dq_rad_s, state.current_a, state.temperature_degc):
            assert values.shape == (model.joint_count,)
            assert np.all(np.isfinite(values))


def test_packets_cannot_be_written(played):
    for packet in played.packets():
        arrays = [getattr(packet, name) for name in packet.__slots__]
        assert not any(a.flags.writeable for a in arrays if isinstance(a, np.ndarray))
