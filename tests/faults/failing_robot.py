"""A robot whose servo bus fails now and then: for a few steps at a time, as a cable with a bad contact does."""

from snakeslam.messages import JointTarget, Packet
from snakeslam.runtime.spec import SessionSpec
from tests.server.still_robot import StillRobot

EVERY, FAILING = 300, 5
"""Of so many steps the last few fail."""


class FailingRobot(StillRobot):
    """See the module's docstring."""

    def __init__(self) -> None:
        super().__init__()
        self._calls = 0

    def step(self, target: JointTarget | None) -> list[Packet] | None:
        self._calls += 1
        if self._calls % EVERY >= EVERY - FAILING:
            raise OSError("the servo bus does not answer")
        return super().step(target)


def failing_robot(spec: SessionSpec) -> FailingRobot:
    return FailingRobot()
