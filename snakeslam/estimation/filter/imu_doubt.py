"""Doubted IMU samples (knocks, spikes, saturation, stuck and missing samples) and the covariance that they add.

A sample that jumps away from its neighbours is either a disturbance of the sensor or a hit that really moved the head,
and the IMU alone cannot decide which. So it is neither used as it is nor deleted: the mean is propagated with the
median of its neighbours, the covariance of the motion grows by the whole jump, and the camera decides in the update.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from snakeslam.messages import Float, ImuSample

NEIGHBOURS = 9
"""Samples before, whose median is the reference: 45 ms at 200 Hz. A lasting change is accepted after half of them."""
FEWEST = 5
"""Fewer samples than this have no meaningful median."""
JUMP_ACCEL_M_S2, JUMP_RATE_RAD_S = 5.0, 1.0
"""Least distance from that median that is doubted."""
JUMP_STEPS = 5.0
"""The same in units of the median step from sample to sample: vibration is no jump."""
STUCK = 4
"""A sensor that repeats its six values so many times is stuck: noise alone changes them."""
SILENT_ACCEL_M_S2, SILENT_RATE_RAD_S = 2.0, 1.0
"""Assumed acceleration and rate of the head, one sigma, while samples are missing or stuck."""
MAX_SIGMA_V_M_S, MAX_SIGMA_THETA_RAD = 0.5, 0.3
"""Upper limits of the added sigmas: no hit changes the head's velocity or orientation by more between two frames."""
GRAVITY_M_S2 = 9.81


@dataclass(frozen=True, slots=True)
class SampleDoubt:
    """The possible error of one sample, ``rate_rad_s`` and ``accel_m_s2`` (norms), and whether the sensor is stuck."""

    rate_rad_s: float
    accel_m_s2: float
    stuck: bool = False


@dataclass(frozen=True, slots=True)
class MotionDoubt:
    """One sigma of the error of a span of the IMU beyond its noise, and the reasons for the operator.

    ``v_m_s`` and ``theta_rad`` are per axis; ``lag_s`` is the mean time from the doubted samples to the span's end.
    """

    v_m_s: float
    theta_rad: float
    lag_s: float
    reasons: tuple[str, ...]

    @property
    def variance_v(self) -> float:
        """Variance of the velocity, (m/s)^2: sigma_v^2 + (g sigma_theta lag)^2; a wrong tilt integrates gravity."""

        return self.v_m_s**2 + (GRAVITY_M_S2 * self.theta_rad * self.lag_s) ** 2


class ImuFaultDetector:
    """Compares each sample with the last NEIGHBOURS."""

    def __init__(self) -> None:
        self._before: deque[ImuSample] = deque(maxlen=NEIGHBOURS)
        self._repeats = 0
        self._jumped = False

    def check(self, sample: ImuSample) -> tuple[ImuSample, SampleDoubt | None]:
        """Return the sample to integrate and its doubt; the same sample and None if it is plausible."""
        if not self._before:
            self._before.append(sample)
            return sample, None
        last = self._before[-1]
        d_gyro, d_accel = sample.gyro_I - last.gyro_I, sample.accel_I - last.accel_I
        # 1. Stuck: the same six values again and again.
        self._repeats = 0 if d_gyro.any() or d_accel.any() else self._repeats + 1
        before = list(self._before)
        self._before.append(sample)
        if self._repeats >= STUCK:
            return sample, SampleDoubt(SILENT_RATE_RAD_S, SILENT_ACCEL_M_S2, stuck=True)
        if not self._jumped and d_gyro @ d_gyro < JUMP_RATE_RAD_S**2 and d_accel @ d_accel < JUMP_ACCEL_M_S2**2:
            # 2. A sample near one that is not doubted is no jump. Almost all samples end here.
            return sample, None
        if len(before) < FEWEST:
            return sample, None
        # 3. A jump away from the median of the last samples: that median is integrated, the jump is the doubt.
        gyro, rate = _jump(np.array([s.gyro_I for s in before]), sample.gyro_I, JUMP_RATE_RAD_S)
        accel, force = _jump(np.array([s.accel_I for s in before]), sample.accel_I, JUMP_ACCEL_M_S2)
        self._jumped = rate > 0.0 or force > 0.0
        if not self._jumped:
            return sample, None
        return ImuSample(sample.t_ns, gyro, accel), SampleDoubt(rate, force)

    def clear(self) -> None:
        """Drop the reference, after the clock has been set."""
        self._before.clear()
        self._repeats = 0
        self._jumped = False


def _jump(before: Float, value: Float, least: float) -> tuple[Float, float]:
    """Return (value, 0) or, for a jump, the median of the values ``before`` (n, 3) and the distance from it."""
    reference = np.median(before, axis=0)
    distance = float(np.linalg.norm(value - reference))
    if distance <= least:
        return value, 0.0
    step = float(np.median(np.linalg.norm(np.diff(before, axis=0), axis=1)))
    return (reference, distance) if distance > JUMP_STEPS * step else (value, 0.0)


def motion_doubt(
    doubts: list[tuple[int, SampleDoubt]], start_ns: int, end_ns: int, period_s: float
) -> MotionDoubt | None:
    """Return the error of the motion between two times by doubted samples (time, doubt); None without any.

    A sample is wrong for one period, and the errors of neighbours add up: sigma_v = sum |da| dt, sigma_theta =
    sum |dw| dt.
    """
    inside = [(t_ns, doubt) for t_ns, doubt in doubts if start_ns < t_ns <= end_ns + round(period_s * 1e9)]
    if not inside:
        return None
    v = period_s * sum(doubt.accel_m_s2 for _, doubt in inside)
    theta = period_s * sum(doubt.rate_rad_s for _, doubt in inside)
    lag_s = float(np.mean([max(0.0, (end_ns - t_ns) * 1e-9) for t_ns, _ in inside]))
    stuck = sum(doubt.stuck for _, doubt in inside)
    reasons = (f"{len(inside) - stuck} IMU samples jump",) if stuck < len(inside) else ()
    reasons += (f"{stuck} IMU samples repeat the one before",) if stuck else ()
    return MotionDoubt(min(v, MAX_SIGMA_V_M_S), min(theta, MAX_SIGMA_THETA_RAD), lag_s, reasons)
