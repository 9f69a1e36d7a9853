"""Between the operator's gait command and the settings that it means."""

from pydantic import ValidationError

from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import GaitSettings
from snakeslam.messages import GaitCommand


def configured_gait(configured: GaitSettings) -> GaitCommand:
    """Return the configured gait at rest."""
    return GaitCommand(
        t_ns=0,
        gait=configured.name,
        drive=0.0,
        alpha_pi=configured.alpha_pi,
        wavelength_joints=configured.wavelength_joints,
        period_s=configured.period_s,
        amplitude_deg=configured.amplitude_deg,
    )


def commanded_gait(command: GaitCommand, configured: GaitSettings) -> GaitSettings:
    """Return the command's parameters over the configured ones, which are those of the configured gait only.

    Raises InputError for a gait or a value that does not exist.
    """
    asked = {
        "alpha_pi": command.alpha_pi,
        "wavelength_joints": command.wavelength_joints,
        "period_s": command.period_s,
        "amplitude_deg": command.amplitude_deg,
    }
    given = {key: value for key, value in asked.items() if value is not None}
    kept = configured.model_dump() if command.gait == configured.name else {"name": command.gait}
    if "alpha_pi" in given or "amplitude_deg" in given:
        kept.pop("alpha_pi", None)
        kept.pop("amplitude_deg", None)
    try:
        return GaitSettings.model_validate({**kept, **given})
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"gait.{'.'.join(map(str, first['loc']))}", first["msg"]) from error
