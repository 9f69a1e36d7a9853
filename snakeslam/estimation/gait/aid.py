"""The gait's part in ``fused``: joint states in; each frame's way for the filter, and what is wrong with it."""

from collections import deque

from snakeslam.estimation.filter.preintegration import ImuBuffer, ImuSegments
from snakeslam.estimation.filter.state import State
from snakeslam.estimation.gait.joint_history import JointHistory
from snakeslam.estimation.gait.learning import SlipModel
from snakeslam.estimation.gait.odometry import NS, GaitOdometer
from snakeslam.estimation.gait.rows import Carried, GaitWay
from snakeslam.estimation.gait.settings import GaitSensorSettings
from snakeslam.messages import JointState
from snakeslam.robot.model import SnakeModel

TRIES = 20
"""So many last ways decide whether the gait is said to disagree."""


class GaitAid:
    """One robot's gait beside camera and IMU."""

    def __init__(self, model: SnakeModel, settings: GaitSensorSettings) -> None:
        self.settings = settings
        self.slip = SlipModel(settings)
        self._joints = JointHistory(model.joint_count)
        self._odometer = GaitOdometer(model, settings)
        self._tries: deque[bool] = deque(maxlen=TRIES)
        self._last_ns: int | None = None
        self._way: GaitWay | None = None
        self._reasons: tuple[str, ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """What is wrong with the gait at the last frame, in words."""
        return self._reasons

    def take(self, joints: JointState) -> None:
        """Take a joint state."""
        self._joints.add(joints)

    def clear(self) -> None:
        """Forget the joints: the clock was set anew."""
        self._joints.clear()
        self._last_ns = None

    def tell(self, state: State, imu: ImuBuffer, t_ns: int, frozen: bool) -> GaitWay | None:
        """Return the way to ``t_ns``, the state's time, from the frame before; None when the gait has nothing to say.

        From the newest clone, or for a ``frozen`` picture from the frame before, which has none.
        """
        start_ns, self._last_ns, self._way = self._last_ns, t_ns, None
        has_clone = len(state.clones) > 0 and start_ns == int(state.clones.t_ns[-1])
        turn = imu.segments(start_ns, t_ns) if start_ns is not None else None
        self._reasons = self._faults(start_ns, t_ns)
        if start_ns is None or turn is None or self._reasons or not (has_clone or frozen):
            return None
        R_WI = state.clones.R_WI[-1] if has_clone else state.R_WI
        turn = ImuSegments(turn.gyro_I - state.bias_g, turn.accel_I, turn.dt_s)
        way = self._odometer.reckon(self._joints, start_ns, t_ns, turn, R_WI, self.slip.ratio)
        self._joints.forget_before(start_ns)
        if way is not None:
            self.slip.see(way)
            self._way = GaitWay(self.slip.corrected(way), self.slip.cov(way))
        return self._way

    def hear(self, carried: Carried | None, seeing: bool) -> bool:
        """Learn from what the filter made of the last way; return whether the gait holds the state."""
        if carried is None or self._way is None:
            return False
        self._tries.append(carried.taken)
        if seeing:
            self.slip.learn(self._way.reckoned, carried.moved_I, carried.cov)
        if 2 * sum(self._tries) < len(self._tries):
            self._reasons = (*self._reasons, "the gait disagrees with the motion")
        return carried.taken

    def _faults(self, start_ns: int | None, t_ns: int) -> tuple[str, ...]:
        bad = self._joints.take_bad_count()
        said = [f"{bad} joint states were late, not numbers, not possible or of another robot"] if bad else []
        if start_ns is None:
            return tuple(said)
        if not self._joints.covers(start_ns, t_ns):
            said.append(f"no joint states for {self._joints.age_ns(t_ns) * NS * 1e3:.0f} ms: without the gait")
        elif self._joints.stuck(start_ns, t_ns):
            said.append("joint angles do not follow their rates: without the gait")
        return tuple(said)
