"""The robot: backend, control and safety in one loop of 100 Hz, with what the operator commands; no bus in sight.

The same in the node and in a test. Times called ``now_ns`` are the robot's (``robot_time``), stamps the node's clock.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import structlog
from msgspec import structs

from snakeslam.backends.base import Backend
from snakeslam.config import Config
from snakeslam.control import Control
from snakeslam.errors import InputError
from snakeslam.gaits.command import configured_gait
from snakeslam.messages import (
    CameraFrame,
    GaitCommand,
    HeadCommand,
    ImuSample,
    JointState,
    JointTarget,
    Packet,
    PoseEstimate,
)
from snakeslam.runtime.bus.commands import BackUp, Drive, EStop, ResetEStop, RobotCommand, SetGait, SetHead, Start, Stop
from snakeslam.runtime.bus.topics import Event, RobotState
from snakeslam.runtime.bus.wire import Estimate, Order, Sensors
from snakeslam.runtime.process.log_limit import LogLimit, error_words
from snakeslam.runtime.process.pacing import Pacer
from snakeslam.runtime.robot.answers import Answers
from snakeslam.runtime.robot.blindness import Blindness
from snakeslam.runtime.robot.driving import SILENT_HAND
from snakeslam.runtime.robot.governor import build_governor
from snakeslam.runtime.robot.guard import STEP_S
from snakeslam.runtime.robot.safety import LOST, Safety
from snakeslam.runtime.robot.words import head_words

_log = structlog.get_logger("robot")
UNSEEN_S = 1.0
"""So much motion at most goes unseen until a silent slam is noticed and the robot has braked."""


@dataclass(frozen=True, slots=True)
class Step:
    """What one control period gave: sensors but for the camera, and the camera's frames."""

    sensors: Sensors
    frames: tuple[CameraFrame, ...]


class Robot:
    """Steps the backend under control's targets, as far as safety lets them through; ``say`` gets words.

    ``required`` names the inputs without which it does not move. A start that ``autostart`` asks for waits for them and
    for ``run.rest_s``.
    """

    def __init__(
        self,
        config: Config,
        backend: Backend,
        control: Control,
        say: Callable[[Event], None],
        *,
        boot: str = "",
        required: dict[str, str] | None = None,
        estop_reason: str | None = None,
        autostart: bool = False,
    ) -> None:
        assert backend.model is not None
        self.backend, self.boot = backend, boot
        self.t_start_ns = backend.t_ns
        self._model, self._control, self._put = backend.model, control, say
        self.safety = Safety(self._model.limits, LOST if required is None else required, estop_reason)
        self._gait = configured_gait(config.gait)
        self._governor = build_governor(config)
        self._blindness = Blindness(config.safety, config.estimator.health.min_features)
        self._notice: str | None = None
        self._period_s = 0.0
        self._autostart_ns: int | None = backend.t_ns + round(config.run.rest_s * 1e9)
        if not autostart or estop_reason is not None:
            self._autostart_ns = None
        self._answers = Answers()
        self.pacer = Pacer()
        self.last_pose: PoseEstimate | None = None
        """The newest there was, though slam may have none now."""
        self._steps_unseen = 0
        self._pose: PoseEstimate | None = None
        self._imu: ImuSample | None = None
        self._joints: JointState | None = None
        self._target: JointTarget | None = None
        self._seq = 0
        self._held: str | None = None
        self._estop_told = estop_reason is not None
        self._limit = LogLimit()
        self._judge_gait()

    @property
    def joint_count(self) -> int:
        """How many joints the robot has."""
        return self._model.joint_count

    def obey(self, order: Order, now_ns: int) -> str | None:
        """Obey an order at once, or return why not; the next joint target already does.

        An error on the way is a hold, and the answer says so.
        """
        command = order.command
        if isinstance(command, Drive):
            command = structs.replace(command, deadman=f"{order.sender}/{command.deadman}")
        try:
            refusal = self.safety.judge(order, now_ns) or self.take(command, now_ns)
        except Exception as error:  # noqa: BLE001
            self.fault(command_words(command), error)
            refusal = f"it failed: {error_words(error)}"
        self._answers.note(order, refusal)
        # Who drives repeats it many times a second, and hears of each refusal anyway.
        if refusal is not None and not isinstance(command, Drive):
            self._say("error", f"{command_words(command)} refused: {refusal}")
        return refusal

    def take(self, command: RobotCommand, now_ns: int) -> str | None:
        """Do what is commanded; return why it cannot be, and change nothing then."""
        try:
            return self._do(command, now_ns)
        except InputError as error:
            return str(error)

    def _do(self, command: RobotCommand, now_ns: int) -> str | None:
        match command:
            case EStop(reason):
                self.estop(reason)
            case ResetEStop():
                self._reset()
            case SetGait(gait):
                self._command(self._gait.drive, gait)
            case SetHead(head):
                self._set_head(head)
            case Start():
                return self._start(now_ns)
            case BackUp():
                return self._back_up(now_ns)
            case Drive():
                return self._drive(command, now_ns)
            case Stop():
                self._stop()
        return None

    def hear(self, estimate: Estimate) -> None:
        """Take slam's word on a picture; on one of an earlier boot nothing depends any more."""
        if estimate.boot != self.boot:
            return
        self._pose, self.last_pose = estimate.pose, estimate.pose or self.last_pose
        if estimate.pose is not None:
            self._steps_unseen = 0
        self._blindness.add(estimate.t_ns, estimate.health)
        if self._governor is not None:
            self._control.throttle = self._governor.step(estimate.t_ns, estimate.health).pace

    @property
    def last_pose_holds(self) -> bool:
        """Whether the robot has hardly moved since ``last_pose``: it braked at most."""
        return self._steps_unseen * STEP_S <= UNSEEN_S

    def step(self, now_ns: int, stamp_ns: int | None = None) -> Step | None:
        """Advance one control period, stamped ``stamp_ns`` (None: now); None at the end of the backend."""
        if self._autostart_ns is not None and self.backend.t_ns >= self._autostart_ns:
            self._autostart(now_ns)
        self._watch_sight()
        self._steps_unseen += self.safety.moving
        target = self._target = self._next_target(now_ns)
        self._notice_hold()
        packets = self.backend.step(target)
        if packets is None:
            return None
        return self._sorted(packets, target, now_ns if stamp_ns is None else stamp_ns)

    def stop_now(self, reason: str) -> None:
        """Ramp to a hold, as when the node ends."""
        self.safety.hold(reason)
        self._autostart_ns = None

    def fault(self, what: str, error: Exception) -> None:
        """Hold the robot because ``what`` has failed, and report it; never raises: the brake ramp goes out after."""
        reason = f"{what} failed: {error_words(error)}"
        reported = self.safety.guard.held_because is None
        self.stop_now(reason)
        left_out = self._limit.due(what)
        if left_out is None:
            return
        _log.error("held", reason=reason, left_out=left_out, exc_info=error)
        if not reported:  # else the hold itself is reported, at the next step
            self._say("error", reason)

    def estop(self, reason: str) -> None:
        """Latch the E-stop, then let control come to rest and report it."""
        self.safety.latch(reason)
        self._autostart_ns = None
        if self._estop_told:
            return
        self._estop_told = True
        self._blindness.end()
        self._held = self.safety.guard.held_because
        self._say("error", f"E-stop: {reason}")
        self._command(0.0)

    def state(self, now_ns: int) -> RobotState:
        """Return the newest state."""
        return RobotState(
            boot=self.boot,
            stamp_ns=now_ns,
            t_start_ns=self.t_start_ns,
            t_ns=self.backend.t_ns,
            moving=self.safety.moving,
            estop_reason=self.safety.estop_reason,
            held_because=self.safety.guard.held_because,
            gait=self._gait if self.safety.moving else replace(self._gait, drive=0.0),
            head_settings=self._control.head,
            notice=self._notice,
            period_s=self._period_s,
            realtime_factor=self.pacer.realtime_factor,
            q_target_rad=None if self._target is None else self._target.q_rad,
            q_measured_rad=None if self._joints is None else self._joints.q_rad,
            governed=None if self._governor is None else self._governor.now,
            back_up_offered=self._blindness.stopped and not self.safety.moving and self.safety.estop_reason is None,
            answers=self._answers.all(),
        )

    def _sorted(self, packets: Sequence[Packet], target: JointTarget | None, stamp_ns: int) -> Step:
        imu = tuple(packet for packet in packets if isinstance(packet, ImuSample))
        joints = [packet for packet in packets if isinstance(packet, JointState)]
        self._imu = imu[-1] if imu else self._imu
        self._joints = joints[-1] if joints else self._joints
        truth = tuple(self.backend.take_ground_truth())
        sensors = Sensors(self.boot, self._seq, stamp_ns, imu, joints[-1] if joints else None, target, truth)
        self._seq += 1
        return Step(sensors, tuple(packet for packet in packets if isinstance(packet, CameraFrame)))

    def _next_target(self, now_ns: int) -> JointTarget | None:
        """Return what the servos get: control's target as far as safety lets it through, the brake ramp if it fails."""
        try:
            asked = self._control.step(self.backend.t_ns, self._joints, self._pose, self._imu)
            if asked.q_rad.shape != (self._model.joint_count,):
                raise ValueError(f"targets of shape {asked.q_rad.shape} for {self._model.joint_count} joints")
            measured = None if self._joints is None else self._joints.q_rad
            return self.safety.step(asked, now_ns, measured)
        except Exception as error:  # noqa: BLE001
            self.fault("control", error)
            return self.safety.brake(self.backend.t_ns)

    def _reset(self) -> None:
        self._estop_told = False
        if self.safety.estop_reason is not None:
            self.safety.reset()
            self._say("info", "E-stop cleared; start to move again")

    def _autostart(self, now_ns: int) -> None:
        if self.safety.may_start(now_ns) is None:
            self._start(now_ns)

    def _start(self, now_ns: int) -> str | None:
        self._autostart_ns = None
        was_moving = self.safety.moving
        refusal = self.safety.start(now_ns)
        if refusal is None:
            self._held = None
            self._command(1.0)
            if not was_moving or self._blindness.backs_up:
                self._blindness.start(self.backend.t_ns)
                self._say("info", f"start {self._gait.gait}")
        return refusal

    def _back_up(self, now_ns: int) -> str | None:
        """Play the gait backwards for a while, as the operator asks; blindness does not hold the robot meanwhile."""
        self._autostart_ns = None
        refusal = self.safety.start(now_ns)
        if refusal is None:
            self._held = None
            self._blindness.back_up(self.backend.t_ns)
            self._command(-1.0)
            self._say("info", "back up")
        return refusal

    def _watch_sight(self) -> None:
        """Hold a robot that has gone blind for too long; end a back-up that has lasted long enough."""
        if self.safety.moving and self._blindness.too_long(self.backend.t_ns):
            self._blindness.stop()
            self.safety.hold(self._blindness.words)
        elif self._blindness.backed_up(self.backend.t_ns):
            self._stop()

    def _drive(self, command: Drive, now_ns: int) -> str | None:
        """Move as the operator's hand says, for as long as it goes on saying so; 0 lets go."""
        self._autostart_ns = None
        if command.drive == 0.0:
            self.safety.driving.let_go(command.deadman)
            self._stop(command.turn)
            return None
        refusal = self.safety.may_drive(command.deadman, command.begins, now_ns)
        if refusal is not None:
            return refusal
        if (command.drive, command.turn) != (self._gait.drive, self._gait.turn):
            self._command(command.drive, replace(self._gait, turn=command.turn))
        if not self.safety.moving or self._blindness.backs_up:
            self._held = None
            self._blindness.start(self.backend.t_ns)
            self._say("info", f"start {self._gait.gait}")
        self.safety.drive(command.deadman, now_ns)
        return None

    def _stop(self, turn: float | None = None) -> None:
        """Come to rest."""
        self._autostart_ns = None
        was_moving = self.safety.moving
        self._blindness.end()
        self.safety.stop()
        self._command(0.0, replace(self._gait, turn=self._gait.turn if turn is None else turn))
        if was_moving:
            self._say("info", "stop")

    def _notice_hold(self) -> None:
        """Let control come to rest too where safety holds the robot, and tell why."""
        held = self.safety.guard.held_because
        if held is None or held == self._held:
            return
        self._held = held
        self._blindness.end()
        self._say("error", f"held: {held}; start to move again")
        try:
            # What the hand steered goes with the hand.
            self._command(0.0, replace(self._gait, turn=0.0) if held == SILENT_HAND else None)
        except Exception as error:  # noqa: BLE001
            self.fault("control", error)

    def _command(self, drive: float, gait: GaitCommand | None = None) -> None:
        """Command ``gait`` (else the one there is); InputError, and no change, where it cannot be done."""
        gait = replace(gait or self._gait, t_ns=self.backend.t_ns, drive=drive)
        self._control.command(gait)
        self._gait = gait
        self._judge_gait()

    def _judge_gait(self) -> None:
        """Take the gait's period and what the operator should know of it."""
        gait = self._control.commanded
        self._notice = gait.notice
        self._period_s = 2.0 * np.pi / gait.omega

    def _set_head(self, command: HeadCommand) -> None:
        before = self._control.head
        self._control.command_head(replace(command, t_ns=self.backend.t_ns))
        for text in head_words(before, self._control.head, command):
            self._say("info", text)

    def _say(self, level: str, text: str) -> None:
        """Report an event; words that cannot be sent must not keep the robot from what it does."""
        try:
            self._put(Event(self.backend.t_ns, level, text))
        except Exception as error:  # noqa: BLE001
            if self._limit.due("event") is not None:
                _log.error("event not sent", text=text, reason=error_words(error))


def command_words(command: RobotCommand) -> str:
    """Return what a command is called."""
    names: dict[type, str] = {
        SetGait: "the gait", SetHead: "the head", Start: "the start", BackUp: "the back-up", Stop: "the stop",
        Drive: "the drive", EStop: "the E-stop", ResetEStop: "the reset",
    }  # fmt: skip
    return names[type(command)]
