"""The head's motion while the body moves, over the last period of the gait.

Defined as in ``studies.metrics`` for a finished run: yaw about its mean, the peak of the rate's means over 20 ms, and
sway across the displacement of one whole period, whose direction the swing of the body does not change.
"""

from collections import deque

import numpy as np

from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample, PoseEstimate
from snakeslam.runtime.bus.topics import HeadMotion

NS = 1e-9
LEAST_SAMPLES = 8
LEAST_TRAVEL_M = 0.05
"""Below this displacement its direction is noise, and sway is measured across the mean heading."""
RATE_WINDOW_NS = 20_000_000
PERIOD_S = 4.0
"""The window while no gait's period is known."""


class HeadMotionMeter:
    """Measures the head's motion from the estimate and the gyroscope over the last ``period_s``."""

    def __init__(self, period_s: float = PERIOD_S) -> None:
        self.period_s = period_s
        self._newest_R_WI: Float = np.eye(3)
        self._has_gyro = False
        self.restart()

    def restart(self) -> None:
        """Forget the motion so far, as after a reset of the estimate."""
        self._poses: deque[tuple[float, float, float, float]] = deque()
        self._rates: deque[tuple[float, float]] = deque()
        self._rate_rad_s: float | None = None
        self._slice_ns = 0
        self._slice: list[float] = []

    def on_imu(self, imu: ImuSample) -> None:
        """Add the gyroscope's rate about the vertical of the newest estimate."""
        self._has_gyro = True
        rate = float(self._newest_R_WI[2] @ imu.gyro_I)
        # Low-pass for display, time constant 0.1 s at 200 Hz; the peak is that of means over 20 ms.
        self._rate_rad_s = rate if self._rate_rad_s is None else self._rate_rad_s + 0.05 * (rate - self._rate_rad_s)
        if self._slice and imu.t_ns - self._slice_ns >= RATE_WINDOW_NS:
            self._add_rate(imu.t_ns * NS, float(np.mean(self._slice)))
            self._slice = []
        if not self._slice:
            self._slice_ns = imu.t_ns
        self._slice.append(rate)

    def on_pose(self, pose: PoseEstimate) -> None:
        """Add an estimate."""
        t_s, self._newest_R_WI = pose.t_ns * NS, pose.T_WI[:3, :3]
        yaw = float(so3.yaw(self._newest_R_WI))
        if self._poses:
            t_before_s, _, _, before = self._poses[-1]
            rotation = (yaw - before + np.pi) % (2.0 * np.pi) - np.pi
            yaw = before + rotation
            if not self._has_gyro and t_s > t_before_s:
                self._rate_rad_s = rotation / (t_s - t_before_s)
                self._add_rate(t_s, self._rate_rad_s)
        self._poses.append((t_s, float(pose.T_WI[0, 3]), float(pose.T_WI[1, 3]), yaw))
        # One pose older than the window is kept, to interpolate the window's beginning.
        while len(self._poses) > 1 and t_s - self._poses[1][0] >= self.period_s:
            self._poses.popleft()

    def motion(self) -> HeadMotion:
        """Return the head's motion now and over the last period; None where there is not enough yet."""
        rate = _deg(self._rate_rad_s)
        if len(self._poses) < LEAST_SAMPLES:
            return HeadMotion(yaw_rate_deg_s=rate, peak_yaw_rate_deg_s=self._peak_deg_s(), window_s=self.period_s)
        x, y, yaw = self._last_period()
        # The first and the last sample have the same phase of the gait, so one of them is left out of the mean.
        mean_yaw = float(np.mean(yaw[1:]))
        return HeadMotion(
            yaw_deg=_deg(float(yaw[-1]) - mean_yaw),
            yaw_rms_deg=_deg(float(np.std(yaw[1:]))),
            yaw_rate_deg_s=rate,
            peak_yaw_rate_deg_s=self._peak_deg_s(),
            sway_m=_sway_m(x, y, mean_yaw),
            heading_deg=_deg((mean_yaw + np.pi) % (2.0 * np.pi) - np.pi),
            window_s=self.period_s,
        )

    def _add_rate(self, t_s: float, rate_rad_s: float) -> None:
        self._rates.append((t_s, rate_rad_s))
        while t_s - self._rates[0][0] > self.period_s:
            self._rates.popleft()

    def _peak_deg_s(self) -> float | None:
        if len(self._rates) < LEAST_SAMPLES:
            return None
        return _deg(float(np.max(np.abs(np.array(self._rates)[:, 1]))))

    def _last_period(self) -> tuple[Float, Float, Float]:
        """Return x, y (m) and unwrapped yaw (rad) at equal intervals over the last period, or the known part of it."""
        t, x, y, yaw = np.array(self._poses).T
        at = np.linspace(max(t[0], t[-1] - self.period_s), t[-1], len(t))
        return np.interp(at, t, x), np.interp(at, t, y), np.interp(at, t, yaw)


def _sway_m(x: Float, y: Float, mean_yaw_rad: float) -> float:
    """Return the motion across the net travel, peak to peak, in the ground plane."""
    along = np.array([x[-1] - x[0], y[-1] - y[0]])
    travel = float(np.linalg.norm(along))
    if travel < LEAST_TRAVEL_M:
        along, travel = np.array([np.cos(mean_yaw_rad), np.sin(mean_yaw_rad)]), 1.0
    return float(np.ptp((along[0] * y - along[1] * x) / travel))


def _deg(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else float(np.rad2deg(angle_rad))
