"""The robot's safety rules as one pure state machine: which commands count, and what the servos get.

| rule | where |
|---|---|
| position, rate and acceleration of every target are limited; a target that is not finite is a hold | `TargetGuard` |
| the E-stop latches; clearing it moves nothing | `TargetGuard` |
| a command that is older than the deadman limit, out of order, from the future or not finite is dropped | `Admission` |
| a start or a drive that was sent before the last hold is dropped | `Safety.refusal` |
| a drive input that is silent for the deadman limit is a hold, and must be released first | `DeadmanInputs` |
| no heartbeat of the server or of slam for the deadman limit is a hold | `Heartbeats` |
| a silent sensor, as slam reports it, is a hold | `Heartbeats`, `sensor_watch` |
| the robot's own loop stood still for 1 s: a hold | `Safety.on_iteration` |

A hold lasts until an operator starts the robot again. Times are integer nanoseconds of the robot's clock; a sender
stamps its messages by that clock as it last read it (`process.clock`).

A scripted run goes through the same state machine, with no required heartbeat, because nothing there can be lost.
"""

from collections.abc import Mapping

from snakeslam.messages import Float, JointTarget
from snakeslam.robot.limits import JointLimits
from snakeslam.runtime.bus.commands import BackUp, Drive, Start
from snakeslam.runtime.bus.wire import SentCommand
from snakeslam.runtime.robot.admission import FUTURE_NS, Admission
from snakeslam.runtime.robot.deadman import DEADMAN_NS, INPUT_SILENT, DeadmanInputs
from snakeslam.runtime.robot.target_guard import TargetGuard

FROZEN_NS = 1_000_000_000
"""A loop of 10 ms that made no iteration for this long was frozen: its process was stopped, or the machine."""
FROZEN = "the robot node itself stood still for more than 1 s"
BEFORE_THE_HOLD = "it was sent before the robot was held"
LATCHED = "the E-stop is latched"
SERVER, SLAM = "server", "slam"
LOST = {SERVER: "the link to the operator's server is lost", SLAM: "the estimator is silent"}


class Heartbeats:
    """The processes that must be alive for the robot to move, and when each was last alive by its own stamps.

    ``reasons`` maps each required process to what the operator is told when it is lost.
    """

    def __init__(self, reasons: Mapping[str, str]) -> None:
        self._reasons = dict(reasons)
        self._newest_ns: dict[str, int] = {}
        self._missing: dict[str, str | None] = {}

    def add(self, name: str, stamp_ns: int, now_ns: int) -> None:
        """Add a heartbeat by its stamp, so that one that was long on its way counts as old; ignore a future one."""
        if stamp_ns <= now_ns + FUTURE_NS:
            self._newest_ns[name] = max(stamp_ns, self._newest_ns.get(name, stamp_ns))

    def set_missing(self, name: str, missing: str | None) -> None:
        """Set which input the process ``name`` reports as missing, in words; None when it has all."""
        self._missing[name] = missing

    def lost(self, now_ns: int) -> str | None:
        """Return in words what the robot may not move without and is missing at ``now_ns``; None when nothing is."""
        for name, reason in self._reasons.items():
            newest_ns = self._newest_ns.get(name)
            if newest_ns is None or now_ns - newest_ns > DEADMAN_NS:
                return reason
        return next((missing for name in self._reasons if (missing := self._missing.get(name)) is not None), None)


class Safety:
    """All rules together; ``required`` names the processes that must be alive for the robot to move, with reasons."""

    def __init__(self, limits: JointLimits, required: Mapping[str, str], estop_reason: str | None = None) -> None:
        self._guard = TargetGuard(limits, estop_reason)
        self._inputs = DeadmanInputs()
        self._heartbeats = Heartbeats(required)
        self._admission = Admission()
        self._moving = False
        self._iteration_ns: int | None = None
        self._now_ns: int | None = None
        self._held_ns: int | None = None

    @property
    def moving(self) -> bool:
        """Whether the robot was started or driven, and nothing has stopped or held it since."""
        return self._moving

    @property
    def estop_reason(self) -> str | None:
        """Why the E-stop is latched; None when it is not."""
        return self._guard.estop_reason

    @property
    def held_because(self) -> str | None:
        """Why the robot is held until it is started again; None when it is not."""
        return self._guard.held_because

    def refusal(self, sent: SentCommand, now_ns: int) -> str | None:
        """Return why ``sent`` is dropped; None when it is admitted."""
        command, refusal = sent.command, self._admission.refusal(sent, now_ns)
        moves = isinstance(command, Start | BackUp) or (isinstance(command, Drive) and command.drive != 0.0)
        if refusal is None and moves and self._held_ns is not None and sent.stamp_ns < self._held_ns:
            return BEFORE_THE_HOLD
        return refusal

    def on_heartbeat(self, name: str, stamp_ns: int, now_ns: int) -> None:
        """Add a heartbeat of the process ``name``, stamped ``stamp_ns``, that arrives at ``now_ns``."""
        self._heartbeats.add(name, stamp_ns, now_ns)

    def set_missing(self, name: str, missing: str | None) -> None:
        """Set which input the process ``name`` reports as missing, such as slam's camera; None when it has all."""
        self._heartbeats.set_missing(name, missing)

    def on_iteration(self, clock_ns: int, now_ns: int | None = None) -> None:
        """Note an iteration of the robot's loop at ``clock_ns`` of the node's clock; hold the robot after a freeze.

        ``now_ns`` is the robot's time (None: the same). Whatever was sent before the end of a freeze moves nothing.
        """
        self._now_ns = clock_ns if now_ns is None else now_ns
        if self._iteration_ns is not None and clock_ns - self._iteration_ns > FROZEN_NS:
            self._held_ns = self._now_ns
            if self._moving:
                self.hold(FROZEN)
        self._iteration_ns = clock_ns

    def lost(self, now_ns: int) -> str | None:
        """Return in words which required input is missing at ``now_ns``; None when all are there."""
        return self._heartbeats.lost(now_ns)

    def start_refusal(self, now_ns: int) -> str | None:
        """Return why the robot may not be started at ``now_ns``; None when it may."""
        return LATCHED if self.estop_reason is not None else self._heartbeats.lost(now_ns)

    def start(self, now_ns: int) -> str | None:
        """Let the robot move, from a hold too; return why it may not."""
        refusal = self.start_refusal(now_ns)
        if refusal is None:
            self._guard.resume()
            self._moving = True
            self._inputs.start()
        return refusal

    def drive_refusal(self, name: str, begins: bool, now_ns: int) -> str | None:
        """Return why a drive of the deadman input ``name`` is refused, which ends its press; None when it may move."""
        refusal = self._inputs.refusal(name, begins) or self.start_refusal(now_ns)
        if refusal is not None:
            if self._moving and self._inputs.moves(name):
                self.hold(refusal)  # Otherwise the robot would go on although its input no longer counts.
            self._inputs.refuse(name)
        return refusal

    def drive(self, name: str, now_ns: int) -> None:
        """Let the robot move by the deadman input ``name``, after ``drive_refusal``, for as long as it is renewed."""
        if not self._moving:
            self.start(now_ns)
        self._inputs.press(name, now_ns)

    def release(self, name: str) -> None:
        """Note that the deadman input ``name`` was released."""
        self._inputs.release(name)

    def stop(self) -> None:
        """Note that the operator stopped the robot: nothing is required any more, and an input must be released."""
        self._inputs.end_press()
        self._moving = False

    def hold(self, reason: str) -> None:
        """Brake to a stop and hold; only a start or a new press moves the robot again."""
        self._guard.hold(reason)
        self._note_hold()

    def latch(self, reason: str) -> None:
        """Latch the E-stop: brake to a stop and hold."""
        self._guard.latch(reason)
        self._note_hold()

    def _note_hold(self) -> None:
        self._inputs.end_press()
        self._moving, self._held_ns = False, self._now_ns

    def reset(self) -> None:
        """Clear the E-stop; the robot stays held."""
        self._guard.reset()

    def step(self, target: JointTarget, now_ns: int, q_measured_rad: Float | None = None) -> JointTarget:
        """Return what the servos get in place of control's ``target`` at ``now_ns``; hold where a rule demands it."""
        self._now_ns = now_ns
        if self._moving and (missing := self._heartbeats.lost(now_ns)) is not None:
            self.hold(missing)
        if self._inputs.silent(now_ns):
            self.hold(INPUT_SILENT)
        if q_measured_rad is not None:
            self._guard.start_at(q_measured_rad)
        passed = self._guard.step(target)
        if self._moving and self._guard.held_because is not None:
            self._note_hold()  # The guard itself held the robot: the target was not finite.
        return passed

    def brake(self, t_ns: int) -> JointTarget | None:
        """Return the brake ramp's next target, for when control failed; None while no angles are known."""
        return self._guard.brake(t_ns)
