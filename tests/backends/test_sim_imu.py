"""The simulated IMU: means that integrate to the true motion, densities, walks and saturation."""

import numpy as np
import pytest

from snakeslam.backends.sim.backend import SimBackend
from snakeslam.backends.sim.imu import GRAVITY_W, Imu, imu_calibration, interval_means
from snakeslam.backends.sim.settings import CameraSettings, ImuSettings, SimSettings
from snakeslam.geometry import so3
from snakeslam.messages import ImuSample, JointTarget
from snakeslam.robot.model import PRESETS

TINY = 1e-12
PERFECT = ImuSettings(
    gyro_noise_density=TINY,
    gyro_random_walk=TINY,
    accel_noise_density=TINY,
    accel_random_walk=TINY,
    gyro_initial_bias_rad_s=0,
    accel_initial_bias_m_s2=0,
)
DT_S = 0.005


def test_means_give_back_the_rotation_and_the_velocity_exactly():
    rng = np.random.default_rng(2)
    for _ in range(20):
        R0 = so3.exp(rng.normal(size=3))
        R1 = R0 @ so3.exp(rng.normal(size=3) * 0.1)
        v0_W, v1_W = rng.normal(size=(2, 3))
        gyro_I, accel_I = interval_means(R0, v0_W, R1, v1_W, DT_S)
        np.testing.assert_allclose(R0 @ so3.exp(gyro_I * DT_S), R1, atol=1e-12)
        dv_W = R0 @ so3.right_jacobian(-gyro_I * DT_S) @ accel_I * DT_S + GRAVITY_W * DT_S
        np.testing.assert_allclose(v0_W + dv_W, v1_W, atol=1e-12)


def test_at_rest_it_feels_one_g_upwards():
    gyro_I, accel_I = interval_means(np.eye(3), np.zeros(3), np.eye(3), np.zeros(3), DT_S)
    np.testing.assert_allclose(gyro_I, 0.0, atol=1e-15)
    np.testing.assert_allclose(accel_I, [0, 0, 9.81], atol=1e-12)


def test_ten_seconds_of_crawling_integrate_to_the_true_pose():
    """A travelling wave in the yaw and pitch joints; the mid-point rule, as an estimator would integrate."""
    model = PRESETS["sim35"]
    settings = SimSettings(world="blank", imu=PERFECT, camera=CameraSettings(rate_hz=1))
    backend, samples, truth = SimBackend(model, settings, 1), [], []
    n = np.arange(model.joint_count)
    for _ in range(1000):
        t_s = backend.t_ns * 1e-9
        ramp = min(1.0, t_s / 2.0)
        wave = np.where(model.is_yaw, 0.35, 0.05) * np.sin(2 * np.pi * (t_s / 2.0 - n / 16.0))
        wave[-6:] = 0.0
        target = JointTarget(backend.t_ns, model.rest_q_rad + ramp * wave)
        samples += [packet for packet in backend.step(target) if isinstance(packet, ImuSample)]
        truth += backend.read_ground_truth()
    backend.close()
    R, p, v = truth[0].T_WI[:3, :3], truth[0].T_WI[:3, 3], truth[0].v_W
    for sample in samples[1:]:
        dv = R @ so3.exp(sample.gyro_I * DT_S / 2) @ sample.accel_I * DT_S + GRAVITY_W * DT_S
        p, v, R = p + v * DT_S + dv * DT_S / 2, v + dv, R @ so3.exp(sample.gyro_I * DT_S)
    way_m = np.sum(np.linalg.norm(np.diff([t.T_WI[:3, 3] for t in truth], axis=0), axis=1))
    assert way_m > 1.0
    assert np.linalg.norm(p - truth[-1].T_WI[:3, 3]) < 3e-3
    assert np.linalg.norm(v - truth[-1].v_W) < 1e-3
    assert np.linalg.norm(so3.log(R.T @ truth[-1].T_WI[:3, :3])) < 1e-6


def _measure(settings, count, gyro_I=(0, 0, 0), accel_I=(0, 0, 0), seed=3):
    imu = Imu.switched_on(settings, np.random.default_rng(seed))
    samples = [imu.measure(k, np.array(gyro_I, float), np.array(accel_I, float)) for k in range(count)]
    return imu, np.array([s.gyro_I for s in samples]), np.array([s.accel_I for s in samples])


def test_white_noise_has_the_density_of_the_calibration():
    settings = PERFECT.model_copy(update={"gyro_noise_density": 3e-4, "accel_noise_density": 2e-3})
    _, gyro_I, accel_I = _measure(settings, 20_000)
    calibration = imu_calibration(settings)
    assert gyro_I.std() == pytest.approx(calibration.gyroscope_noise_density * np.sqrt(200), rel=0.02)
    assert accel_I.std() == pytest.approx(calibration.accelerometer_noise_density * np.sqrt(200), rel=0.02)


def test_biases_start_off_zero_and_walk_with_their_density():
    settings = PERFECT.model_copy(
        update={"gyro_random_walk": 1e-3, "accel_random_walk": 1e-2, "accel_initial_bias_m_s2": 0.3}
    )
    ends = [_measure(settings, 200, seed=k) for k in range(120)]
    walked = np.array([gyro_I[-1] - gyro_I[0] for _, gyro_I, _ in ends])
    assert walked.std() == pytest.approx(1e-3 * np.sqrt(199 / 200), rel=0.12)
    assert np.array([accel_I[0] for _, _, accel_I in ends]).std() == pytest.approx(0.3, rel=0.12)


def test_it_saturates():
    _, gyro_I, accel_I = _measure(ImuSettings(), 10, gyro_I=(99, -99, 0), accel_I=(-500, 0, 500))
    assert np.all(gyro_I[:, 0] == 34.9)
    assert np.all(gyro_I[:, 1] == -34.9)
    assert np.all(accel_I[:, [0, 2]] == [-78.5, 78.5])
