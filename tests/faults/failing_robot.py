"""A robot whose servo bus fails for a few steps each time that it has moved some way, as a cable with a bad contact."""

from snakeslam.messages import JointTarget, Packet
from snakeslam.runtime.spec import SessionSpec
from tests.server.still_robot import StillRobot

EVERY_RAD, FAILING = 0.5, 5


class FailingRobot(StillRobot):
    """See the module's docstring."""

    def __init__(self) -> None:
        super().__init__()
        self._next_rad, self._failures = EVERY_RAD, 0

    def step(self, target: JointTarget | None) -> list[Packet] | None:
        if self._moved_rad >= self._next_rad:
            self._failures += 1
            if self._failures <= FAILING:
                raise OSError("the servo bus does not answer")
            self._next_rad, self._failures = self._moved_rad + EVERY_RAD, 0
        return super().step(target)


def failing_robot(spec: SessionSpec) -> FailingRobot:
    return FailingRobot()
