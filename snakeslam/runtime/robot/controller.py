"""The robot's control loop of 100 Hz: operator's commands, control, safety, governor and backend; without a bus.

The same in a scripted run and in the robot node. Times named ``now_ns`` are the robot's (`robot.time`), stamps are of
the node's clock.
"""

from collections.abc import Callable, Mapping, Sequence
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
    GaitCommand,
    GroundTruth,
    HeadCommand,
    ImuSample,
    JointState,
    JointTarget,
    Packet,
    PoseEstimate,
    check_packet,
)
from snakeslam.runtime.bus.commands import BackUp, Drive, EStop, ResetEStop, RobotCommand, SetGait, SetHead, Start, Stop
from snakeslam.runtime.bus.topics import Event, RobotState
from snakeslam.runtime.bus.wire import Estimate, SentCommand
from snakeslam.runtime.process.log_limit import LogLimit, error_words
from snakeslam.runtime.process.pacing import Pacer
from snakeslam.runtime.robot.answers import Answers
from snakeslam.runtime.robot.blindness import Blindness
from snakeslam.runtime.robot.deadman import INPUT_SILENT
from snakeslam.runtime.robot.descriptions import describe_command, describe_head_change
from snakeslam.runtime.robot.governor import build_governor
from snakeslam.runtime.robot.safety import LOST, Safety
from snakeslam.runtime.robot.target_guard import STEP_S

_log = structlog.get_logger("robot")
UNSEEN_S = 1.0
"""The most motion that no estimate covers after slam fell silent: until that is noticed and the robot has braked."""


@dataclass(frozen=True, slots=True)
class Step:
    """One control period: the target that the servos got, and the packets and the truth that the backend gave."""

    target: JointTarget | None
    packets: Sequence[Packet]
    truth: Sequence[GroundTruth]


class RobotController:
    """Steps the backend with control's targets, as far as safety lets them through.

    ``on_event`` gets what the operator should read. ``required`` names the processes without whose heartbeat the robot
    does not move. With ``autostart`` the gait starts by itself once they are alive and ``run.rest_s`` is over.
    """

    def __init__(
        self,
        config: Config,
        backend: Backend,
        control: Control,
        on_event: Callable[[Event], None],
        *,
        boot: str = "",
        required: Mapping[str, str] = LOST,
        estop_reason: str | None = None,
        autostart: bool = False,
    ) -> None:
        assert backend.model is not None
        self.backend, self.boot = backend, boot
        self.t_start_ns = backend.t_ns
        self._model, self._control, self._on_event = backend.model, control, on_event
        self.safety = Safety(self._model.limits, required, estop_reason)
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
        """The newest pose there was, also while slam has none."""
        self._steps_without_pose = 0
        self._pose: PoseEstimate | None = None
        self._imu: ImuSample | None = None
        self._joints: JointState | None = None
        self._target: JointTarget | None = None
        self._reported_hold: str | None = None
        self._estop_reported = estop_reason is not None
        self._limit = LogLimit()
        self._update_gait_facts()

    @property
    def joint_count(self) -> int:
        """How many joints the robot has."""
        return self._model.joint_count

    def on_command(self, sent: SentCommand, now_ns: int) -> str | None:
        """Obey the command of ``sent`` at once, or return why not; the next joint target already obeys it.

        An error while obeying is a hold, and the answer says so.
        """
        command = sent.command
        if isinstance(command, Drive):
            command = structs.replace(command, deadman=f"{sent.sender}/{command.deadman}")
        try:
            refusal = self.safety.refusal(sent, now_ns) or self.obey(command, now_ns)
        except Exception as error:  # noqa: BLE001
            self.fault(describe_command(command), error)
            refusal = f"it failed: {error_words(error)}"
        self._answers.add(sent, refusal)
        # A drive is repeated many times a second, and its sender gets the refusal as an answer anyway.
        if refusal is not None and not isinstance(command, Drive):
            self._report("error", f"{describe_command(command)} refused: {refusal}")
        return refusal

    def obey(self, command: RobotCommand, now_ns: int) -> str | None:
        """Do what is commanded; return why it cannot be done, and change nothing then."""
        try:
            return self._obey(command, now_ns)
        except InputError as error:
            return str(error)

    def _obey(self, command: RobotCommand, now_ns: int) -> str | None:
        match command:
            case EStop(reason):
                self.estop(reason)
            case ResetEStop():
                self._reset_estop()
            case SetGait(gait):
                self._command_gait(self._gait.drive, gait)
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

    def on_estimate(self, estimate: Estimate) -> None:
        """Use slam's estimate at an image for head control, governor and blindness; ignore those of an earlier boot."""
        if estimate.boot != self.boot:
            return
        self._pose, self.last_pose = estimate.pose, estimate.pose or self.last_pose
        if estimate.pose is not None:
            self._steps_without_pose = 0
        self._blindness.add(estimate.t_ns, estimate.health)
        if self._governor is not None:
            self._control.throttle = self._governor.step(estimate.t_ns, estimate.health).pace

    @property
    def last_pose_holds(self) -> bool:
        """Whether the robot has not moved since ``last_pose`` by more than braking takes."""
        return self._steps_without_pose * STEP_S <= UNSEEN_S

    def step(self, now_ns: int) -> Step | None:
        """Advance one control period; None at the end of the backend."""
        if self._autostart_ns is not None and self.backend.t_ns >= self._autostart_ns:
            self._autostart(now_ns)
        self._check_sight()
        self._steps_without_pose += self.safety.moving
        target = self._target = self._next_target(now_ns)
        self._report_hold()
        packets = self.backend.step(target)
        if packets is None:
            return None
        for packet in packets:
            check_packet(packet)
            if isinstance(packet, ImuSample):
                self._imu = packet
            elif isinstance(packet, JointState):
                self._joints = packet
        return Step(target, packets, self.backend.read_ground_truth())

    def hold(self, reason: str) -> None:
        """Brake to a stop and hold, as at the end of the node."""
        self.safety.hold(reason)
        self._autostart_ns = None

    def fault(self, what: str, error: Exception) -> None:
        """Hold the robot because ``what`` has failed, and report it; never raises, so that the brake ramp goes out."""
        reason = f"{what} failed: {error_words(error)}"
        newly_held = self.safety.held_because is None
        self.hold(reason)
        left_out = self._limit.due(what)
        if left_out is None:
            return
        _log.error("held", reason=reason, left_out=left_out, exc_info=error)
        if not newly_held:  # A new hold is itself reported, at the next step.
            self._report("error", reason)

    def estop(self, reason: str) -> None:
        """Latch the E-stop, then command control to stop and report it."""
        self.safety.latch(reason)
        self._autostart_ns = None
        if self._estop_reported:
            return
        self._estop_reported = True
        self._blindness.end_back_up()
        self._reported_hold = self.safety.held_because
        self._report("error", f"E-stop: {reason}")
        self._command_gait(0.0)

    def state(self, now_ns: int) -> RobotState:
        """Return the newest state, stamped ``now_ns`` of the node's clock."""
        return RobotState(
            boot=self.boot,
            stamp_ns=now_ns,
            t_start_ns=self.t_start_ns,
            t_ns=self.backend.t_ns,
            moving=self.safety.moving,
            estop_reason=self.safety.estop_reason,
            held_because=self.safety.held_because,
            gait=self._gait if self.safety.moving else replace(self._gait, drive=0.0),
            head_settings=self._control.head,
            notice=self._notice,
            period_s=self._period_s,
            realtime_factor=self.pacer.realtime_factor,
            q_target_rad=None if self._target is None else self._target.q_rad,
            q_measured_rad=None if self._joints is None else self._joints.q_rad,
            governed=None if self._governor is None else self._governor.now,
            back_up_offered=self._blindness.held and not self.safety.moving and self.safety.estop_reason is None,
            answers=self._answers.all(),
        )

    def _next_target(self, now_ns: int) -> JointTarget | None:
        """Return what the servos get: control's target as safety lets it through; the brake ramp if control fails."""
        try:
            target = self._control.step(self.backend.t_ns, self._joints, self._pose, self._imu)
            if target.q_rad.shape != (self._model.joint_count,):
                raise ValueError(f"targets of shape {target.q_rad.shape} for {self._model.joint_count} joints")
            measured = None if self._joints is None else self._joints.q_rad
            return self.safety.step(target, now_ns, measured)
        except Exception as error:  # noqa: BLE001
            self.fault("control", error)
            return self.safety.brake(self.backend.t_ns)

    def _reset_estop(self) -> None:
        self._estop_reported = False
        if self.safety.estop_reason is not None:
            self.safety.reset()
            self._report("info", "E-stop cleared; start to move again")

    def _autostart(self, now_ns: int) -> None:
        if self.safety.start_refusal(now_ns) is None:
            self._start(now_ns)

    def _start(self, now_ns: int) -> str | None:
        self._autostart_ns = None
        was_moving = self.safety.moving
        refusal = self.safety.start(now_ns)
        if refusal is None:
            self._reported_hold = None
            self._command_gait(1.0)
            if not was_moving or self._blindness.backs_up:
                self._blindness.start(self.backend.t_ns)
                self._report("info", f"start {self._gait.gait}")
        return refusal

    def _back_up(self, now_ns: int) -> str | None:
        """Play the gait backwards for a while at the operator's request; blindness does not hold it meanwhile."""
        self._autostart_ns = None
        refusal = self.safety.start(now_ns)
        if refusal is None:
            self._reported_hold = None
            self._blindness.back_up(self.backend.t_ns)
            self._command_gait(-1.0)
            self._report("info", "back up")
        return refusal

    def _check_sight(self) -> None:
        """Hold a robot that has moved blind for too long; end a back-up that has lasted its time."""
        if self.safety.moving and self._blindness.too_long(self.backend.t_ns):
            self._blindness.hold()
            self.safety.hold(self._blindness.reason)
        elif self._blindness.backed_up(self.backend.t_ns):
            self._stop()

    def _drive(self, command: Drive, now_ns: int) -> str | None:
        """Move as a deadman input commands, for as long as it is renewed; a drive of 0 releases it."""
        self._autostart_ns = None
        if command.drive == 0.0:
            self.safety.release(command.deadman)
            self._stop(command.turn)
            return None
        refusal = self.safety.drive_refusal(command.deadman, command.begins, now_ns)
        if refusal is not None:
            return refusal
        if (command.drive, command.turn) != (self._gait.drive, self._gait.turn):
            self._command_gait(command.drive, replace(self._gait, turn=command.turn))
        if not self.safety.moving or self._blindness.backs_up:
            self._reported_hold = None
            self._blindness.start(self.backend.t_ns)
            self._report("info", f"start {self._gait.gait}")
        self.safety.drive(command.deadman, now_ns)
        return None

    def _stop(self, turn: float | None = None) -> None:
        """Command a drive of zero, with the steering ``turn`` (None: unchanged)."""
        self._autostart_ns = None
        was_moving = self.safety.moving
        self._blindness.end_back_up()
        self.safety.stop()
        self._command_gait(0.0, replace(self._gait, turn=self._gait.turn if turn is None else turn))
        if was_moving:
            self._report("info", "stop")

    def _report_hold(self) -> None:
        """Report a hold that safety began, and command control to stop too."""
        held = self.safety.held_because
        if held is None or held == self._reported_hold:
            return
        self._reported_hold = held
        self._blindness.end_back_up()
        self._report("error", f"held: {held}; start to move again")
        try:
            # The steering of a deadman input ends with the input.
            self._command_gait(0.0, replace(self._gait, turn=0.0) if held == INPUT_SILENT else None)
        except Exception as error:  # noqa: BLE001
            self.fault("control", error)

    def _command_gait(self, drive: float, gait: GaitCommand | None = None) -> None:
        """Command ``gait`` (None: the present one) at ``drive``; InputError, and no change, if it cannot be done."""
        gait = replace(gait or self._gait, t_ns=self.backend.t_ns, drive=drive)
        self._control.command(gait)
        self._gait = gait
        self._update_gait_facts()

    def _update_gait_facts(self) -> None:
        """Compute the gait's period, and what the operator should know of the gait."""
        gait = self._control.commanded
        self._notice = gait.notice
        self._period_s = 2.0 * np.pi / gait.omega

    def _set_head(self, command: HeadCommand) -> None:
        before = self._control.head
        self._control.command_head(replace(command, t_ns=self.backend.t_ns))
        for text in describe_head_change(before, self._control.head, command):
            self._report("info", text)

    def _report(self, level: str, text: str) -> None:
        """Report an event; one that cannot be sent must not keep the robot from obeying."""
        try:
            self._on_event(Event(self.backend.t_ns, level, text))
        except Exception as error:  # noqa: BLE001
            if self._limit.due("event") is not None:
                _log.error("event not sent", text=text, reason=error_words(error))
