"""Whose press of the drive may move the robot, and who must let go first; pure, with the time given.

Here, in the robot node's safety, is the only place where this is decided. A *hand* is one drive input: the socket of a
page, a script. Its *press* lasts from the first order with a drive that is not zero to the next zero.

| event | the press that moves the robot | the others |
|---|---|---|
| an order that begins a press, or follows a zero of its hand | this one | must let go |
| a zero | none | this hand has let go |
| a hold, an E-stop, a stop, silence of the hand | none; it must let go | as before |
| this node was started again | none | must let go: only their senders know since when they press |
"""

from collections import OrderedDict

SILENT_NS = 300_000_000
"""A robot that is driven by hand is held when the hand has been silent for so long."""
SILENT_HAND = "the drive input fell silent"
LET_GO_FIRST = "the drive was held down while the robot was held or started again: let go of it first"
HANDS_KEPT = 64


class Driving:
    """See the module's table."""

    def __init__(self) -> None:
        self._hand: str | None = None
        self._newest_ns: int | None = None
        self._let_go: OrderedDict[str, None] = OrderedDict()

    def refusal(self, hand: str, begins: bool) -> str | None:
        """Return why this hand may not move the robot; None when it may."""
        return None if begins or hand == self._hand or hand in self._let_go else LET_GO_FIRST

    def drives(self, hand: str) -> bool:
        """Whether it is this hand that moves the robot."""
        return hand == self._hand

    def press(self, hand: str, now_ns: int) -> None:
        """This hand moves the robot, at ``now_ns`` in the robot's time."""
        self._let_go.pop(hand, None)
        self._hand, self._newest_ns = hand, now_ns

    def refuse(self, hand: str) -> None:
        """A press of this hand was refused: it must not begin by itself when the reason has gone."""
        self._let_go.pop(hand, None)
        if hand == self._hand:
            self.hold()

    def let_go(self, hand: str) -> None:
        """This hand has let go; the robot comes to rest, whoever drove it."""
        self.hold()
        self._let_go[hand] = None
        while len(self._let_go) > HANDS_KEPT:
            self._let_go.popitem(last=False)

    def hold(self) -> None:
        """The robot is held or stopped: the press that moved it moves it no more."""
        self._hand = self._newest_ns = None

    def start(self) -> None:
        """A start moves the robot now: it needs no hand, but the one that drives may go on."""
        self._newest_ns = None

    def silent(self, now_ns: int) -> bool:
        """Whether a hand moves the robot but has said nothing for too long."""
        return self._newest_ns is not None and now_ns - self._newest_ns > SILENT_NS
