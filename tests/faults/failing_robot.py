"""A robot whose servo bus fails for a few steps each time that it has moved some way, as a cable with a bad contact."""

from typing import Any

import numpy as np

from snakeslam.control import Control
from snakeslam.messages import JointTarget, Packet
from snakeslam.runtime.assembly.spec import SessionSpec
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


def failing_control(spec: SessionSpec) -> StillRobot:
    """Return a robot that obeys, and have this process's control fail for a few steps each time it has moved some way.

    It gives targets that are no numbers and raises, by turns.
    """
    robot, step = StillRobot(), Control.step
    count = 0

    def fail(control: Control, t_ns: int, *given: Any) -> JointTarget:
        nonlocal count
        target = step(control, t_ns, *given)
        if robot._moved_rad < EVERY_RAD * (count // FAILING + 1):
            return target
        count += 1
        if (count - 1) // FAILING % 2:
            raise FloatingPointError("overflow")
        return JointTarget(t_ns, np.full_like(target.q_rad, np.nan))

    Control.step = fail  # type: ignore[method-assign]
    return robot
