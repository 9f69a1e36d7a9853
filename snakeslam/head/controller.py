"""The head controller in force: the shape that it lays over the gait, and what it does to the targets."""

import numpy as np

from snakeslam.gaits.blend import Shape
from snakeslam.gaits.catalogue import ResolvedGait
from snakeslam.head.laws import shape_of, steers_head
from snakeslam.head.line import HeadLine
from snakeslam.head.neck import Neck, neck_of
from snakeslam.head.predictive import PredictiveNeck
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import Float
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import SnakeModel
from snakeslam.robot.support import posture_loads


class HeadControl:
    """One controller with its settings; made anew for others, but for the line, which stays."""

    def __init__(self, model: SnakeModel, settings: HeadSettings, line: HeadLine) -> None:
        self.settings = settings
        self.line = line
        self._model = model
        self._neck: Neck = neck_of(model, settings.neck_joints)
        self._loads = posture_loads(model)
        self._predictive: PredictiveNeck | None = None
        self._q_rad: Float = model.rest_q_rad
        self.shape: Shape = shape_of(settings.controller, model, self._neck)

    def feeds_back(self, gait: ResolvedGait) -> bool:
        """Return whether the neck's targets come from here in this gait, not from the blend."""
        return self.settings.controller == "predictive" and steers_head(gait)

    @property
    def engaged(self) -> bool:
        """Whether the neck's targets come from here now."""
        return self._predictive is not None

    def disengage(self) -> None:
        """Leave the neck to the blend."""
        self._predictive = None

    def step(self, q_rad: Float, gait: ResolvedGait, pace: float, now_rad: Float, dt_s: float) -> Float:
        """Return the targets (N,) rad: ``q_rad`` of the blend with the neck's angles in place of its own.

        ``now_rad`` (N,) are the targets of the step before. ``line`` has been brought up to date.
        """
        if self._predictive is None:
            self._predictive = PredictiveNeck(
                self._model, self._neck, self._loads, self.settings.friction_ratio, now_rad[self._neck.joints]
            )
            self._lay_line(now_rad)
            self._q_rad = q_rad
        dq_rad_s = (q_rad - self._q_rad) / dt_s
        self._q_rad = q_rad
        period_s = 2.0 * np.pi / gait.omega
        q_rad = q_rad.copy()
        q_rad[self._neck.joints] = self._predictive.step(q_rad, dq_rad_s, self.line.errors, pace, period_s, dt_s)
        return q_rad

    def _lay_line(self, q_rad: Float) -> None:
        """Lay the line along the body: through its middle, in its mean direction."""
        Ts_IL = link_poses_from_imu(self._model, q_rad, np.eye(4))
        along = np.sum(Ts_IL[:, :2, 0], axis=0)
        self.line.lay(float(np.arctan2(along[1], along[0])), np.mean(Ts_IL[:, :2, 3], axis=0))
