"""The operator's hand on the drive as the robot knows it; pure, with the time told."""

SILENT_NS = 300_000_000
"""A robot that is driven by hand is held when the hand has been silent for so long."""
SILENT_HAND = "the drive input fell silent"
LET_GO_FIRST = "the robot was held while it was driven: let go of the drive first"


class Driving:
    """What the hand asks for must be repeated; a hand that was on the drive in a hold must let go before it counts."""

    def __init__(self) -> None:
        self._newest_ns: int | None = None
        self._must_let_go = False

    def refusal(self) -> str | None:
        """Return why the hand may not set the robot moving; None when it may."""
        return LET_GO_FIRST if self._must_let_go else None

    def drive(self, now_ns: int) -> None:
        """The hand moves the robot."""
        self._newest_ns = now_ns

    def end(self) -> None:
        """The hand has let go, or something else moves or stops the robot."""
        self._newest_ns, self._must_let_go = None, False

    def hold(self) -> None:
        """The robot is held."""
        self._must_let_go = self._must_let_go or self._newest_ns is not None
        self._newest_ns = None

    def silent(self, now_ns: int) -> bool:
        """Whether the hand moves the robot but has said nothing for too long."""
        return self._newest_ns is not None and now_ns - self._newest_ns > SILENT_NS
