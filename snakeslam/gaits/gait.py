"""What a gait is: one object that knows its parameters, its waves, and what to say of them to an operator.

``forms`` has one file for each gait; ``catalogue`` finds them. ``resolve`` makes the constants of Eq. (1)-(2) of a
gait and the values of its parameters.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from snakeslam.errors import InputError
from snakeslam.gaits.parameters import WAVELENGTH, Parameter, ParameterKind
from snakeslam.gaits.parametric import ParametricGait
from snakeslam.robot.model import SnakeModel

STEERING_OFFSET_RAD = float(np.deg2rad(6.0))
"""Offset beta_o of the yaw joints at full turn, for gaits that move forward."""
LIMIT_SHARE = 0.9
"""Share of the servo's rate and acceleration that a gait may plan with; the rest is for transitions."""

Travel = Literal["forward", "left", "right"]
HeadForm = Literal["line", "level", "carried"]
"""line: the body winds as a serpenoid curve, for which the closed forms of head control hold, and the head is held on
a line that steers the robot; level: feedback holds the head level and looking ahead; carried: the gait's own phase
carries the head and no controller acts."""


class Gait(ABC):
    """One gait. A subclass states the class attributes and ``waves``; the other methods have defaults.

    ``parameters`` must have ``period_s``. ``substitutes`` are accepted instead of one of them, named by its key.
    ``travels`` is the direction in the body's frame at positive drive; ``steers``: it can be steered; ``rolls``: the
    body rolls about its own axis; ``raises_head``: it can be used with a raised head; ``rank`` orders the
    page, lowest first.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    summary: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    substitutes: ClassVar[tuple[tuple[ParameterKind, str], ...]] = ()
    travels: ClassVar[Travel]
    steers: ClassVar[bool] = False
    rolls: ClassVar[bool] = False
    raises_head: ClassVar[bool] = True
    head_form: ClassVar[HeadForm] = "level"
    rank: ClassVar[int] = 1000

    @abstractmethod
    def waves(self, values: Mapping[str, float]) -> ParametricGait:
        """Return the constants of Eq. (1)-(2), straight ahead, of one value for each parameter."""

    def steered(self, waves: ParametricGait, turn: float) -> ParametricGait:
        """Return ``waves`` with ``turn`` in [-1, 1] (positive to the left) applied; asked only of gaits that steer."""
        return replace(waves, beta_o=turn * STEERING_OFFSET_RAD)

    def start_sigma(self, waves: ParametricGait, model: SnakeModel) -> float:
        """Return the phase (rad) at which an upright body lies quietly and the gait can begin."""
        del waves, model
        return 0.0

    def parameters_for(self, model: SnakeModel) -> tuple[Parameter, ...]:
        """Return the parameters with this robot's defaults: a wave is not longer than the robot by default."""
        longest = max(WAVELENGTH.least, float(model.joint_count))
        return tuple(p.with_default(min(p.default, longest)) if p.kind is WAVELENGTH else p for p in self.parameters)

    def notice(self, waves: ParametricGait) -> str | None:
        """Return one sentence that an operator should know before driving with these waves, or None."""
        del waves
        return None

    def remark(self, waves: ParametricGait) -> str | None:
        """Return one sentence that helps to choose the parameters, for the page while they are edited, or None."""
        del waves
        return None


@dataclass(frozen=True, slots=True)
class ResolvedGait:
    """A gait with every number known: ``omega`` (rad/s) is the rate of its phase, ``start_sigma`` the phase it starts
    at; a rolling gait's body is upright there and after every whole revolution.
    """

    kind: Gait
    shape: ParametricGait
    omega: float
    start_sigma: float

    @property
    def name(self) -> str:
        """The gait's name."""
        return self.kind.name

    @property
    def rolls(self) -> bool:
        """Whether the body rolls."""
        return self.kind.rolls

    @property
    def raises_head(self) -> bool:
        """Whether it can be used with a raised head."""
        return self.kind.raises_head

    @property
    def notice(self) -> str | None:
        """What an operator should know before driving with it, or None."""
        return self.kind.notice(self.shape)

    @property
    def remark(self) -> str | None:
        """What helps to choose its parameters, or None."""
        return self.kind.remark(self.shape)


def resolve_values(gait: Gait, given: Mapping[str, float], model: SnakeModel, turn: float = 0.0) -> ResolvedGait:
    """Return ``gait`` with its defaults under the ``given`` values, and ``turn`` in [-1, 1] (positive left) applied.

    A given parameter that the gait does not have is ignored. InputError where the joints cannot do it.
    """
    for kind, replaced in gait.substitutes:
        if kind.key in given and replaced in given:
            raise InputError(f"gait.{kind.key}", f"sets the same thing as gait.{replaced}", "one of the two")
    values = {parameter.key: parameter.default for parameter in gait.parameters_for(model)}
    known = {*values, *(kind.key for kind, _ in gait.substitutes)}
    values |= {key: value for key, value in given.items() if key in known}
    waves = gait.waves(values)
    omega = 2.0 * np.pi / values["period_s"]
    _check(gait.steered(waves, 1.0) if gait.steers else waves, omega, model)
    if gait.steers:
        waves = gait.steered(waves, float(np.clip(turn, -1.0, 1.0)))
    return ResolvedGait(gait, waves, omega, gait.start_sigma(waves, model))


def _check(waves: ParametricGait, omega: float, model: SnakeModel) -> None:
    """Refuse what the joints cannot do at full turn, so that a turn is never refused while driving."""
    limits = model.limits
    largest = 1.0 + abs(waves.taper)
    position = largest * abs(waves.amplitude_o) + abs(waves.beta_o)
    if position > limits.position_rad:
        raise InputError(
            "gait",
            f"the yaw joints would bend {np.rad2deg(position):.0f} deg in a turn",
            f"at most {np.rad2deg(limits.position_rad):.0f} deg: less alpha_pi, or a longer wavelength_joints",
        )
    # Largest first and second derivatives of the joint angles by the phase.
    slope = largest * max(abs(waves.amplitude_o) * waves.harmonic_o, abs(waves.amplitude_e) * waves.harmonic_e)
    curve = largest * max(abs(waves.amplitude_o) * waves.harmonic_o**2, abs(waves.amplitude_e) * waves.harmonic_e**2)
    fastest = LIMIT_SHARE * min(limits.rate_rad_s / slope, np.sqrt(limits.acceleration_rad_s2 / curve))
    if omega > fastest:
        raise InputError(
            "gait.period_s",
            f"{2.0 * np.pi / omega:.2f} s is too fast for the joints at this amplitude",
            f"{2.0 * np.pi / fastest:.2f} s or longer",
        )
