"""A textured wall two metres ahead, seen by a hand-held RGB-D camera with an IMU: packets with known truth."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import CameraCalibration, ImuCalibration, SensorRig
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame, ImuSample, Packet

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 320, 240, 200.0
WALL_X_M = 2.0
TEXEL_M = 0.01
IMU_NS = 5_000_000
IMU_PER_FRAME = 10
REST_S = 0.5
R_IC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
GRAVITY_W = np.array([0.0, 0.0, -9.81])
K = np.array([[FOCAL_PX, 0.0, (WIDTH_PX - 1) / 2], [0.0, FOCAL_PX, (HEIGHT_PX - 1) / 2], [0.0, 0.0, 1.0]])
RIG = SensorRig(
    cam0=CameraCalibration(
        T_cam_imu=tuple(tuple(row) for row in se3.inv(se3.from_rt(R_IC, np.zeros(3))).tolist()),
        intrinsics=(FOCAL_PX, FOCAL_PX, K[0, 2], K[1, 2]),
        resolution=(WIDTH_PX, HEIGHT_PX),
    ),
    imu0=ImuCalibration(
        gyroscope_noise_density=2e-4,
        gyroscope_random_walk=2e-5,
        accelerometer_noise_density=2e-3,
        accelerometer_random_walk=3e-4,
        update_rate=200.0,
        sample_kind="mean",
    ),
)


@dataclass(frozen=True)
class Wall:
    """Packets of one run; ``seed`` draws texture and noise."""

    seed: int = 0
    depth: bool = True
    stationary: bool = False
    tremor_m: float = 0.0
    """Amplitude of a hand's tremor at 3 Hz."""
    start_s: float = 0.0
    bias_g: tuple[float, float, float] = (0.01, -0.02, 0.015)
    bias_a: tuple[float, float, float] = (0.05, -0.03, 0.02)

    def pose(self, t_s: float) -> NDArray[np.float64]:
        """Return T_WI: stationary, then swaying and rotating smoothly."""
        t = 0.0 if self.stationary else max(0.0, t_s + self.start_s - REST_S)
        ease = t**3 / (t**3 + 0.1)
        p = ease * np.array([0.1 * np.sin(1.7 * t), 0.25 * np.sin(1.3 * t), 0.1 * np.sin(2.1 * t)])
        w = ease * np.array([0.1 * np.sin(1.1 * t), 0.08 * np.sin(1.9 * t), 0.15 * np.sin(0.9 * t)])
        p = p + self.tremor_m * np.sin(6.0 * np.pi * t_s + np.array([0.0, 1.0, 2.0]))
        return se3.from_rt(so3.exp(w), p)

    def packets(self, duration_s: float) -> Iterator[Packet]:
        """Yield IMU samples at 200 Hz and frames at 20 Hz."""
        rng = np.random.default_rng([self.seed, 1])
        texture = self._texture()
        for k in range(round(duration_s * 1e9 / IMU_NS) + 1):
            if k:
                yield self._imu(k, rng)
            if k % IMU_PER_FRAME == 0:
                yield self._frame(k, texture, rng)

    def _texture(self) -> NDArray[np.uint8]:
        noise = np.random.default_rng([self.seed, 0]).normal(0, 1, (800, 800)).astype(np.float32)
        smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
        return np.clip(128 + 60 * smooth / smooth.std(), 0, 255).astype(np.uint8)

    def _imu(self, k: int, rng: np.random.Generator) -> ImuSample:
        dt = IMU_NS / 1e9
        t0, t1 = (k - 1) * dt, k * dt
        R0, R1 = self.pose(t0)[:3, :3], self.pose(t1)[:3, :3]
        p = [self.pose(t)[:3, 3] for t in (t0 - dt / 2, t0 + dt / 2, t1 + dt / 2)]
        gyro = so3.log(R0.T @ R1) / dt
        accel = (R0 @ so3.exp(gyro * dt / 2)).T @ ((p[2] - 2 * p[1] + p[0]) / dt**2 - GRAVITY_W)
        white = 1.0 / np.sqrt(dt)
        return ImuSample(
            k * IMU_NS,
            gyro + self.bias_g + rng.normal(0, 2e-4 * white, 3),
            accel + self.bias_a + rng.normal(0, 2e-3 * white, 3),
        )

    def _frame(self, k: int, texture: NDArray[np.uint8], rng: np.random.Generator) -> CameraFrame:
        T_WC = self.pose(k * IMU_NS / 1e9) @ RIG.cam0.T_IC
        # A texel (c, r) is the point (2, 4 - c s, 4 - r s) of W.
        T_Ct = np.array([[0.0, 0.0, WALL_X_M], [-TEXEL_M, 0.0, 4.0], [0.0, -TEXEL_M, 4.0]])
        T_Ct[:, 2] -= T_WC[:3, 3]
        H = K @ T_WC[:3, :3].T @ T_Ct
        image = cv2.warpPerspective(texture, H, (WIDTH_PX, HEIGHT_PX), borderMode=cv2.BORDER_REFLECT).astype(float)
        gray = np.clip(image + rng.normal(0, 1.0, image.shape), 0, 255).astype(np.uint8)
        return CameraFrame(k * IMU_NS, k // IMU_PER_FRAME, gray, None, self._depth(T_WC, rng) if self.depth else None)

    def _depth(self, T_WC: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float32]:
        u, v = np.meshgrid(np.arange(WIDTH_PX), np.arange(HEIGHT_PX))
        rays_C = np.stack([(u - K[0, 2]) / FOCAL_PX, (v - K[1, 2]) / FOCAL_PX, np.ones(u.shape)], axis=-1)
        depth = (WALL_X_M - T_WC[0, 3]) / (rays_C @ T_WC[0, :3])
        return (depth + rng.normal(0, 0.002 + 0.002 * depth**2)).astype(np.float32)
