"""The zero-velocity update: a head that picture and IMU both say is at rest does not drift."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import PlainRows
from snakeslam.estimation.filter.state import THETA, P, State, V
from snakeslam.estimation.frontend.tracking import FrontendFrame
from snakeslam.geometry import so3
from snakeslam.geometry.median import median
from snakeslam.messages import Float, ImuSample

REST_NS = 300_000_000
REST_PX = 2.0
MIN_COMMON = 10
GYRO_STD_RAD_S, ACCEL_STD_M_S2 = 0.02, 0.15
GYRO_MEAN_RAD_S = 0.02
TREMOR_PX, TREMOR_GYRO_MEAN_RAD_S = 3.0, 0.05
"""The limits with a tremor, from a start at rest for as long as the image stays where it was."""
TREMOR_GYRO_STD, TREMOR_ACCEL_STD = 0.15, 2.0
"""Spread of the gyro's samples, rad/s, and of the specific force, m/s^2, in a tremor or a motor's vibration."""
TREMOR_V_S = 0.05
"""Velocity of a tremor over its acceleration, s: 1 / (2 pi 3 Hz)."""
DISTANCE_M = 3.0
"""Assumed distance of the scene, which converts a motion in the image into one in space."""
SIGMA_V_M_S, SIGMA_P_M, SIGMA_THETA_RAD = 0.005, 0.001, 0.001


@dataclass(frozen=True, slots=True)
class Rest:
    """At rest since ``since_ns``, for ``age_s``; the picture moved by ``moved_rad`` (median angle of its features).

    ``since_start`` tells that it has lasted since the filter's start, with a tremor of ``tremor_m_s2`` (spread of the
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


class RestDetector:
    """Says when IMU and picture have been at rest together for a while."""

    def __init__(self, noise: ImuCalibration, focal_px: float) -> None:
        gyro = 2.0 * noise.gyroscope_noise_density * np.sqrt(noise.update_rate)
        self._white_accel = noise.accelerometer_noise_density * np.sqrt(noise.update_rate)
        accel = 2.0 * self._white_accel
        self._still = _Limits(GYRO_STD_RAD_S + gyro, ACCEL_STD_M_S2 + accel, GYRO_MEAN_RAD_S, REST_PX / focal_px)
        self._tremor = _Limits(
            TREMOR_GYRO_STD + gyro, TREMOR_ACCEL_STD + accel, TREMOR_GYRO_MEAN_RAD_S, TREMOR_PX / focal_px
        )
        self._reference: tuple[int, FrontendFrame] | None = None
        self._since_start = False
        self.tremor_m_s2 = 0.0
        """Spread of the specific force beyond the IMU's noise, while a tremor is allowed; else 0."""

    def begin(self, t_ns: int, frame: FrontendFrame) -> None:
        """Take it that rest has been found otherwise, for as long as it takes.

        Without depth a tremor is no end of it: no parallax tells the filter that the camera stays where it is. With
        depth the features do.
        """
        self._reference = (t_ns - REST_NS, frame)
        self._since_start = not np.any(frame.depth_m > 0.0)

    def see(self, t_ns: int, frame: FrontendFrame, samples: Sequence[ImuSample], bias_g: Float) -> Rest | None:
        """Return the rest that lasts until ``t_ns``, or None; ``samples`` are those of the last 0.3 s."""
        limits = self._tremor if self._since_start else self._still
        self.tremor_m_s2 = 0.0
        spread = self._imu_rests(samples, bias_g, limits)
        if spread is None:
            self._reference, self._since_start = None, False
            return None
        if self._reference is None:
            self._reference = (t_ns, frame)
            return None
        since_ns, reference = self._reference
        _, now, then = np.intersect1d(frame.ids, reference.ids, assume_unique=True, return_indices=True)
        moved = np.linalg.norm(frame.xy[now] - reference.xy[then], axis=1)
        self.tremor_m_s2 = np.sqrt(max(0.0, spread**2 - self._white_accel**2)) if self._since_start else 0.0
        enough = len(moved) >= MIN_COMMON
        moved_rad = median(moved) if enough else np.inf
        if moved_rad > limits.moved_rad:
            # Features that are replaced are no motion: the next frame is compared with this one.
            self._reference, self._since_start = (t_ns, frame), self._since_start and not enough
            return None
        if t_ns - since_ns < REST_NS:
            return None
        return Rest(since_ns, (t_ns - since_ns) / 1e9, moved_rad, self._since_start, self.tremor_m_s2)

    @staticmethod
    def _imu_rests(samples: Sequence[ImuSample], bias_g: Float, limits: _Limits) -> float | None:
        """Return the spread of the specific force, None where the IMU does not rest."""
        if len(samples) < 2:
            return None
        gyro = np.array([s.gyro_I for s in samples])
        accel = np.array([s.accel_I for s in samples])
        spread = accel.std(axis=0)
        rests = (
            np.all(gyro.std(axis=0) < limits.gyro_std)
            and np.all(spread < limits.accel_std)
            and np.linalg.norm(gyro.mean(axis=0) - bias_g) < limits.gyro_mean
        )
        return float(np.sqrt(np.mean(spread**2))) if rests else None


@dataclass(slots=True)
class AtRest(PlainRows):
    """Rows v_W = 0, p = p' and Log(R'^T R) = 0 between the newest clone and an older one of the same rest (primed)."""

    sigma_v: float
    sigma_p: float
    sigma_theta: float
    before: int | None
    """The older clone; None where there is none: then the velocity alone is told, and count is 3 in place of 9."""

    @staticmethod
    def of(rest: Rest, state: State, has_clone: bool) -> "AtRest":
        """Return the rows of a rest; what moves a little in the picture may move a little in space."""
        moved_m = rest.moved_rad * DISTANCE_M
        sigma_v = SIGMA_V_M_S + moved_m / rest.age_s + TREMOR_V_S * rest.tremor_m_s2
        sigmas = sigma_v, SIGMA_P_M + moved_m, SIGMA_THETA_RAD + rest.moved_rad
        of_rest = int(np.searchsorted(state.clones.t_ns, rest.since_ns))
        return AtRest(*sigmas, of_rest if has_clone and of_rest < len(state.clones) - 1 else None)

    def residual(self, state: State) -> Float:
        """Return the whitened residual, (count,)."""
        v = -state.v_W / self.sigma_v
        if self.before is None:
            return v
        R, p = state.clones.R_WI, state.clones.p_WI
        turn = so3.log(R[self.before].T @ R[-1])
        return np.concatenate([v, (p[self.before] - p[-1]) / self.sigma_p, -turn / self.sigma_theta])

    def jacobian(self, state: State) -> Float:
        """Return the whitened Jacobian at first estimates, (count, size)."""
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
        """Return how far it is from what the state foresees."""
        H = self.jacobian(state)
        return Innovation.of(self.residual(state)[None], (H @ state.cov @ H.T)[None], np.array([len(H)]))
