"""Settings of the head controllers."""

from typing import Annotated, Literal

from pydantic import Field

from snakeslam.errors import NotBuiltError
from snakeslam.settings import Settings

HeadController = Literal["none", "direction", "position", "predictive"]


class HeadSettings(Settings):
    """How the neck keeps the head still."""

    controller: HeadController = "none"
    neck_joints: Annotated[int, Field(ge=3, le=10)] = 6
    """Yaw joints of the neck."""


def require_built(settings: HeadSettings) -> None:
    """Raise NotBuiltError for a controller that this version does not have."""
    if settings.controller != "none":
        raise NotBuiltError("head.controller", settings.controller, "none")
