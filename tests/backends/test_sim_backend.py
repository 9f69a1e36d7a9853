"""The simulator as a whole: clocks, order, truth, calibration and determinism."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest

from snakeslam.backends.sim.backend import SimBackend
from snakeslam.backends.sim.settings import CameraSettings, PhysicsSettings, SimSettings
from snakeslam.config import load_config
from snakeslam.errors import InputError
from snakeslam.geometry import se3
from snakeslam.messages import CameraFrame, ImuSample, JointState, JointTarget
from snakeslam.robot.model import PRESETS

MODEL = PRESETS["sim35"]
IMU_NS = 5_000_000
HASH_SCRIPT = f"from {__name__.rpartition('.')[2]} import fingerprint; print(fingerprint())"


def crawl(backend, seconds):
    """Packets and truth of a travelling wave in the yaw joints."""
    packets, truth = [], []
    n = np.arange(MODEL.joint_count)
    for _ in range(round(seconds * 100)):
        wave = np.where(MODEL.is_yaw, 0.3, 0.0) * np.sin(2 * np.pi * (backend.t_ns * 1e-9 / 2 - n / 16))
        wave[-4:] = 0.0
        wave *= np.clip(backend.t_ns * 1e-9 - 0.1, 0.0, 1.0) ** 2
        packets += backend.step(JointTarget(backend.t_ns, MODEL.rest_q_rad + wave))
        truth += backend.read_ground_truth()
    return packets, truth


def fingerprint(seed=3):
    """Hash of everything that one second yields."""
    backend = SimBackend(MODEL, SimSettings(), seed)
    digest = hashlib.sha256()
    for packet in crawl(backend, 1.0)[0]:
        digest.update(repr((type(packet).__name__, packet.t_ns)).encode())
        for name in ("gyro_I", "accel_I", "gray", "rgb", "depth_m", "q_rad", "dq_rad_s", "current_a"):
            digest.update(np.ascontiguousarray(getattr(packet, name, ())).tobytes())
    backend.close()
    return digest.hexdigest()


@pytest.fixture(scope="module")
def second():
    backend = SimBackend(MODEL, SimSettings(), 1)
    packets, truth = crawl(backend, 2.0)
    yield backend, packets, truth
    backend.close()


def test_packets_come_in_time_order_at_their_rates(second):
    _, packets, _ = second
    times = [packet.t_ns for packet in packets]
    assert times == sorted(times)
    stamps = {kind: [p.t_ns for p in packets if isinstance(p, kind)] for kind in (ImuSample, JointState, CameraFrame)}
    assert stamps[ImuSample] == [IMU_NS * k for k in range(1, 401)]
    assert stamps[JointState] == [2 * IMU_NS * k for k in range(1, 201)]
    assert np.all(np.diff(stamps[CameraFrame]) == 50_000_000)
    assert len(stamps[CameraFrame]) == 40
    assert set(stamps[CameraFrame]) <= set(stamps[ImuSample])
    assert [p.seq for p in packets if isinstance(p, CameraFrame)] == list(range(40))


def test_truth_is_on_its_own_channel_at_the_imu_stamps(second):
    backend, packets, truth = second
    assert [t.t_ns for t in truth] == [p.t_ns for p in packets if isinstance(p, ImuSample)]
    assert list(backend.read_ground_truth()) == []
    np.testing.assert_allclose(truth[0].T_WI[:3, 3], [0, 0, 0.09], atol=0.02)
    np.testing.assert_allclose(truth[0].T_WI[:3, :3], np.eye(3), atol=0.05)


def test_the_first_samples_are_those_of_a_robot_at_rest(second):
    _, packets, truth = second
    still = [p for p in packets if isinstance(p, ImuSample)][:10]
    bias = truth[0].accel_bias_I
    np.testing.assert_allclose(np.mean([s.accel_I for s in still], axis=0) - bias, [0, 0, 9.81], atol=0.3)
    assert all(np.linalg.norm(t.v_W) < 0.01 for t in truth[:10])


def test_the_calibration_and_the_truth_explain_the_depth_pictures(second):
    """Points of one frame, carried over by T_WI, T_CI and the intrinsics, lie at the depth that a later frame sees."""
    backend, packets, truth = second
    poses = {t.t_ns: t.T_WI for t in truth}
    first, later = (f for f in [p for p in packets if isinstance(p, CameraFrame)][10::29])
    cam0 = backend.rig.cam0
    fx, fy, cx, cy = cam0.intrinsics
    T_21 = cam0.T_CI @ se3.inv(poses[later.t_ns]) @ poses[first.t_ns] @ cam0.T_IC
    assert np.linalg.norm(se3.log(T_21)) > 0.01
    v, u = np.nonzero((first.depth_m > 0) & (first.depth_m < 3.0))
    z = first.depth_m[v, u].astype(float)
    p_2 = se3.act(T_21, np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=1))
    u_2, v_2 = (
        np.rint(fx * p_2[:, 0] / p_2[:, 2] + cx).astype(int),
        np.rint(fy * p_2[:, 1] / p_2[:, 2] + cy).astype(int),
    )
    inside = (u_2 >= 0) & (u_2 < 640) & (v_2 >= 0) & (v_2 < 480)
    seen = later.depth_m[v_2[inside], u_2[inside]]
    error_m = (seen - p_2[inside, 2])[seen > 0]
    assert len(error_m) > 10_000
    assert abs(np.median(error_m)) < 0.002
    assert np.median(np.abs(error_m)) < 0.01


def test_the_joints_follow_and_are_reported_in_encoder_steps(second):
    _, packets, _ = second
    states = [p for p in packets if isinstance(p, JointState)]
    q_rad = np.array([s.q_rad for s in states])
    assert np.ptp(q_rad[100:], axis=0)[MODEL.is_yaw][:-3].min() > 0.3
    steps = q_rad / (2 * np.pi / 4096)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert np.all(states[-1].temperature_degc == 30.0)


def test_the_same_seed_gives_the_same_bytes_in_fresh_processes():
    """Two processes side by side, and a hash of every packet of one second."""
    folder = __file__.rpartition("/")[0]
    runs = [
        subprocess.Popen([sys.executable, "-c", HASH_SCRIPT], cwd=folder, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    hashes = [run.communicate(timeout=300)[0].strip().splitlines()[-1] for run in runs]
    assert [run.returncode for run in runs] == [0, 0]
    assert hashes[0] == hashes[1]
    assert len(hashes[0]) == 64


def test_another_seed_gives_other_noise_and_another_world():
    frames = []
    for seed in (1, 2):
        backend = SimBackend(MODEL, SimSettings(world="blank"), seed)
        frames.append([p for p in backend.step(None) if not isinstance(p, JointState)])
        backend.close()
    assert not np.array_equal(frames[0][0].gyro_I, frames[1][0].gyro_I)
    assert not np.array_equal(frames[0][1].gray, frames[1][1].gray)


@pytest.mark.parametrize("rate", [3, 30, 60, 0])
def test_a_camera_rate_that_does_not_divide_the_imus_is_refused(rate):
    with pytest.raises(
        InputError, match=rf"sim\.camera\.rate_hz: {rate} is not possible \(allowed: 1, 2, 4, 5, 8, 10, "
    ):
        load_config(None, [f"sim.camera.rate_hz={rate}"])


@pytest.mark.parametrize("rate", [40, 100])
def test_faster_cameras_keep_the_order(rate):
    backend = SimBackend(MODEL, SimSettings(world="blank", camera=CameraSettings(rate_hz=rate)), 1)
    packets = [packet for _ in range(10) for packet in backend.step(None)]
    backend.close()
    times = [packet.t_ns for packet in packets]
    assert times == sorted(times)
    stamps = [p.t_ns for p in packets if isinstance(p, CameraFrame)]
    assert np.all(np.diff(stamps) == 1_000_000_000 // rate)
    assert len(stamps) == rate // 10


def test_a_physics_rate_that_does_not_fit_is_refused():
    with pytest.raises(InputError, match=r"sim\.physics\.rate_hz: 480 .*multiples of 400"):
        SimBackend(MODEL, SimSettings(physics=PhysicsSettings(rate_hz=480)), 1)
