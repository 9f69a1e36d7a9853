"""Simulated measurements of a swinging head: exact IMU means and image points, each with its modelled noise.

They go to the filter without any image, so that its covariance can be compared with its errors.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from snakeslam.calibration import CameraCalibration, ImuCalibration, SensorRig
from snakeslam.estimation.frontend.tracking import TrackedFeatures
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.start.stationary import SIGMA_BIAS_A
from snakeslam.estimation.vio.odometry import VisualInertialOdometry
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame, Float, ImuSample, Packet

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 640, 480, 380.0
IMU_NS, IMU_PER_FRAME = 5_000_000, 10
REST_S = 0.5
GRAVITY_W = np.array([0.0, 0.0, -9.81])
R_IC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
P_IC = np.array([0.03, 0.01, 0.0])
SIGMA_BIAS_G = 0.01
BOX_M = np.array([4.0, 3.0, 1.5])
POINTS = 1500
LOSS = 0.03
NOISE = NoiseSettings(imu_white_scale=1.0, imu_walk_scale=1.0, track_drift_px=0.0)
SETTINGS = EstimatorSettings(noise=NOISE)
RIG = SensorRig(
    cam0=CameraCalibration(
        T_cam_imu=tuple(tuple(row) for row in se3.inv(se3.from_rt(R_IC, P_IC)).tolist()),
        intrinsics=(FOCAL_PX, FOCAL_PX, (WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2),
        resolution=(WIDTH_PX, HEIGHT_PX),
        shutter="global",
    ),
    imu0=ImuCalibration(
        gyroscope_noise_density=2.4e-4,
        gyroscope_random_walk=2e-5,
        accelerometer_noise_density=1.5e-3,
        accelerometer_random_walk=3e-4,
        update_rate=200.0,
        sample_kind="mean",
    ),
)


@dataclass(frozen=True)
class SwingingHead:
    """One run: ``seed`` draws the motion's phases, the points, biases and noise."""

    seed: int = 0
    duration_s: float = 10.0
    tracks: int = 120
    depth: bool = True
    late_ns: int = 0
    """How much too late the frames are stamped."""

    def pose(self, t_s: Float) -> tuple[Float, Float]:
        """Return R_WI (N, 3, 3) and p_WI (N, 3): at rest, then crawling on while the head swings."""
        rng = np.random.default_rng([self.seed, 0])
        phase, rate = rng.uniform(0, 2 * np.pi, 6), rng.uniform(0.8, 1.2, 6)
        t = np.maximum(t_s - REST_S, 0.0)
        ease = t**3 / (t**3 + 0.3)

        def swing(k: int, rad_s: float) -> Float:
            return ease * np.sin(rate[k] * rad_s * t + phase[k])

        p = np.stack([0.08 * t * ease + 0.05 * swing(0, 2.5), 0.15 * swing(1, 2.0), 0.03 * swing(2, 4.0)], axis=-1)
        w = np.stack([0.1 * swing(3, 3.0), 0.08 * swing(4, 4.0), 0.5 * swing(5, 2.0)], axis=-1)
        return so3.exp(w), p

    def packets(self) -> Iterator[Packet]:
        """Yield IMU samples at 200 Hz and empty frames at 20 Hz, in the order of their stamps."""
        return iter(sorted(self._packets(), key=lambda packet: packet.t_ns))

    def _packets(self) -> Iterator[Packet]:
        rng = np.random.default_rng([self.seed, 1])
        count = round(self.duration_s * 1e9 / IMU_NS)
        gyro, accel = self._imu(count)
        bias_g, bias_a = rng.normal(0, SIGMA_BIAS_G, 3), rng.normal(0, SIGMA_BIAS_A, 3)
        imu = RIG.imu0
        assert imu is not None
        density, walk = np.sqrt(imu.update_rate), 1.0 / np.sqrt(imu.update_rate)
        blank = np.zeros((2, 2), np.uint8)
        for k in range(count + 1):
            if k:
                bias_g = bias_g + rng.normal(0, imu.gyroscope_random_walk * walk, 3)
                bias_a = bias_a + rng.normal(0, imu.accelerometer_random_walk * walk, 3)
                w = gyro[k - 1] + bias_g + rng.normal(0, imu.gyroscope_noise_density * density, 3)
                a = accel[k - 1] + bias_a + rng.normal(0, imu.accelerometer_noise_density * density, 3)
                yield ImuSample(k * IMU_NS, w, a)
            if k % IMU_PER_FRAME == 0:
                yield CameraFrame(k * IMU_NS + self.late_ns, k // IMU_PER_FRAME, blank)

    def _imu(self, count: int) -> tuple[Float, Float]:
        """Return mean rates and forces that integrate to the true motion, (count, 3) each."""
        dt, h = IMU_NS / 1e9, 1e-4
        t = np.arange(count + 1) * dt
        R, _ = self.pose(t)
        v = (self.pose(t + h)[1] - self.pose(t - h)[1]) / (2 * h)
        phi = so3.log(np.swapaxes(R[:-1], -1, -2) @ R[1:])
        force = (v[1:] - v[:-1]) / dt - GRAVITY_W
        middle = R[:-1] @ so3.exp(phi / 2)
        return phi / dt, np.einsum("nji,nj->ni", middle, force)


class Head(Protocol):
    """What is seen from: a motion, and how it is seen."""

    @property
    def seed(self) -> int:
        """What draws the room and the noise."""
        ...

    @property
    def tracks(self) -> int:
        """Points followed at most."""
        ...

    @property
    def depth(self) -> bool:
        """Whether their depth is measured."""
        ...

    def pose(self, t_s: Float) -> tuple[Float, Float]:
        """Return R_WI (N, 3, 3) and p_WI (N, 3)."""
        ...


class SimulatedFrontend:
    """Points on the walls of a box, tracked without any image."""

    def __init__(self, head: Head, noise: NoiseSettings, late_ns: int = 0, readout_s: float = 0.0) -> None:
        self._head, self._late_ns, self._readout_s = head, late_ns, readout_s
        self._noise = noise
        self._rng = np.random.default_rng([head.seed, 2])
        points = self._rng.uniform(-1, 1, (POINTS, 3)) * BOX_M
        wall = self._rng.integers(0, 3, POINTS)
        points[np.arange(POINTS), wall] = np.sign(points[np.arange(POINTS), wall]) * BOX_M[wall]
        self._points_W = points
        self._followed = np.empty(0, np.int64)
        self._ids = np.empty(0, np.int64)
        self._next = 0

    def process(self, frame: CameraFrame, T_C1C0: Float, doubted: bool = False) -> TrackedFeatures:
        """Return noisy observations of what is in view."""
        del T_C1C0, doubted
        t_s = (frame.t_ns - self._late_ns) / 1e9
        p_C, xy = self._seen_at(np.array([t_s]))
        if self._readout_s:
            p_C, xy = self._seen_at(t_s + self._readout_s * np.clip(xy[:, 1] * FOCAL_PX / HEIGHT_PX, -0.5, 0.5))
        half = np.array([WIDTH_PX, HEIGHT_PX]) / 2 / FOCAL_PX
        visible = (p_C[:, 2] > 0.3) & np.all(np.abs(xy) < half, axis=1)
        self._follow(visible)
        z = p_C[self._followed, 2]
        n = len(z)
        noise = self._noise
        xy = xy[self._followed] + self._rng.normal(0, noise.pixel_px / FOCAL_PX, (n, 2))
        depth = z + self._rng.normal(0, 1, n) * (noise.depth_offset_m + noise.depth_square_per_m * z**2)
        nothing = np.empty((0, 2), np.float32), np.empty(0, np.int64)
        px = (xy * FOCAL_PX + np.array([WIDTH_PX, HEIGHT_PX]) / 2).astype(np.float32)
        return TrackedFeatures(px, self._ids, xy, depth if self._head.depth else np.zeros(n), *nothing, 0.5, False, n)

    def _seen_at(self, t_s: Float) -> tuple[Float, Float]:
        """Return the points in the camera and their (x/z, y/z), each at its own time or all at one."""
        R_WI, p_WI = self._head.pose(t_s)
        p_I = np.einsum("nji,nj->ni", np.broadcast_to(R_WI, (POINTS, 3, 3)), self._points_W - p_WI)
        p_C = (p_I - P_IC) @ R_IC
        return p_C, p_C[:, :2] / np.maximum(p_C[:, 2:], 0.1)

    def drop(self, ids: np.ndarray) -> None:
        """Follow these no longer."""
        kept = ~np.isin(self._ids, ids)
        self._followed, self._ids = self._followed[kept], self._ids[kept]

    def _follow(self, visible: np.ndarray) -> None:
        kept = visible[self._followed] & (self._rng.uniform(size=len(self._followed)) > LOSS)
        self._followed, self._ids = self._followed[kept], self._ids[kept]
        free = visible.copy()
        free[self._followed] = False
        new = self._rng.permutation(np.flatnonzero(free))[: self._head.tracks - len(self._followed)]
        self._followed = np.concatenate([self._followed, new])
        self._ids = np.concatenate([self._ids, np.arange(self._next, self._next + len(new))])
        self._next += len(new)


@dataclass(frozen=True)
class ConsistencyRun:
    """Errors and NEES of one run, one row a frame after the first pose."""

    t_s: Float
    e_p: Float
    e_theta: Float
    nees_p: Float
    nees_theta: Float
    cov: Float


def run(head: SwingingHead, settings: EstimatorSettings = SETTINGS, rig: SensorRig = RIG) -> ConsistencyRun:
    """Return the errors of the filter in one run with the calibration ``rig``; the first pose defines W."""
    vio = VisualInertialOdometry(settings, rig, head.seed, SimulatedFrontend(head, settings.noise, head.late_ns))
    poses = [e.pose for e in map(vio.process, head.packets()) if e is not None and e.pose is not None]
    t_s = np.array([p.t_ns for p in poses]) / 1e9
    R_true, p_true = head.pose(t_s)
    T = np.array([p.T_WI for p in poses])
    turn = T[0, :3, :3] @ R_true[0].T
    R = so3.from_yaw(np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]))
    e_p = (p_true - p_true[0]) @ R.T + T[0, :3, 3] - T[:, :3, 3]
    e_theta = so3.log(np.swapaxes(T[:, :3, :3], -1, -2) @ R @ R_true)
    cov = np.array([p.cov for p in poses])
    nees = [
        np.einsum("ni,ni->n", e[1:], np.linalg.solve(P[1:], e[1:, :, None])[..., 0])
        for e, P in ((e_p, cov[:, 3:6, 3:6]), (e_theta, cov[:, :3, :3]))
    ]
    return ConsistencyRun(t_s[1:], e_p[1:], e_theta[1:], *nees, cov[1:])
