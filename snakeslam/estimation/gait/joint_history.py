"""What the joints did between two times: angles and rates from a servo's coarse steps, and what is wrong with them.

A servo tells rates in steps of 24 mrad/s, the same step for tenths of a second, and angles in steps of 1.5 mrad. A
body of many joints adds up what is wrong with the rates, and more the farther a contact is from the head. So each
joint's angle is that of a Kalman filter, carried on by the rates and drawn to the angles,

    x <- x + dq dt,  P <- P + (s_dq dt)^2;  K = P / (P + s_q^2),  x <- x + K (q - x),  P <- (1 - K) P,

and a rate over a span is the difference of its angles: from span to span it adds up to where the joint has gone.
"""

from bisect import bisect_left, bisect_right

import numpy as np

from snakeslam.messages import Float, JointState

NS = 1e-9
JOINTS_LAST_NS = 100_000_000
"""Joint states this far apart, or this old, tell nothing of what is between or after."""
KEPT_NS = 5_000_000_000
CLOCK_SET_BACK_STATES = 10
"""So many states in a row that are late are those of a clock that has been set back."""
MAX_RATE_RAD_S = 50.0
STUCK_RAD = 0.02
"""Angles this far from what their rates add up to are not those of the same joints."""
ANGLE_SIGMA_RAD = 2.0 * np.pi / 4096.0 / np.sqrt(12.0)
"""That of an encoder of 4096 steps."""
RATE_SIGMA_RAD_S = 0.005
"""Of a rate told in steps of .229 rpm it is .007; from .004 to .007 the way comes out the same, above worse."""
OFF_RAD = 0.01
"""An angle this far from what the rates foresaw is no matter of steps."""


class AngleFilter:
    """The angles of all joints of one robot, filtered one by one; their variance is the same."""

    def __init__(self) -> None:
        self._last: tuple[JointState, Float] | None = None
        self._var_rad2 = ANGLE_SIGMA_RAD**2

    def take(self, joints: JointState) -> Float:
        """Return the angles (N,) rad at the next state; after a gap, and where they are far from it, those told."""
        if self._last is None or joints.t_ns - self._last[0].t_ns > JOINTS_LAST_NS:
            self._var_rad2 = ANGLE_SIGMA_RAD**2
            q_rad = joints.q_rad
        else:
            q_rad = self._corrected(joints, *self._last)
        self._last = joints, q_rad
        return q_rad

    def _corrected(self, joints: JointState, before: JointState, q_rad: Float) -> Float:
        dt_s = (joints.t_ns - before.t_ns) * NS
        carried_rad = q_rad + 0.5 * (before.dq_rad_s + joints.dq_rad_s) * dt_s
        var_rad2 = self._var_rad2 + (RATE_SIGMA_RAD_S * dt_s) ** 2
        gain = var_rad2 / (var_rad2 + ANGLE_SIGMA_RAD**2)
        self._var_rad2 = (1.0 - gain) * var_rad2
        off_rad = joints.q_rad - carried_rad
        return np.where(np.abs(off_rad) > OFF_RAD, joints.q_rad, carried_rad + gain * off_rad)


class JointHistory:
    """The last joint states of one robot; what is no use is only counted."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._states: list[JointState] = []
        self._angles_rad: list[Float] = []
        self._filter = AngleFilter()
        self._bad = 0
        self._late = 0

    def add(self, joints: JointState) -> None:
        """Take the next state; one that is late, not finite, not possible or of another robot is counted."""
        right = joints.q_rad.shape == joints.dq_rad_s.shape == (self._count,)
        late = bool(self._states) and joints.t_ns <= self._states[-1].t_ns
        self._late = self._late + 1 if late else 0
        if self._late >= CLOCK_SET_BACK_STATES:
            self.clear()
            late = False
        if late or not right or not self._possible(joints):
            self._bad += 1
            return
        self._angles_rad.append(self._filter.take(joints))
        self._states.append(joints)
        self.forget_before(joints.t_ns - KEPT_NS)

    @staticmethod
    def _possible(joints: JointState) -> bool:
        # Comparisons with what is not a number are false.
        return bool(np.all(np.abs(joints.q_rad) < np.pi) and np.all(np.abs(joints.dq_rad_s) < MAX_RATE_RAD_S))

    def take_bad_count(self) -> int:
        """Return how many were refused since the last call."""
        bad, self._bad = self._bad, 0
        return bad

    def clear(self) -> None:
        """Forget all."""
        self._states.clear()
        self._angles_rad.clear()
        self._filter = AngleFilter()

    def forget_before(self, t_ns: int) -> None:
        """Drop what no time after ``t_ns`` needs."""
        gone = max(0, bisect_right(self._states, t_ns, key=_time) - 1)
        del self._states[:gone], self._angles_rad[:gone]

    def covers(self, start_ns: int, end_ns: int) -> bool:
        """Whether there are states all along, none of them further from the next than ``JOINTS_LAST_NS``."""
        first = max(0, bisect_right(self._states, start_ns, key=_time) - 1)
        times = [s.t_ns for s in self._states[first:] if s.t_ns <= end_ns]
        if not times or times[0] > start_ns + JOINTS_LAST_NS:
            return False
        gaps = np.diff([*times, end_ns])
        return bool(np.all(gaps <= JOINTS_LAST_NS))

    def _between(self, start_ns: int, end_ns: int) -> list[JointState]:
        first = bisect_left(self._states, start_ns, key=_time)
        return self._states[first : bisect_right(self._states, end_ns, key=_time)]

    def age_ns(self, t_ns: int) -> int:
        """Return how long before ``t_ns`` the last state was; without any as if since time 0."""
        return t_ns - (self._states[-1].t_ns if self._states else 0)

    def mean(self, start_ns: int, end_ns: int) -> tuple[Float, Float]:
        """Return the angles in the middle of a span and the mean rates over it, (N,) each."""
        first, last = self._angles_at(start_ns), self._angles_at(end_ns)
        return 0.5 * (first + last), (last - first) / ((end_ns - start_ns) * NS)

    def _angles_at(self, t_ns: int) -> Float:
        """Return the angles at a time, (N,), before the first and after the last state carried on by its rates."""
        k = bisect_right(self._states, t_ns, key=_time)
        near, angles = self._states[max(0, k - 1)], self._angles_rad[max(0, k - 1)]
        ahead_s = (t_ns - near.t_ns) * NS
        if k in (0, len(self._states)):
            return angles + near.dq_rad_s * ahead_s
        after = self._states[k]
        part = ahead_s / ((after.t_ns - near.t_ns) * NS)
        return angles + (self._angles_rad[k] - angles) * part

    def stuck(self, start_ns: int, end_ns: int) -> bool:
        """Whether the angles do not follow their own rates."""
        near = self._between(start_ns - JOINTS_LAST_NS, end_ns)
        if len(near) < 2:
            return False
        dt_s = np.diff([s.t_ns for s in near])[:, None] * NS
        rates = np.array([s.dq_rad_s for s in near])
        foreseen = np.sum(0.5 * (rates[1:] + rates[:-1]) * dt_s, axis=0)
        return bool(np.max(np.abs(near[-1].q_rad - near[0].q_rad - foreseen)) > STUCK_RAD)


def _time(joints: JointState) -> int:
    return joints.t_ns
