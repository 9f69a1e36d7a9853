"""The robot's safety rules as one pure state machine: what is obeyed, and what leaves for the servos.

| rule | where |
|---|---|
| position, rate and acceleration of every target are clamped; no number at all is a hold | ``guard.Guard`` |
| commands: stale (> 300 ms), out of order, from the future, not finite are dropped | ``intake.Intake`` |
| the server's link, or slam's word, lost: hold within .5 s, and until somebody starts it again | ``Watch`` |
| a sensor silent, as slam reports it: the same | ``Watch``, ``sensor_watch`` |
| the robot's own loop stood still for 1 s: hold | ``Safety.turn`` |
| a start or drive that was sent before the last hold is dropped | ``Safety.judge`` |
| the hand silent for 300 ms: hold; a press that was held must be let go first | ``driving.Driving`` |
| the E-stop latches here; clearing it never moves the robot | ``guard.Guard`` |

Times are the robot's own clock, integer nanoseconds; a sender stamps by that clock as it last heard it (``clock``).
"""

from collections.abc import Mapping

from snakeslam.messages import Float, JointTarget
from snakeslam.robot.limits import JointLimits
from snakeslam.runtime.bus.commands import BackUp, Drive, Start
from snakeslam.runtime.bus.wire import Order
from snakeslam.runtime.robot.driving import SILENT_HAND, Driving
from snakeslam.runtime.robot.guard import Guard
from snakeslam.runtime.robot.intake import FUTURE_NS, Intake

SILENT_NS = 300_000_000
"""A link whose newest beat is older than this is lost. The brake takes .15 s at most: a hold within .45 s."""
FROZEN_NS = 1_000_000_000
FROZEN = "the robot node itself stood still"
BEFORE_THE_HOLD = "it was sent before the robot was held"
SERVER, SLAM = "server", "slam"
LOST = {SERVER: "the link to the operator's server is lost", SLAM: "the estimator is silent"}


class Watch:
    """The inputs without which the robot may not move, and when each was last alive by its own stamps."""

    def __init__(self, words: Mapping[str, str]) -> None:
        self._words = dict(words)
        self._newest_ns: dict[str, int] = {}
        self._missing: dict[str, str | None] = {}

    def beat(self, name: str, stamp_ns: int, now_ns: int) -> None:
        """Take a beat; one from the future proves nothing, and an old one no more than it says."""
        if stamp_ns <= now_ns + FUTURE_NS:
            self._newest_ns[name] = max(stamp_ns, self._newest_ns.get(name, stamp_ns))

    def report(self, name: str, missing: str | None) -> None:
        """Note what ``name`` says is missing to it, in words; None where nothing is."""
        self._missing[name] = missing

    def lost(self, now_ns: int) -> str | None:
        """Return what is missing, in words; None when nothing is."""
        for name, words in self._words.items():
            newest_ns = self._newest_ns.get(name)
            if newest_ns is None or now_ns - newest_ns > SILENT_NS:
                return words
        return next((words for name in self._words if (words := self._missing.get(name)) is not None), None)


class Safety:
    """Every rule together; ``required`` names the inputs that must be alive for the robot to move."""

    def __init__(self, limits: JointLimits, required: Mapping[str, str], estop_reason: str | None = None) -> None:
        self.guard = Guard(limits, estop_reason)
        self.driving = Driving()
        self._watch = Watch(required)
        self._intake = Intake()
        self._moving = False
        self._turned_ns: int | None = None
        self._now_ns: int | None = None
        self._held_ns: int | None = None

    @property
    def moving(self) -> bool:
        """Whether it was told to move, and nothing has held it since."""
        return self._moving

    @property
    def estop_reason(self) -> str | None:
        """Why the E-stop is latched; None when it is not."""
        return self.guard.reason

    def judge(self, order: Order, now_ns: int) -> str | None:
        """Return why ``order`` is dropped; None when it is to be obeyed."""
        command, refusal = order.command, self._intake.judge(order, now_ns)
        moves = isinstance(command, Start | BackUp) or (isinstance(command, Drive) and command.drive != 0.0)
        if refusal is None and moves and self._held_ns is not None and order.stamp_ns < self._held_ns:
            return BEFORE_THE_HOLD
        return refusal

    def beat(self, name: str, stamp_ns: int, now_ns: int) -> None:
        """Take a sign of life of ``name``."""
        self._watch.beat(name, stamp_ns, now_ns)

    def report_missing(self, name: str, missing: str | None) -> None:
        """Note what the required input ``name`` says is missing to it, such as slam's camera; None: nothing."""
        self._watch.report(name, missing)

    def turn(self, clock_ns: int, now_ns: int | None = None) -> None:
        """Note that the robot's loop gets on, at ``clock_ns`` of the node's clock; after a freeze the robot is held.

        ``now_ns`` is the robot's time (None: the same). What was sent before the end of a freeze moves nothing.
        """
        self._now_ns = clock_ns if now_ns is None else now_ns
        if self._turned_ns is not None and clock_ns - self._turned_ns > FROZEN_NS:
            self._held_ns = self._now_ns
            if self._moving:
                self.hold(FROZEN)
        self._turned_ns = clock_ns

    def lost(self, now_ns: int) -> str | None:
        """Return which required input is missing, in words."""
        return self._watch.lost(now_ns)

    def may_start(self, now_ns: int) -> str | None:
        """Return why a start is refused; None when it may be."""
        return "the E-stop is latched" if self.guard.reason is not None else self._watch.lost(now_ns)

    def start(self, now_ns: int) -> str | None:
        """Move again, from wherever it is held; return why not, if so."""
        refusal = self.may_start(now_ns)
        if refusal is None:
            self.guard.resume()
            self._moving = True
            self.driving.start()
        return refusal

    def may_drive(self, hand: str, begins: bool, now_ns: int) -> str | None:
        """Return why this hand's drive is refused, which ends its press; None when it may be."""
        refusal = self.driving.refusal(hand, begins) or self.may_start(now_ns)
        if refusal is not None:
            if self._moving and self.driving.drives(hand):
                self.hold(refusal)  # else it would go on with nobody's hand on the drive
            self.driving.refuse(hand)
        return refusal

    def drive(self, hand: str, now_ns: int) -> None:
        """Move by this hand's press, after ``may_drive``, for as long as it is repeated."""
        if not self._moving:
            self.start(now_ns)
        self.driving.press(hand, now_ns)

    def stop(self) -> None:
        """The operator has stopped it: no input is required any more, and a hand must let go before it drives again."""
        self.driving.hold()
        self._moving = False

    def hold(self, reason: str) -> None:
        """Ramp to a hold; only a start or a new press moves it again."""
        self.guard.hold(reason)
        self._note_hold()

    def _note_hold(self) -> None:
        self.driving.hold()
        self._moving, self._held_ns = False, self._now_ns

    def latch(self, reason: str) -> None:
        """E-stop."""
        self.guard.latch(reason)
        self._note_hold()

    def reset(self) -> None:
        """Clear the E-stop; the robot stays where it is."""
        self.guard.reset()

    def step(self, target: JointTarget, now_ns: int, q_measured_rad: Float | None = None) -> JointTarget:
        """Return what the servos get for control's ``target`` at ``now_ns``."""
        self._now_ns = now_ns
        if self._moving and (missing := self._watch.lost(now_ns)) is not None:
            self.hold(missing)
        if self.driving.silent(now_ns):
            self.hold(SILENT_HAND)
        if q_measured_rad is not None:
            self.guard.start_at(q_measured_rad)
        passed = self.guard.step(target)
        if self._moving and self.guard.held_because is not None:
            self._note_hold()
        return passed

    def brake(self, t_ns: int) -> JointTarget | None:
        """Return what the servos get where control has failed: the brake ramp; None where no angles are known yet."""
        return self.guard.brake(t_ns)
