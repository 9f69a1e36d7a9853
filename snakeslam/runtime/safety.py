"""The robot's safety rules as one pure state machine: what is obeyed, and what leaves for the servos.

| rule | where |
|---|---|
| position, rate and acceleration of every target are clamped; no number at all is a hold | ``guard.Guard`` |
| commands: stale (> 300 ms), out of order, from the future, not finite are dropped | ``intake.Intake`` |
| the server's link, or slam's word, lost: hold within .5 s, and until somebody starts it again | ``Watch`` |
| a sensor silent, as slam reports it: the same | ``Watch``, ``sensor_watch`` |
| the robot's own loop stood still for 1 s: hold | ``Safety.turn`` |
| the E-stop latches here; clearing it never moves the robot | ``guard.Guard`` |

Times are the robot's own clock, integer nanoseconds; a sender stamps by that clock as it last heard it (``clock``).
"""

from collections.abc import Mapping

from snakeslam.messages import Float, JointTarget
from snakeslam.robot.limits import JointLimits
from snakeslam.runtime.guard import Guard
from snakeslam.runtime.intake import FUTURE_NS, Intake
from snakeslam.runtime.topics import Command
from snakeslam.runtime.wire import Order

SILENT_NS = 300_000_000
"""A link whose newest beat is older than this is lost. The brake takes .15 s at most: a hold within .45 s."""
FROZEN_NS = 1_000_000_000
FROZEN = "the robot node itself stood still"
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
        self._watch = Watch(required)
        self._intake = Intake()
        self._moving = False
        self._turned_ns: int | None = None

    @property
    def moving(self) -> bool:
        """Whether it was told to move, and nothing has held it since."""
        return self._moving

    @property
    def estop_reason(self) -> str | None:
        """Why the E-stop is latched; None when it is not."""
        return self.guard.reason

    def judge(self, order: Order, command: Command, now_ns: int) -> str | None:
        """Return why ``order`` is dropped; None when it is to be obeyed."""
        return self._intake.judge(order, command, now_ns)

    def beat(self, name: str, stamp_ns: int, now_ns: int) -> None:
        """Take a sign of life of ``name``."""
        self._watch.beat(name, stamp_ns, now_ns)

    def report_missing(self, name: str, missing: str | None) -> None:
        """Note what the required input ``name`` says is missing to it, such as slam's camera; None: nothing."""
        self._watch.report(name, missing)

    def turn(self, now_ns: int) -> None:
        """Tell that the robot's loop gets on; after a freeze the world may be another."""
        if self._moving and self._turned_ns is not None and now_ns - self._turned_ns > FROZEN_NS:
            self.hold(FROZEN)
        self._turned_ns = now_ns

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
        return refusal

    def stop(self) -> None:
        """The operator has told it to come to rest: no input is required any more."""
        self._moving = False

    def hold(self, reason: str) -> None:
        """Ramp to a hold; only a start moves it again."""
        self.guard.hold(reason)
        self._moving = False

    def latch(self, reason: str) -> None:
        """E-stop."""
        self.guard.latch(reason)
        self._moving = False

    def reset(self) -> None:
        """Clear the E-stop; the robot stays where it is."""
        self.guard.reset()

    def step(self, target: JointTarget, now_ns: int, q_measured_rad: Float | None = None) -> JointTarget:
        """Return what the servos get for control's ``target`` at ``now_ns``."""
        if self._moving and (missing := self._watch.lost(now_ns)) is not None:
            self.hold(missing)
        if q_measured_rad is not None:
            self.guard.start_at(q_measured_rad)
        passed = self.guard.step(target)
        if self.guard.held_because is not None:
            self._moving = False
        return passed

    def brake(self, t_ns: int) -> JointTarget | None:
        """Return what the servos get where control has failed: the brake ramp; None where no angles are known yet."""
        self._moving = False
        return self.guard.brake(t_ns)
