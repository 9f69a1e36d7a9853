"""Settings of the head controllers."""

from typing import Annotated, Literal

from pydantic import Field

from snakeslam.errors import InputError, NotBuiltError
from snakeslam.gaits.catalogue import ResolvedGait
from snakeslam.robot.model import SnakeModel
from snakeslam.settings import Settings

HeadController = Literal["none", "direction", "position", "predictive"]

LEAST_NECK_JOINTS = 3
MOST_NECK_JOINTS = 10


class HeadSettings(Settings):
    """How the neck keeps the head still."""

    controller: HeadController = "none"
    neck_joints: Annotated[int, Field(ge=LEAST_NECK_JOINTS, le=MOST_NECK_JOINTS)] = 6
    """Yaw joints of the neck."""


def require_built(settings: HeadSettings) -> None:
    """Raise NotBuiltError for a controller that this version does not have."""
    if settings.controller != "none":
        raise NotBuiltError("head.controller", settings.controller, "none")


def most_neck_joints(model: SnakeModel) -> int:
    """Return the largest number of yaw joints that leaves ``model`` a body to move with."""
    return min(MOST_NECK_JOINTS, (model.joint_count - 1) // 2)


def check(settings: HeadSettings, model: SnakeModel, gait: ResolvedGait) -> None:
    """Raise InputError where ``model`` cannot hold its head by ``settings`` in ``gait``."""
    del gait
    require_built(settings)
    most = most_neck_joints(model)
    if settings.neck_joints > most:
        raise InputError(
            "head.neck_joints", f"{settings.neck_joints} yaw joints are too many for {model.name}", f"at most {most}"
        )
