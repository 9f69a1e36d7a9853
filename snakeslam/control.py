"""From the operator's command to joint targets: gait, head, limits; pure, with no clock of its own."""

from pydantic import ValidationError

from snakeslam.errors import InputError
from snakeslam.gaits.blend import GaitBlend
from snakeslam.gaits.catalogue import GaitSettings, resolve
from snakeslam.head.settings import HeadSettings, require_built
from snakeslam.messages import GaitCommand, ImuSample, JointState, JointTarget, PoseEstimate
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
        self._gait = resolve(gait, model)
        self._drive = 0.0
        self._t_ns: int | None = None
        self._blend = GaitBlend(model, self._gait, model.rest_q_rad)
        self._follower = LimitedFollower(model.limits, model.rest_q_rad)

    def command(self, command: GaitCommand) -> None:
        """Take the operator's wish; InputError, and no change, where it cannot be done."""
        for key, value in (("drive", command.drive), ("turn", command.turn)):
            if not abs(value) <= 1.0:
                raise InputError(f"gait.{key}", f"cannot be {value}", "-1 to 1")
        gait = resolve(self._settings(command), self._model, command.turn)
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

    def _settings(self, command: GaitCommand) -> GaitSettings:
        """Return the command's parameters over the configured ones (which are those of the configured gait only)."""
        asked = {
            "alpha_pi": command.alpha_pi,
            "wavelength_joints": command.wavelength_joints,
            "period_s": command.period_s,
            "amplitude_deg": command.amplitude_deg,
        }
        given = {key: value for key, value in asked.items() if value is not None}
        kept = self._configured.model_dump() if command.gait == self._configured.name else {"name": command.gait}
        if "alpha_pi" in given or "amplitude_deg" in given:
            kept.pop("alpha_pi", None)
            kept.pop("amplitude_deg", None)
        try:
            return GaitSettings.model_validate({**kept, **given})
        except ValidationError as error:
            first = error.errors()[0]
            raise InputError(f"gait.{'.'.join(map(str, first['loc']))}", first["msg"]) from error

    def _elapsed_s(self, t_ns: int, joints: JointState | None) -> float:
        if self._t_ns is None and joints is not None:
            self._blend = GaitBlend(self._model, self._gait, joints.q_rad)
            self._follower = LimitedFollower(self._model.limits, joints.q_rad)
        elapsed_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * NS
        if elapsed_s < 0.0:
            raise InputError("control", f"time goes back by {-elapsed_s:.6f} s")
        self._t_ns = t_ns
        return min(elapsed_s, LONGEST_STEP_S)
