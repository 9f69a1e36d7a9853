"""From the operator's head command to the settings that it means."""

import math

from pydantic import ValidationError

from snakeslam.errors import InputError
from snakeslam.gaits.gait import ResolvedGait
from snakeslam.head.catalogue import HEAD_CATALOGUE
from snakeslam.head.laws import check
from snakeslam.head.settings import HeadController, HeadSettings
from snakeslam.messages import HeadCommand
from snakeslam.robot.model import SnakeModel

MOST_STEERING_DEG = 180.0


def commanded_head(command: HeadCommand, current: HeadSettings, model: SnakeModel, gait: ResolvedGait) -> HeadSettings:
    """Return ``current`` with what the command asks for.

    Raises InputError for a controller or a neck that does not exist or cannot be in ``gait``, and for a rotation
    where the controller has no line.
    """
    asked = {"controller": command.controller, "neck_joints": command.neck_joints}
    given = {key: value for key, value in asked.items() if value is not None}
    try:
        settings = HeadSettings.model_validate({**current.model_dump(), **given})
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"head.{'.'.join(map(str, first['loc']))}", first["msg"]) from error
    check(settings, model, gait)
    if command.turn_by_deg is not None:
        check_steering(command.turn_by_deg, settings.controller)
    return settings


def check_steering(turn_by_deg: float, controller: HeadController) -> None:
    """Raise InputError where the head's line cannot be rotated by so much, or not at all."""
    if not (math.isfinite(turn_by_deg) and abs(turn_by_deg) <= MOST_STEERING_DEG):
        raise InputError(
            "head.turn_by_deg", f"cannot be {turn_by_deg}", f"-{MOST_STEERING_DEG:g} to {MOST_STEERING_DEG:g}"
        )
    if not HEAD_CATALOGUE[controller].steers:
        steering = ", ".join(entry.name for entry in HEAD_CATALOGUE.values() if entry.steers)
        raise InputError("head.turn_by_deg", f"with head.controller {controller} there is no line to turn", steering)
