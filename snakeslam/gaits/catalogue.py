"""The five gaits of the house, their parameters and defaults, and the step from settings to Eq. (1)-(2)."""

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from snakeslam.errors import InputError
from snakeslam.gaits import serpenoid
from snakeslam.gaits.parametric import ParametricGait
from snakeslam.robot.model import SnakeModel
from snakeslam.settings import Settings

GaitName = Literal["serpentine", "sidewinding", "arc_rolling", "helix_rolling", "pedal"]
ParameterKey = Literal["alpha_pi", "wavelength_joints", "period_s", "amplitude_deg"]

TURN_OFFSET_RAD = float(np.deg2rad(6.0))
"""Yaw offset beta_o at full turn, for gaits that wind forward."""
TURN_TAPER = 0.7
"""Taper at full turn of sidewinding, where an offset turns nothing: the end that steps less is turned about."""
LIMIT_SHARE = 0.9
"""Share of the servo's rate and acceleration that a gait may plan with; the rest is for transitions."""


class GaitSettings(Settings):
    """Which gait, and its parameters: null takes the gait's own default, and one that it does not have is ignored."""

    name: GaitName = "serpentine"
    """serpentine, sidewinding, arc_rolling, helix_rolling or pedal."""
    alpha_pi: Annotated[float, Field(ge=0.02, le=0.75)] | None = None
    """Amplitude of the serpenoid curve's heading in units of pi (serpentine)."""
    wavelength_joints: Annotated[float, Field(ge=8, le=60)] | None = None
    """Length of one wave in joints (all but arc_rolling)."""
    period_s: Annotated[float, Field(ge=0.5, le=60)] | None = None
    """Seconds of one wave."""
    amplitude_deg: Annotated[float, Field(ge=1, le=80)] | None = None
    """Amplitude A_o of the yaw joints in degrees (serpentine: instead of alpha_pi)."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number the operator may set."""

    key: ParameterKey
    label: str
    unit: str
    minimum: float
    maximum: float
    step: float
    default: float


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """One gait as the page shows it.

    ``turns``: it can be steered; ``rolls``: the body rolls; ``raises_head``: it bears a raised head.
    """

    name: GaitName
    title: str
    summary: str
    parameters: tuple[Parameter, ...]
    turns: bool
    rolls: bool = False
    raises_head: bool = True


@dataclass(frozen=True, slots=True)
class ResolvedGait:
    """A gait with every number known: ``omega`` (rad/s) is the rate of its phase, ``start_sigma`` the phase it starts
    at; a rolling gait's body is upright there and after every whole turn.
    """

    name: GaitName
    shape: ParametricGait
    omega: float
    rolls: bool
    raises_head: bool
    start_sigma: float


def _alpha(default: float) -> Parameter:
    return Parameter("alpha_pi", "Winding angle", "pi rad", 0.05, 0.7, 0.01, default)


def _wavelength(default: float) -> Parameter:
    return Parameter("wavelength_joints", "Wavelength", "joints", 12.0, 40.0, 1.0, default)


def _amplitude(default: float, maximum: float) -> Parameter:
    return Parameter("amplitude_deg", "Amplitude", "deg", 2.0, maximum, 0.1, default)


_PERIOD = Parameter("period_s", "Period", "s", 2.0, 20.0, 0.1, 4.0)

CATALOGUE: dict[GaitName, CatalogueEntry] = {
    entry.name: entry
    for entry in (
        CatalogueEntry(
            "serpentine",
            "Serpentine",
            "Winds forward on the ground like a grass snake; turn bends its path.",
            (_alpha(0.3), _wavelength(20.0), _PERIOD),
            turns=True,
        ),
        CatalogueEntry(
            "sidewinding",
            "Sidewinding",
            "Lifts and lays its body in a travelling wave and moves to its left, backwards to its right.",
            (_amplitude(28.6, 45.0), _wavelength(16.0), _PERIOD),
            turns=True,
        ),
        CatalogueEntry(
            "arc_rolling",
            "Arc rolling",
            "Lies in an arc and rolls sideways over the ground; it cannot turn.",
            (_amplitude(8.6, 11.5), _PERIOD),
            turns=False,
            rolls=True,
        ),
        CatalogueEntry(
            "helix_rolling",
            "Helix rolling",
            "Winds into a flat helix and rolls sideways, its head low; it cannot turn.",
            (_amplitude(17.2, 25.0), _wavelength(16.0), _PERIOD),
            turns=False,
            rolls=True,
            raises_head=False,
        ),
        CatalogueEntry(
            "pedal",
            "Pedal",
            "Winds forward with the strongly bent parts lifted, so that only a few points push; turn bends its path.",
            (_amplitude(34.4, 45.0), _wavelength(16.0), _PERIOD),
            turns=True,
        ),
    )
}


def catalogue_for(model: SnakeModel) -> dict[GaitName, CatalogueEntry]:
    """Return the catalogue with this robot's defaults: a short robot winds in shorter waves."""
    if model.joint_count >= 30:
        return CATALOGUE
    short = tuple(replace(p, default=16.0) if p.key == "wavelength_joints" else p for p in _parameters("serpentine"))
    return {**CATALOGUE, "serpentine": replace(CATALOGUE["serpentine"], parameters=short)}


def _parameters(name: GaitName) -> tuple[Parameter, ...]:
    return CATALOGUE[name].parameters


def resolve(settings: GaitSettings, model: SnakeModel, turn: float = 0.0) -> ResolvedGait:
    """Return the gait with its defaults filled in and ``turn`` in [-1, 1] (positive to the left) applied.

    Raises InputError where the joints cannot do it.
    """
    if settings.alpha_pi is not None and settings.amplitude_deg is not None and settings.name == "serpentine":
        raise InputError("gait.amplitude_deg", "sets the same thing as gait.alpha_pi", "one of the two")
    entry = catalogue_for(model)[settings.name]
    default = {parameter.key: parameter.default for parameter in entry.parameters}
    given = {key: value for key in default if (value := getattr(settings, key)) is not None}
    value = {**default, **given}
    wavelength = value.get("wavelength_joints", np.inf)
    if settings.name == "serpentine":
        amplitude = (
            serpenoid.amplitude_from_alpha(np.pi * value["alpha_pi"], wavelength)
            if settings.amplitude_deg is None
            else float(np.deg2rad(settings.amplitude_deg))
        )
    else:
        amplitude = float(np.deg2rad(value["amplitude_deg"]))
    shape = _shape(settings.name, amplitude, 2.0 * np.pi / wavelength)
    omega = 2.0 * np.pi / value["period_s"]
    _check(_turned(shape, settings.name, 1.0) if entry.turns else shape, omega, model)
    if entry.turns:
        shape = _turned(shape, settings.name, float(np.clip(turn, -1.0, 1.0)))
    start_sigma = _start_sigma(settings.name, shape, model)
    return ResolvedGait(settings.name, shape, omega, entry.rolls, entry.raises_head, start_sigma)


def _shape(name: GaitName, amplitude: float, k: float) -> ParametricGait:
    """Return the constants of EQUATIONS' table."""
    match name:
        case "serpentine":
            return ParametricGait(amplitude, k_o=k, k_e=k)
        case "sidewinding":
            return ParametricGait(amplitude, 0.5 * amplitude, k, k, delta=np.pi / 2.0)
        case "arc_rolling":
            return ParametricGait(amplitude, amplitude, delta=np.pi / 2.0)
        case "helix_rolling":
            return ParametricGait(amplitude, amplitude, k, k, delta=np.pi / 2.0)
        case "pedal":
            return ParametricGait(amplitude, amplitude / 3.0, k, 2.0 * k, harmonic_e=2.0, delta=np.pi / 2.0)


def _start_sigma(name: GaitName, shape: ParametricGait, model: SnakeModel) -> float:
    """Return the phase at which an upright body lies quietly: the arc flat, the helix's middle on the ground."""
    if name == "arc_rolling":
        return np.pi / 2.0
    if name == "helix_rolling":
        return float(-shape.k_o * (model.joint_count + 1) / 2.0 % (2.0 * np.pi))
    return 0.0


def _turned(shape: ParametricGait, name: GaitName, turn: float) -> ParametricGait:
    if name == "sidewinding":
        return replace(shape, taper=-turn * TURN_TAPER)
    return replace(shape, beta_o=turn * TURN_OFFSET_RAD)


def _check(shape: ParametricGait, omega: float, model: SnakeModel) -> None:
    """Refuse what the joints cannot do at full turn, so that a turn is never refused while driving."""
    limits = model.limits
    swell = 1.0 + abs(shape.taper)
    position = swell * abs(shape.amplitude_o) + abs(shape.beta_o)
    if position > limits.position_rad:
        raise InputError(
            "gait",
            f"the yaw joints would bend {np.rad2deg(position):.0f} deg in a turn",
            f"at most {np.rad2deg(limits.position_rad):.0f} deg: less alpha_pi, or a longer wavelength_joints",
        )
    reach = swell * max(abs(shape.amplitude_o) * shape.harmonic_o, abs(shape.amplitude_e) * shape.harmonic_e)
    curve = swell * max(abs(shape.amplitude_o) * shape.harmonic_o**2, abs(shape.amplitude_e) * shape.harmonic_e**2)
    fastest = LIMIT_SHARE * min(limits.rate_rad_s / reach, np.sqrt(limits.acceleration_rad_s2 / curve))
    if omega > fastest:
        raise InputError(
            "gait.period_s",
            f"{2.0 * np.pi / omega:.2f} s is too fast for the joints at this amplitude",
            f"{2.0 * np.pi / fastest:.2f} s or longer",
        )
