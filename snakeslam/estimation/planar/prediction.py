"""Carries a planar state along with the joints, by the gait's motion model."""

import numpy as np

from snakeslam.estimation.planar.models import Twist
from snakeslam.estimation.planar.motion import GaitMotion, Shape
from snakeslam.estimation.planar.settings import PlanarSettings
from snakeslam.estimation.planar.state import Motion, PlanarState, heading_of
from snakeslam.messages import Float, JointState
from snakeslam.robot.model import SnakeModel

NS = 1e-9
JOINTS_LAST_NS = 100_000_000
"""Joint states older than this tell nothing of the present motion."""


class GaitPrediction:
    """The joints as last reported, what the gait's model makes of them, and the prediction of Eq. (40) with it.

    What the state knows better than the model fades in the slip's time. In a gait without a model the motion goes on as
    it was, ``raw`` takes it to be none.
    """

    def __init__(self, model: SnakeModel, settings: PlanarSettings, raw: bool = False) -> None:
        self.gait = GaitMotion(model, settings.friction_ratio, settings.rolling)
        self._settings, self._raw, self._count = settings, raw, model.joint_count
        self._joints: JointState | None = None
        self._twist: Twist | None = None
        self._before: tuple[float, float] | None = None
        self._direction_rad = 0.0
        self._t_ns = 0

    @property
    def ready(self) -> bool:
        """Whether there was a joint state."""
        return self._joints is not None

    def start(self, t_ns: int) -> None:
        """Predict from here on."""
        self._t_ns, self._before = t_ns, None

    def take(self, joints: JointState, state: PlanarState | None) -> bool:
        """Take a joint state and bring ``state`` to its time; False for one that is no use."""
        finite = bool(np.all(np.isfinite(joints.q_rad)) and np.all(np.isfinite(joints.dq_rad_s)))
        late = self._joints is not None and joints.t_ns <= self._joints.t_ns
        if late or not finite or joints.q_rad.shape != (self._count,):
            return False
        self._joints = joints
        self._twist = self.gait.twist_V(joints.q_rad, joints.dq_rad_s)
        if state is not None:
            self.bring(state, joints.t_ns)
        return True

    def bring(self, state: PlanarState, t_ns: int) -> None:
        """Predict ``state`` up to a time."""
        dt_s = (t_ns - self._t_ns) * NS
        if dt_s <= 0.0:
            return
        fresh = self._joints is not None and t_ns - self._joints.t_ns < JOINTS_LAST_NS
        state.predict(self._motion(self._twist if fresh else None, dt_s), dt_s, self._settings.slip_time_s)
        self._t_ns = t_ns

    def shape(self, t_ns: int, R_WI: Float | None) -> Shape:
        """Return the robot's shape at a time, the joints carried on by their rates; a flat body's without R_WI."""
        q_rad = self._angles(t_ns)
        return self.gait.shape(q_rad, self.gait.level_attitude(q_rad) if R_WI is None else R_WI)

    def level_attitude(self, t_ns: int) -> Float:
        """Return the attitude (3, 3) of the IMU on a body that lies flat; its yaw has no meaning."""
        return self.gait.level_attitude(self._angles(t_ns))

    def _angles(self, t_ns: int) -> Float:
        assert self._joints is not None
        ahead_s = min(max(t_ns - self._joints.t_ns, 0), JOINTS_LAST_NS) * NS
        return self._joints.q_rad + self._joints.dq_rad_s * ahead_s

    def _motion(self, twist_V: Twist | None, dt_s: float) -> Motion:
        settings, before = self._settings, self._before
        sigma = settings.unmodelled_m_s
        if twist_V is not None:
            sigma = float(np.hypot(settings.still_m_s, settings.slip_share * twist_V.effort))
        # Across, errors swing with the gait: about as much as they are in a second.
        errors = sigma, sigma / settings.turn_arm_m, sigma
        if twist_V is None and self._raw:
            twist_V = Twist(np.zeros(2), 0.0, 0.0)
        if twist_V is None:
            self._before = None
            return Motion(0.0, 0.0, 0.0, 0.0, self._direction_rad, 1.0, *errors)
        speed, self._direction_rad = heading_of(twist_V)
        self._before = speed, twist_V.omega
        # After a gait without a model there is nothing to compare with: the model is believed.
        keep = float(np.exp(-dt_s / settings.slip_time_s)) if before is not None else 0.0
        return Motion(speed, twist_V.omega, *(before or self._before), self._direction_rad, keep, *errors)
