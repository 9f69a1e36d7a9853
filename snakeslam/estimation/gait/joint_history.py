"""The joints' angles and rates between two times, filtered from a servo's coarse readings, and the faults of these.

Servos report joint rates quantised to 24 mrad/s, constant for tenths of a second, and angles quantised to 1.5 mrad. In
a body of many joints the errors of the rates add up, the more the farther a contact is from the head. So each angle is
estimated by a Kalman filter, predicted with the rates and corrected by the angles,

    x <- x + dq dt,  P <- P + (s_dq dt)^2;  K = P / (P + s_q^2),  x <- x + K (q - x),  P <- (1 - K) P,

and the rate over a span is the difference of its angles, so that the rates sum up to the joint's displacement.
"""

from bisect import bisect_left, bisect_right

import numpy as np

from snakeslam.messages import Float, JointState

NS = 1e-9
JOINTS_LAST_NS = 100_000_000
"""Longest time between two joint states, or after the last, over which they are interpolated or extrapolated, 0.1 s."""
KEPT_NS = 5_000_000_000
"""Older states are dropped; a frame needs those since the frame before."""
CLOCK_SET_BACK_STATES = 10
"""After so many late states in succession the clock has been set back."""
MAX_RATE_RAD_S = 50.0
"""Reported rates beyond this are errors: servos reach 6 rad/s."""
STUCK_RAD = 0.02
"""Angles this far from the integral of their rates do not belong to the same joints."""
ANGLE_SIGMA_RAD = 2.0 * np.pi / 4096.0 / np.sqrt(12.0)
"""Quantisation of an encoder with 4096 steps per revolution: a step over sqrt(12)."""
RATE_SIGMA_RAD_S = 0.005
"""Quantisation in steps of 0.229 rpm is 0.007 rad/s; from 0.004 to 0.007 the displacement is the same, above worse."""
OFF_RAD = 0.01
"""An angle this far from the prediction is not explained by quantisation: the filter starts from it."""


class AngleFilter:
    """The Kalman filters of all joints of one robot, which share one variance."""

    def __init__(self) -> None:
        self._last: tuple[JointState, Float] | None = None
        self._var_rad2 = ANGLE_SIGMA_RAD**2

    def update(self, joints: JointState) -> Float:
        """Return the filtered angles (N,) rad at the next state; the reported ones after a gap or a jump."""
        if self._last is None or joints.t_ns - self._last[0].t_ns > JOINTS_LAST_NS:
            self._var_rad2 = ANGLE_SIGMA_RAD**2
            q_rad = joints.q_rad
        else:
            before, q_before_rad = self._last
            # Predict with the mean of both rates, then correct by the angle, as above.
            dt_s = (joints.t_ns - before.t_ns) * NS
            predicted_rad = q_before_rad + 0.5 * (before.dq_rad_s + joints.dq_rad_s) * dt_s
            var_rad2 = self._var_rad2 + (RATE_SIGMA_RAD_S * dt_s) ** 2
            gain = var_rad2 / (var_rad2 + ANGLE_SIGMA_RAD**2)
            self._var_rad2 = (1.0 - gain) * var_rad2
            innovation_rad = joints.q_rad - predicted_rad
            q_rad = np.where(np.abs(innovation_rad) > OFF_RAD, joints.q_rad, predicted_rad + gain * innovation_rad)
        self._last = joints, q_rad
        return q_rad


class JointHistory:
    """The last joint states of one robot with their filtered angles; faulty states are counted and left out."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._states: list[JointState] = []
        self._angles_rad: list[Float] = []
        self._filter = AngleFilter()
        self._bad = 0
        self._late = 0

    def add(self, joints: JointState) -> None:
        """Add the next state; one that is late, not finite, not possible or of another robot is only counted."""
        right = joints.q_rad.shape == joints.dq_rad_s.shape == (self._count,)
        late = bool(self._states) and joints.t_ns <= self._states[-1].t_ns
        self._late = self._late + 1 if late else 0
        if self._late >= CLOCK_SET_BACK_STATES:
            self.clear()
            late = False
        # A comparison with NaN is false.
        possible = right and bool(
            np.all(np.abs(joints.q_rad) < np.pi) and np.all(np.abs(joints.dq_rad_s) < MAX_RATE_RAD_S)
        )
        if late or not possible:
            self._bad += 1
            return
        self._angles_rad.append(self._filter.update(joints))
        self._states.append(joints)
        self.forget_before(joints.t_ns - KEPT_NS)

    def pop_bad_count(self) -> int:
        """Return the number of states left out since the last call."""
        bad, self._bad = self._bad, 0
        return bad

    def clear(self) -> None:
        """Drop all states."""
        self._states.clear()
        self._angles_rad.clear()
        self._filter = AngleFilter()

    def forget_before(self, t_ns: int) -> None:
        """Drop the states that no time after ``t_ns`` needs."""
        gone = max(0, bisect_right(self._states, t_ns, key=_time) - 1)
        del self._states[:gone], self._angles_rad[:gone]

    def covers(self, start_ns: int, end_ns: int) -> bool:
        """Return whether states cover a span without a gap longer than JOINTS_LAST_NS."""
        first = max(0, bisect_right(self._states, start_ns, key=_time) - 1)
        times = [s.t_ns for s in self._states[first:] if s.t_ns <= end_ns]
        if not times or times[0] > start_ns + JOINTS_LAST_NS:
            return False
        gaps = np.diff([*times, end_ns])
        return bool(np.all(gaps <= JOINTS_LAST_NS))

    def age_ns(self, t_ns: int) -> int:
        """Return the age of the last state at ``t_ns``; without any it is that of time 0."""
        return t_ns - (self._states[-1].t_ns if self._states else 0)

    def mean(self, start_ns: int, end_ns: int) -> tuple[Float, Float]:
        """Return the mean angles of a span, (q0 + q1) / 2, and its mean rates, (q1 - q0) / dt, (N,) each."""
        first, last = self._angles_at(start_ns), self._angles_at(end_ns)
        return 0.5 * (first + last), (last - first) / ((end_ns - start_ns) * NS)

    def _angles_at(self, t_ns: int) -> Float:
        """Return the interpolated angles at a time, (N,); before the first and after the last state extrapolated."""
        k = bisect_right(self._states, t_ns, key=_time)
        near, angles = self._states[max(0, k - 1)], self._angles_rad[max(0, k - 1)]
        ahead_s = (t_ns - near.t_ns) * NS
        if k in (0, len(self._states)):
            return angles + near.dq_rad_s * ahead_s
        after = self._states[k]
        part = ahead_s / ((after.t_ns - near.t_ns) * NS)
        return angles + (self._angles_rad[k] - angles) * part

    def stuck(self, start_ns: int, end_ns: int) -> bool:
        """Return whether the reported angles contradict the integral of their rates."""
        first = bisect_left(self._states, start_ns - JOINTS_LAST_NS, key=_time)
        near = self._states[first : bisect_right(self._states, end_ns, key=_time)]
        if len(near) < 2:
            return False
        dt_s = np.diff([s.t_ns for s in near])[:, None] * NS
        rates = np.array([s.dq_rad_s for s in near])
        integral = np.sum(0.5 * (rates[1:] + rates[:-1]) * dt_s, axis=0)
        return bool(np.max(np.abs(near[-1].q_rad - near[0].q_rad - integral)) > STUCK_RAD)


def _time(joints: JointState) -> int:
    return joints.t_ns
