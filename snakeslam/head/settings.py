"""Settings of the head controllers."""

from typing import Annotated, Literal

from pydantic import Field

from snakeslam.settings import Settings

HeadController = Literal["none", "direction", "position", "predictive"]


LEAST_NECK_JOINTS = 2
MOST_NECK_JOINTS = 12


class HeadSettings(Settings):
    """How the neck keeps the head still."""

    controller: HeadController = "predictive"
    """A gait that a controller is not made for plays as without it: ``head.laws.effect`` says what is in force."""
    neck_joints: Annotated[int, Field(ge=LEAST_NECK_JOINTS, le=MOST_NECK_JOINTS)] | None = None
    """Yaw joints of the neck; None: a third of the robot's, which leaves the body enough to push with, and more only
    where the gait would bend those too far."""
    friction_ratio: Annotated[float, Field(ge=1, le=100)] = 4.0
    """Friction across the body over friction along it, as predictive control supposes it; a wrong one costs little."""
