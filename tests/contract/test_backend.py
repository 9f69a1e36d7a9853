"""What every backend promises, whatever is behind it (backends/base.py)."""

from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from snakeslam.backends.base import Backend
from snakeslam.calibration import SensorRig
from snakeslam.config import load_config
from snakeslam.messages import CameraFrame, GroundTruth, ImuSample, JointState, JointTarget, Packet
from snakeslam.runtime.assembly.build import build_backend, with_recording
from tests.small_recordings import write_euroc, write_tum

STEPS = 30
IMU_INTERVAL_NS = 5_000_000


def simulator(_: Path) -> Backend:
    return build_backend(load_config(None, ["sim.world=blank", "sim.camera.rate_hz=10"]))


def short_simulator(_: Path) -> Backend:
    return build_backend(load_config(None, ["robot.model=orthogonal24", "sim.world=blank", "run.seed=2"]))


def euroc(folder: Path) -> Backend:
    return build_backend(with_recording(load_config(), write_euroc(folder / "clip")))


def tum(folder: Path) -> Backend:
    return build_backend(with_recording(load_config(), write_tum(folder / "clip", imu=True)))


MAKERS: list[Callable[[Path], Backend]] = [simulator, short_simulator, euroc, tum]


class Played:
    """A backend and what it gave in up to STEPS steps."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        self.start_ns = backend.t_ns
        self.times_ns: list[int] = []
        self.packets: list[Packet] = []
        self.truth: list[GroundTruth] = []
        self.truth_ahead_ns = 0
        self.packets_ahead_ns = 0
        self.ended = False
        target = None
        if backend.model is not None:
            target = JointTarget(self.start_ns, backend.model.rest_q_rad)
        for _ in range(STEPS):
            step = backend.step(target)
            self.ended = step is None
            if step is None:
                break
            self.packets += step
            self.packets_ahead_ns = max([self.packets_ahead_ns, *(packet.t_ns - backend.t_ns for packet in step)])
            self.times_ns.append(backend.t_ns)
            self.truth += backend.read_ground_truth()
            if self.truth:
                self.truth_ahead_ns = max(self.truth_ahead_ns, self.truth[-1].t_ns - backend.t_ns)


@pytest.fixture(scope="module", params=MAKERS, ids=lambda make: make.__name__)
def played(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Played]:
    backend = request.param(tmp_path_factory.mktemp("clip"))
    yield Played(backend)
    backend.close()
    backend.close()


def test_packets_come_in_time_order_and_never_from_the_future(played: Played) -> None:
    stamps = [packet.t_ns for packet in played.packets]
    assert stamps == sorted(stamps)
    assert played.times_ns == sorted(played.times_ns)
    assert stamps[0] >= played.start_ns
    assert stamps[-1] <= played.backend.t_ns
    assert played.packets_ahead_ns <= 0
    assert played.times_ns[-1] > played.start_ns
    assert all(isinstance(stamp, int) for stamp in stamps)


def test_each_sensors_stamps_increase(played: Played) -> None:
    for kind in (ImuSample, CameraFrame, JointState):
        stamps = [packet.t_ns for packet in played.packets if isinstance(packet, kind)]
        assert all(b > a for a, b in pairwise(stamps)), kind
    sequence = [packet.seq for packet in played.packets if isinstance(packet, CameraFrame)]
    assert sequence == list(range(len(sequence)))


def test_frames_are_what_the_rig_says(played: Played) -> None:
    assert isinstance(played.backend.rig, SensorRig)
    cam0 = played.backend.rig.cam0
    width, height = cam0.resolution
    frames = [packet for packet in played.packets if isinstance(packet, CameraFrame)]
    assert len(frames) >= 2
    for frame in frames:
        assert (frame.gray.shape, frame.gray.dtype) == ((height, width), np.uint8)
        assert (frame.depth_m is None) == (frames[0].depth_m is None), "a camera has depth or has not"
        if frame.rgb is not None:
            assert frame.rgb.shape == (height, width, 3)
        if frame.depth_m is not None:
            assert (frame.depth_m.shape, frame.depth_m.dtype) == ((height, width), np.float32)
            assert np.all(np.isfinite(frame.depth_m))
            assert np.all(frame.depth_m >= 0.0)


def test_an_imu_feels_gravity(played: Played) -> None:
    samples = [packet for packet in played.packets if isinstance(packet, ImuSample)]
    assert samples
    for sample in samples:
        assert sample.gyro_I.shape == sample.accel_I.shape == (3,)
        assert 5.0 < np.linalg.norm(sample.accel_I) < 15.0


def test_imu_samples_are_finite_and_fill_the_time_between_frames(played: Played) -> None:
    samples = [packet for packet in played.packets if isinstance(packet, ImuSample)]
    assert played.backend.rig.imu0 is not None
    assert np.all(np.isfinite([np.r_[sample.gyro_I, sample.accel_I] for sample in samples]))
    assert np.all(np.diff([sample.t_ns for sample in samples]) == IMU_INTERVAL_NS)


def test_truth_is_that_of_the_past_and_increases(played: Played) -> None:
    stamps = [sample.t_ns for sample in played.truth]
    assert len(stamps) >= 2
    assert all(b > a for a, b in pairwise(stamps))
    assert played.truth_ahead_ns <= 0
    assert list(played.backend.read_ground_truth()) == [], "truth is given once"
    R = np.array([sample.T_WI[:3, :3] for sample in played.truth])
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-9)


def test_joint_states_belong_to_the_robot(played: Played) -> None:
    states = [packet for packet in played.packets if isinstance(packet, JointState)]
    model = played.backend.model
    assert bool(states) == (model is not None)
    for state in states:
        assert model is not None
        for values in (state.q_rad, state.dq_rad_s, state.current_a, state.temperature_degc):
            assert values.shape == (model.joint_count,)
            assert np.all(np.isfinite(values))


def test_a_recording_ends_and_stays_ended(tmp_path: Path) -> None:
    backend = euroc(tmp_path)
    while backend.step(None) is not None:
        pass
    backend.read_ground_truth()
    assert backend.step(None) is None
    assert backend.read_ground_truth() == []


def test_messages_cannot_be_written_to(played: Played) -> None:
    for packet in played.packets:
        arrays = [getattr(packet, name) for name in packet.__slots__]
        arrays = [array for array in arrays if isinstance(array, np.ndarray)]
        assert arrays
        assert not any(array.flags.writeable for array in arrays)
