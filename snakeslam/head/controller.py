"""The head controller in force: the shape that it adds to the gait, and its feedback on the targets."""

import numpy as np

from snakeslam.gaits.blend import GaitBlend, Shape
from snakeslam.gaits.gait import ResolvedGait
from snakeslam.head.attitude import HeadAttitude
from snakeslam.head.laws import HeadShape, feeds_back, steers_head
from snakeslam.head.level import LevelNeck
from snakeslam.head.line import HeadLine
from snakeslam.head.neck import neck_joints_of, neck_of
from snakeslam.head.predictive import PredictiveNeck, prepare
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import Float, ImuSample, JointState, PoseEstimate
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import SnakeModel
from snakeslam.robot.support import posture_loads


class HeadSense:
    """The head's line, attitude and rate, propagated at each step whatever controls the head."""

    def __init__(self) -> None:
        self.line = HeadLine()
        self.attitude = HeadAttitude()
        self.gyro_I: Float = np.zeros(3)

    def update(self, t_ns: int, pose: PoseEstimate | None, imu: ImuSample | None) -> None:
        """Propagate to ``t_ns`` with the newest estimate and IMU sample."""
        self.line.update(t_ns, pose, imu)
        self.attitude.update(t_ns, pose, imu)
        if imu is not None:
            self.gyro_I = imu.gyro_I


class HeadControl:
    """One controller with its settings; other settings need another object, which shares ``sense``."""

    def __init__(self, model: SnakeModel, settings: HeadSettings, sense: HeadSense) -> None:
        self.settings = settings
        self.sense = sense
        self._model = model
        self._neck = neck_of(model, neck_joints_of(settings, model))
        self._loads = posture_loads(model)
        prepare(model, self._neck)
        self._law: PredictiveNeck | LevelNeck | None = None
        self._q_rad: Float = model.rest_q_rad
        self.shape: Shape = HeadShape(settings.controller, model, self._neck)

    def feeds_back(self, gait: ResolvedGait) -> bool:
        """Return whether the neck's targets come from feedback in this gait, not from the blend."""
        return feeds_back(self.settings.controller, gait)

    def steers(self, gait: ResolvedGait) -> bool:
        """Return whether the robot follows the head's line in this gait."""
        return self.feeds_back(gait) and steers_head(gait)

    @property
    def engaged(self) -> bool:
        """Whether the neck's targets come from feedback now."""
        return self._law is not None

    def fits(self, gait: ResolvedGait) -> bool:
        """Return whether the feedback law in force is the one for this gait."""
        return self.feeds_back(gait) and isinstance(self._law, PredictiveNeck) == steers_head(gait)

    def disengage(self) -> None:
        """Leave the neck's targets to the blend."""
        self._law = None

    def step(self, q_rad: Float, blend: GaitBlend, now_rad: Float, joints: JointState | None, dt_s: float) -> Float:
        """Return the targets (N,) rad: ``q_rad`` of the blend with the neck's angles in place of its own.

        ``now_rad`` (N,) are the targets of the step before. ``sense`` must have been updated.
        """
        gait = blend.gait
        if self._law is None:
            self._engage(gait, now_rad, q_rad)
        dq_rad_s, self._q_rad = (q_rad - self._q_rad) / dt_s, q_rad
        q_rad = q_rad.copy()
        if isinstance(self._law, PredictiveNeck):
            period_s = 2.0 * np.pi / gait.omega
            errors = self.sense.line.errors
            q_rad[self._law.neck.joints] = self._law.step(q_rad, dq_rad_s, errors, blend.pace, period_s, dt_s)
        elif self._law is not None:
            q_rad[self._law.joints] = self._law.step(
                q_rad,
                joints,
                self.sense.gyro_I,
                self.sense.attitude.R_WI,
                self.sense.line.heading_rad,
                blend.sigma,
                blend.pace * gait.omega,
                dt_s,
            )
        return q_rad

    def _engage(self, gait: ResolvedGait, now_rad: Float, q_rad: Float) -> None:
        """Start the feedback law of ``gait`` from the present targets ``now_rad``."""
        if steers_head(gait):
            ratio = self.settings.friction_ratio
            self._law = PredictiveNeck(self._model, self._neck, self._loads, ratio, now_rad[self._neck.joints])
        else:
            count = neck_joints_of(self.settings, self._model)
            joints = np.arange(self._model.joint_count - count, self._model.joint_count)
            self._law = LevelNeck(self._model, joints, now_rad[joints], holds_roll=not gait.rolls)
        self._lay_line(now_rad)
        self._q_rad = q_rad

    def _lay_line(self, q_rad: Float) -> None:
        """Set the line along the body: through its middle, in its mean direction."""
        T_WI = np.eye(4)
        T_WI[:3, :3] = self.sense.attitude.R_WI
        Ts_WL = link_poses_from_imu(self._model, q_rad, T_WI)
        along, middle_W = np.sum(Ts_WL[:, :2, 0], axis=0), np.mean(Ts_WL[:, :2, 3], axis=0)
        self.sense.line.lay(float(np.arctan2(along[1], along[0])), middle_W)
