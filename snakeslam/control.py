"""From the operator's command to joint targets: gait, head, limits; pure, with no clock of its own."""

import math

from snakeslam.errors import InputError
from snakeslam.gaits.blend import GaitBlend
from snakeslam.gaits.catalogue import GaitSettings, ResolvedGait, resolve
from snakeslam.gaits.command import commanded_gait
from snakeslam.head.command import commanded_head
from snakeslam.head.controller import HeadControl, HeadSense
from snakeslam.head.laws import check, settled
from snakeslam.head.line import STEERING_RATE_RAD_S
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import Float, GaitCommand, HeadCommand, ImuSample, JointState, JointTarget, PoseEstimate
from snakeslam.robot.limits import LimitedFollower
from snakeslam.robot.model import SnakeModel

NS = 1e-9
LONGEST_STEP_S = 0.05
"""A gap between steps longer than this is not made up for."""


class Control:
    """Plays the commanded gait, its head held as commanded; at rest (drive 0) until the first command.

    Raises InputError for a gait that the joints cannot do, or a neck that cannot hold the head in it.
    """

    def __init__(self, model: SnakeModel, gait: GaitSettings, head: HeadSettings) -> None:
        self._model = model
        self._configured = gait
        self._straight = self._turned = self._gait = resolve(gait, model)
        head = settled(head, model, self._gait)
        self._drive, self._steering = 0.0, 0.0
        self.throttle = 1.0
        """Share of the commanded drive that is played, 0 to 1."""
        self._t_ns: int | None = None
        self._head = HeadControl(model, head, HeadSense())
        self._blend = GaitBlend(model, self._gait, model.rest_q_rad, self._head.shape)
        self._follower = LimitedFollower(model.limits, model.rest_q_rad)

    @property
    def head(self) -> HeadSettings:
        """The head control in force."""
        return self._head.settings

    @property
    def commanded(self) -> ResolvedGait:
        """The gait that was commanded, without steering."""
        return self._straight

    def command(self, command: GaitCommand) -> None:
        """Resolve and play what the operator commands; InputError, and no change, where it cannot be done."""
        for key, value in (("drive", command.drive), ("turn", command.turn)):
            if not abs(value) <= 1.0:
                raise InputError(f"gait.{key}", f"cannot be {value}", "-1 to 1")
        settings = commanded_gait(command, self._configured)
        straight, turned = resolve(settings, self._model), resolve(settings, self._model, command.turn)
        check(self.head, self._model, turned)
        self._straight, self._turned, self._drive, self._steering = straight, turned, command.drive, command.turn
        self._play()

    def command_head(self, command: HeadCommand) -> None:
        """Hold the head as the operator commands; InputError, and no change, where it cannot be done."""
        settings = commanded_head(command, self.head, self._model, self._gait)
        if settings != self.head:
            self._release_neck()
            self._head = HeadControl(self._model, settings, self._head.sense)
            self._blend.set_shape(self._head.shape)
            self._play()
        if command.turn_by_deg is not None:
            self._head.sense.line.steer_by(math.radians(command.turn_by_deg))

    def _play(self) -> None:
        """Play the commanded gait; where the head is held on a line, the line steers, not the gait."""
        gait = self._straight if self._head.steers(self._straight) else self._turned
        if gait != self._gait:
            self._gait = gait
            self._blend.set_gait(gait)

    def step(
        self, t_ns: int, joints: JointState | None, pose: PoseEstimate | None, imu: ImuSample | None
    ) -> JointTarget:
        """Return the targets at ``t_ns``; the first step starts from the measured joint angles.

        The newest pose and IMU sample are for head control.
        """
        dt_s = self._elapsed_s(t_ns, joints)
        self._head.sense.update(t_ns, pose, imu)
        if dt_s > 0.0:
            self._follower.step(self._wanted(dt_s, joints), dt_s)
        return JointTarget(t_ns, self._follower.q_rad, self._blend.roll_rad)

    def _wanted(self, dt_s: float, joints: JointState | None) -> Float:
        """Return the gait's angles with those of head control in the neck."""
        q_rad = self._blend.step(self._drive * self.throttle, dt_s)
        if self._head.engaged and not self._head.fits(self._blend.gait):
            q_rad = self._release_neck(dt_s)
        if not self._head.feeds_back(self._blend.gait):
            return q_rad
        if self._head.steers(self._blend.gait):
            self._head.sense.line.steer_by(self._steering * STEERING_RATE_RAD_S * abs(self._blend.pace) * dt_s)
        return self._head.step(q_rad, self._blend, self._follower.q_rad, joints, dt_s)

    def _release_neck(self, dt_s: float = 0.0) -> Float:
        """End feedback on the neck: the blend continues from the angles that it has reached, ``dt_s`` later."""
        q_rad, dq_rad_s = self._follower.q_rad, self._follower.dq_rad_s
        if self._head.engaged:
            self._blend.resume_from(q_rad + dq_rad_s * dt_s, dq_rad_s)
            self._head.disengage()
        return q_rad + dq_rad_s * dt_s

    def _elapsed_s(self, t_ns: int, joints: JointState | None) -> float:
        if self._t_ns is None and joints is not None:
            self._blend = GaitBlend(self._model, self._gait, joints.q_rad, self._head.shape)
            self._follower = LimitedFollower(self._model.limits, joints.q_rad)
        elapsed_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * NS
        if elapsed_s < 0.0:
            raise InputError("control", f"time goes back by {-elapsed_s:.6f} s")
        self._t_ns = t_ns
        return min(elapsed_s, LONGEST_STEP_S)
