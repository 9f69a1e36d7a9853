"""Settings of the head controllers."""

from typing import Annotated, Literal

from pydantic import Field

from snakeslam.gaits.catalogue import GAITS, name_list
from snakeslam.settings import Settings

HeadController = Literal["none", "direction", "position", "predictive"]


LEAST_NECK_JOINTS = 2
MOST_NECK_JOINTS = 12


def _controllers() -> str:
    """Return what the controllers do, and in which gaits."""
    line, level, carried = (
        name_list([gait.name for gait in GAITS.values() if gait.head_form == form], "and")
        for form in ("line", "level", "carried")
    )
    return (
        "none; direction: an arc of the neck keeps the head's heading; position: two arcs keep its position as well; "
        "predictive: a model of the whole body and feedback keep the head on a line "
        f"({line}), or level and looking ahead ({level}). In {carried} the gait's own phase carries the head, and this "
        "has no effect."
    )


class HeadSettings(Settings):
    """How the neck keeps the head still."""

    controller: Annotated[HeadController, Field(description=_controllers())] = "predictive"
    neck_joints: Annotated[int, Field(ge=LEAST_NECK_JOINTS, le=MOST_NECK_JOINTS)] | None = None
    """Yaw joints of the neck; null: a third of the robot's (sim35: 6, orthogonal24: 4), more where the gait would bend
    those too far."""
    friction_ratio: Annotated[float, Field(ge=1, le=100)] = 4.0
    """Friction across the body over friction along it, as predictive control supposes it; a wrong one costs little."""
