"""Between the operator's gait command and the settings that it means."""

from typing import Any

from pydantic import ValidationError

from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import GAITS, GaitSettings
from snakeslam.messages import GaitCommand


def configured_gait(configured: GaitSettings) -> GaitCommand:
    """Return the configured gait, not moving."""
    return GaitCommand(t_ns=0, gait=configured.name, drive=0.0, parameters=configured.given())


def commanded_gait(command: GaitCommand, configured: GaitSettings) -> GaitSettings:
    """Return the command's parameters over the configured ones, which are those of the configured gait only.

    Raises InputError for a gait or a value that does not exist.
    """
    kept: dict[str, Any] = {}
    if command.gait == configured.name:
        kept = configured.given()
        for kind, replaced in GAITS[configured.name].substitutes:
            # Either of the two that set the same thing replaces both.
            if not {kind.key, replaced}.isdisjoint(command.parameters):
                kept = {key: value for key, value in kept.items() if key not in (kind.key, replaced)}
    try:
        return GaitSettings.model_validate({"name": command.gait, **kept, **command.parameters})
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"gait.{'.'.join(map(str, first['loc']))}", first["msg"]) from error
