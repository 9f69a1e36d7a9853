"""From the operator's command to joint targets: gait, head, limits; pure, with no clock of its own."""

from snakeslam.errors import InputError
from snakeslam.gaits.blend import GaitBlend
from snakeslam.gaits.catalogue import GaitSettings, resolve
from snakeslam.gaits.command import commanded_gait
from snakeslam.head.command import commanded_head
from snakeslam.head.settings import HeadSettings, require_built
from snakeslam.messages import GaitCommand, HeadCommand, ImuSample, JointState, JointTarget, PoseEstimate
from snakeslam.robot.limits import LimitedFollower
from snakeslam.robot.model import SnakeModel

NS = 1e-9
LONGEST_STEP_S = 0.05
"""A gap between steps longer than this is not made up for."""


class Control:
    """Plays the commanded gait; at rest (drive 0) until the first command.

    Raises InputError for a gait that the joints cannot do, NotBuiltError for a head controller still to come.
    """

    def __init__(self, model: SnakeModel, gait: GaitSettings, head: HeadSettings) -> None:
        require_built(head)
        self._model = model
        self._configured = gait
        self._head = head
        self._gait = resolve(gait, model)
        self._drive = 0.0
        self._t_ns: int | None = None
        self._blend = GaitBlend(model, self._gait, model.rest_q_rad)
        self._follower = LimitedFollower(model.limits, model.rest_q_rad)

    @property
    def head(self) -> HeadSettings:
        """The head settings in force."""
        return self._head

    def command_head(self, command: HeadCommand) -> None:
        """Take the operator's wish for the head; InputError, and no change, where it cannot be done."""
        self._head = commanded_head(command, self._head, self._model, self._gait)

    def command(self, command: GaitCommand) -> None:
        """Take the operator's wish; InputError, and no change, where it cannot be done."""
        for key, value in (("drive", command.drive), ("turn", command.turn)):
            if not abs(value) <= 1.0:
                raise InputError(f"gait.{key}", f"cannot be {value}", "-1 to 1")
        gait = resolve(commanded_gait(command, self._configured), self._model, command.turn)
        self._drive = command.drive
        if gait != self._gait:
            self._gait = gait
            self._blend.set_gait(gait)

    def step(
        self, t_ns: int, joints: JointState | None, pose: PoseEstimate | None, imu: ImuSample | None
    ) -> JointTarget:
        """Return the targets at ``t_ns``; the first step takes up the angles that the joints are in.

        The pose and the IMU are for head control.
        """
        del pose, imu
        dt_s = self._elapsed_s(t_ns, joints)
        if dt_s > 0.0:
            self._follower.step(self._blend.step(self._drive, dt_s), dt_s)
        return JointTarget(t_ns, self._follower.q_rad)

    def _elapsed_s(self, t_ns: int, joints: JointState | None) -> float:
        if self._t_ns is None and joints is not None:
            self._blend = GaitBlend(self._model, self._gait, joints.q_rad)
            self._follower = LimitedFollower(self._model.limits, joints.q_rad)
        elapsed_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * NS
        if elapsed_s < 0.0:
            raise InputError("control", f"time goes back by {-elapsed_s:.6f} s")
        self._t_ns = t_ns
        return min(elapsed_s, LONGEST_STEP_S)
