"""Prediction of the planar state by the gait's motion model and the measured joints."""

import numpy as np

from snakeslam.estimation.planar.models import Twist
from snakeslam.estimation.planar.motion import BodyShape, GaitMotionModel
from snakeslam.estimation.planar.settings import PlanarSettings
from snakeslam.estimation.planar.state import ControlInput, PlanarState, speed_and_direction
from snakeslam.messages import Float, JointState
from snakeslam.robot.model import SnakeModel

NS = 1e-9
JOINTS_LAST_NS = 100_000_000
"""Longest time over which a joint state is extrapolated, 0.1 s; then the motion is unknown."""


class GaitPrediction:
    """The last joint state, the motion that the gait's model derives from it, and the prediction of Eq. (40) with it.

    The difference between state and model decays with the time constant of slip. In a gait without a model the motion
    continues as it was; with ``raw`` it is zero.
    """

    def __init__(self, model: SnakeModel, settings: PlanarSettings, raw: bool = False) -> None:
        self.gait = GaitMotionModel(model, settings.friction_ratio, settings.rolling)
        self._settings, self._raw, self._count = settings, raw, model.joint_count
        self._joints: JointState | None = None
        self._twist: Twist | None = None
        self._before: tuple[float, float] | None = None
        self._direction_rad = 0.0
        self._t_ns = 0

    @property
    def ready(self) -> bool:
        """Whether a joint state has been added."""
        return self._joints is not None

    def start(self, t_ns: int) -> None:
        """Set the time from which the prediction starts."""
        self._t_ns, self._before = t_ns, None

    def add(self, joints: JointState, state: PlanarState | None) -> bool:
        """Add a joint state and propagate ``state`` to its time; return False for one that is late or not valid."""
        finite = bool(np.all(np.isfinite(joints.q_rad)) and np.all(np.isfinite(joints.dq_rad_s)))
        late = self._joints is not None and joints.t_ns <= self._joints.t_ns
        if late or not finite or joints.q_rad.shape != (self._count,):
            return False
        self._joints = joints
        self._twist = self.gait.twist_V(joints.q_rad, joints.dq_rad_s)
        if state is not None:
            self.propagate(state, joints.t_ns)
        return True

    def propagate(self, state: PlanarState, t_ns: int) -> None:
        """Predict ``state`` up to ``t_ns``, Eq. (38) and (40)."""
        dt_s = (t_ns - self._t_ns) * NS
        if dt_s <= 0.0:
            return
        fresh = self._joints is not None and t_ns - self._joints.t_ns < JOINTS_LAST_NS
        state.predict(self._control_input(self._twist if fresh else None, dt_s), dt_s, self._settings.slip_time_s)
        self._t_ns = t_ns

    def shape(self, t_ns: int, R_WI: Float | None) -> BodyShape:
        """Return the body's shape at a time, with extrapolated joints; that of a flat body without ``R_WI``."""
        q_rad = self._angles(t_ns)
        return self.gait.shape(q_rad, self.gait.level_attitude(q_rad) if R_WI is None else R_WI)

    def level_attitude(self, t_ns: int) -> Float:
        """Return the attitude (3, 3) of the IMU on a body that lies flat; its yaw has no meaning."""
        return self.gait.level_attitude(self._angles(t_ns))

    def _angles(self, t_ns: int) -> Float:
        """Return the angles (N,) rad at a time, extrapolated by their rates."""
        assert self._joints is not None
        ahead_s = min(max(t_ns - self._joints.t_ns, 0), JOINTS_LAST_NS) * NS
        return self._joints.q_rad + self._joints.dq_rad_s * ahead_s

    def _control_input(self, twist_V: Twist | None, dt_s: float) -> ControlInput:
        """Return u of Eq. (38) for the model's motion; None for a gait without a model, or without joint states."""
        settings, before = self._settings, self._before
        sigma = settings.unmodelled_m_s
        if twist_V is not None:
            sigma = float(np.hypot(settings.still_m_s, settings.slip_share * twist_V.effort))
        # The error across oscillates with the gait; its white noise is about its size in m/s, per sqrt(s).
        errors = sigma, sigma / settings.turn_arm_m, sigma
        if twist_V is None and self._raw:
            twist_V = Twist(np.zeros(2), 0.0, 0.0)
        if twist_V is None:
            self._before = None
            return ControlInput(0.0, 0.0, 0.0, 0.0, self._direction_rad, 1.0, *errors)
        speed, self._direction_rad = speed_and_direction(twist_V)
        self._before = speed, twist_V.omega
        # After a gait without a model there is no difference to keep: the model's motion is used as it is.
        keep = float(np.exp(-dt_s / settings.slip_time_s)) if before is not None else 0.0
        return ControlInput(speed, twist_V.omega, *(before or self._before), self._direction_rad, keep, *errors)
