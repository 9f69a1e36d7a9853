"""The zero-velocity update, and the detector of a stationary head on which it rests: both image and IMU must agree."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import DirectMeasurement
from snakeslam.estimation.filter.state import THETA, P, State, V
from snakeslam.estimation.frontend.tracking import TrackedFeatures
from snakeslam.geometry import so3
from snakeslam.geometry.median import median
from snakeslam.messages import Float, ImuSample

STATIONARY_NS = 300_000_000
"""Time for which image and IMU must be stationary before the first update."""
STATIONARY_PX = 2.0
"""Largest median motion of the features since the reference image, in px."""

MIN_COMMON = 10
"""With fewer features in common the image says nothing about its motion."""
GYRO_STD_RAD_S, ACCEL_STD_M_S2 = 0.02, 0.15
"""Largest standard deviation of the samples of a stationary IMU, beyond twice its white noise."""
GYRO_MEAN_RAD_S = 0.02
"""Largest mean rate of a stationary IMU, without the bias."""
TREMOR_PX, TREMOR_GYRO_MEAN_RAD_S = 3.0, 0.05
"""The same limits with a tremor, since a stationary start and while the image stays where it was then."""
TREMOR_GYRO_STD, TREMOR_ACCEL_STD = 0.15, 2.0
"""Largest standard deviation of rate, rad/s, and specific force, m/s^2, in a tremor or with vibrating motors."""
TREMOR_V_S = 0.05
"""Velocity of a tremor over its acceleration, in s: 1 / (2 pi f) at f = 3 Hz."""
DISTANCE_M = 3.0
"""Assumed distance of the scene, which converts a motion in the image into one in space."""
SIGMA_V_M_S, SIGMA_P_M, SIGMA_THETA_RAD = 0.005, 0.001, 0.001
"""Sigmas of the update for an image that does not move at all; the motion of the image adds to them."""


@dataclass(frozen=True, slots=True)
class StationaryPeriod:
    """Stationary since ``since_ns``, for ``age_s``; the image moved by ``moved_rad`` (median angle of its features).

    ``since_start``: stationary since the filter's start, with a tremor of ``tremor_m_s2`` (standard deviation of the
    specific force beyond the IMU's noise).
    """

    since_ns: int
    age_s: float
    moved_rad: float
    since_start: bool = False
    tremor_m_s2: float = 0.0


@dataclass(frozen=True, slots=True)
class _Limits:
    gyro_std: float
    accel_std: float
    gyro_mean: float
    moved_rad: float


class StationaryDetector:
    """Detects that IMU and image have been stationary together for REST_NS."""

    def __init__(self, noise: ImuCalibration, focal_px: float) -> None:
        gyro = 2.0 * noise.gyroscope_noise_density * np.sqrt(noise.update_rate)
        self._white_accel = noise.accelerometer_noise_density * np.sqrt(noise.update_rate)
        accel = 2.0 * self._white_accel
        self._limits = _Limits(GYRO_STD_RAD_S + gyro, ACCEL_STD_M_S2 + accel, GYRO_MEAN_RAD_S, STATIONARY_PX / focal_px)
        self._tremor_limits = _Limits(
            TREMOR_GYRO_STD + gyro, TREMOR_ACCEL_STD + accel, TREMOR_GYRO_MEAN_RAD_S, TREMOR_PX / focal_px
        )
        self._reference: tuple[int, TrackedFeatures] | None = None
        self._since_start = False
        self.tremor_m_s2 = 0.0
        """Standard deviation of the specific force beyond the IMU's noise while a tremor is allowed; else 0."""

    def begin(self, t_ns: int, frame: TrackedFeatures) -> None:
        """Begin a stationary time that the start of the filter has detected.

        Without depth it lasts through a tremor, since no parallax shows the filter that the camera stays where it is;
        with depth the features do.
        """
        self._reference = (t_ns - STATIONARY_NS, frame)
        self._since_start = not np.any(frame.depth_m > 0.0)

    def update(
        self, t_ns: int, frame: TrackedFeatures, samples: Sequence[ImuSample], bias_g: Float
    ) -> StationaryPeriod | None:
        """Return the stationary time that lasts until ``t_ns``, or None; ``samples`` are those of the last 0.3 s."""
        # 1. The IMU: standard deviations and mean rate below their limits, else the stationary time has ended.
        limits = self._tremor_limits if self._since_start else self._limits
        self.tremor_m_s2 = 0.0
        spread = self._imu_spread(samples, bias_g, limits)
        if spread is None:
            self._reference, self._since_start = None, False
            return None
        if self._reference is None:
            self._reference = (t_ns, frame)
            return None

        # 2. The image: median motion of the features since the reference image.
        since_ns, reference = self._reference
        _, now, then = np.intersect1d(frame.ids, reference.ids, assume_unique=True, return_indices=True)
        moved = np.linalg.norm(frame.xy[now] - reference.xy[then], axis=1)
        self.tremor_m_s2 = np.sqrt(max(0.0, spread**2 - self._white_accel**2)) if self._since_start else 0.0
        enough = len(moved) >= MIN_COMMON
        moved_rad = median(moved) if enough else np.inf
        if moved_rad > limits.moved_rad:
            # Where too few features are left for a comparison, this image is the next reference, tremor or not.
            self._reference, self._since_start = (t_ns, frame), self._since_start and not enough
            return None
        if t_ns - since_ns < STATIONARY_NS:
            return None
        return StationaryPeriod(since_ns, (t_ns - since_ns) / 1e9, moved_rad, self._since_start, self.tremor_m_s2)

    @staticmethod
    def _imu_spread(samples: Sequence[ImuSample], bias_g: Float, limits: _Limits) -> float | None:
        """Return the standard deviation of the specific force; None if the IMU is not stationary."""
        if len(samples) < 2:
            return None
        gyro = np.array([s.gyro_I for s in samples])
        accel = np.array([s.accel_I for s in samples])
        spread = accel.std(axis=0)
        stationary = (
            np.all(gyro.std(axis=0) < limits.gyro_std)
            and np.all(spread < limits.accel_std)
            and np.linalg.norm(gyro.mean(axis=0) - bias_g) < limits.gyro_mean
        )
        return float(np.sqrt(np.mean(spread**2))) if stationary else None


@dataclass(slots=True)
class ZeroVelocity(DirectMeasurement):
    """Rows v_W = 0, p = p' and Log(R'^T R) = 0 between the newest clone and an older one (primed).

    The older clone is the first of the same stationary time.
    """

    sigma_v: float
    sigma_p: float
    sigma_theta: float
    before: int | None
    """Index of the older clone; None without one: then the velocity is measured alone, with 3 rows instead of 9."""

    @staticmethod
    def of(period: StationaryPeriod, state: State, has_clone: bool) -> "ZeroVelocity":
        """Return the rows of a stationary time; their sigmas grow with the motion in the image.

        sigma_v = 5 mm/s + d / T + tremor / (2 pi f), sigma_p = 1 mm + d, sigma_theta = 1 mrad + moved, where
        d = moved (3 m) and T is the duration.
        """
        moved_m = period.moved_rad * DISTANCE_M
        sigma_v = SIGMA_V_M_S + moved_m / period.age_s + TREMOR_V_S * period.tremor_m_s2
        sigmas = sigma_v, SIGMA_P_M + moved_m, SIGMA_THETA_RAD + period.moved_rad
        oldest = int(np.searchsorted(state.clones.t_ns, period.since_ns))
        return ZeroVelocity(*sigmas, oldest if has_clone and oldest < len(state.clones) - 1 else None)

    def residual(self, state: State) -> Float:
        """Return the whitened residual, (count,)."""
        v = -state.v_W / self.sigma_v
        if self.before is None:
            return v
        R, p = state.clones.R_WI, state.clones.p_WI
        rotation = so3.log(R[self.before].T @ R[-1])
        return np.concatenate([v, (p[self.before] - p[-1]) / self.sigma_p, -rotation / self.sigma_theta])

    def jacobian(self, state: State) -> Float:
        """Return the whitened Jacobian at first estimates, (count, size): I; I, -I; I, -R^T R'."""
        H = np.zeros((3 if self.before is None else 9, state.size))
        H[:3, V] = np.eye(3) / self.sigma_v
        if self.before is None:
            return H
        before, now = state.clone_slice(self.before).start, state.clone_slice(len(state.clones) - 1).start
        R = state.clones.R_fej
        for at, sign in ((before, -1.0), (now, 1.0)):
            H[3:6, at + P.start : at + P.stop] = sign * np.eye(3) / self.sigma_p
        H[6:, now + THETA.start : now + THETA.stop] = np.eye(3) / self.sigma_theta
        H[6:, before + THETA.start : before + THETA.stop] = -R[-1].T @ R[self.before] / self.sigma_theta
        return H

    def innovation(self, state: State) -> Innovation:
        """Return the innovation of all rows together, S = H P H^T + I."""
        H = self.jacobian(state)
        return Innovation.of(self.residual(state)[None], (H @ state.cov @ H.T)[None], np.array([len(H)]))
