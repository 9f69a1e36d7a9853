"""The numbers that an operator may set of a gait: their units, their limits, and what stands in the settings' text."""

from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class ParameterKind:
    """A number that one or more gaits have, under one ``key`` in settings, commands and the page.

    Values from ``least`` to ``most`` are accepted at all; ``text`` says what it is.
    """

    key: str
    label: str
    unit: str
    step: float
    least: float
    most: float
    text: str

    def between(self, minimum: float, maximum: float, default: float) -> "Parameter":
        """Return one gait's parameter of this kind, with the range of its slider and its default."""
        return Parameter(self, minimum, maximum, default)


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number of one gait: the page offers ``minimum`` to ``maximum``."""

    kind: ParameterKind
    minimum: float
    maximum: float
    default: float

    @property
    def key(self) -> str:
        """Its name in settings and commands."""
        return self.kind.key

    def with_default(self, default: float) -> "Parameter":
        """Return it with another default, inside a range that is widened to it where needed."""
        minimum, maximum = min(self.minimum, default), max(self.maximum, default)
        return replace(self, default=default, minimum=minimum, maximum=maximum)


WINDING_ANGLE = ParameterKind(
    "alpha_pi", "Winding angle", "pi rad", 0.01, 0.02, 0.75,
    "Amplitude of the serpenoid curve's heading in units of pi",
)  # fmt: skip
WAVELENGTH = ParameterKind(
    "wavelength_joints", "Wavelength", "joints", 1.0, 8.0, 60.0,
    "Length of one wave in joints",
)  # fmt: skip
PERIOD = ParameterKind("period_s", "Period", "s", 0.1, 0.5, 60.0, "Seconds of one wave")
AMPLITUDE = ParameterKind(
    "amplitude_deg", "Amplitude", "deg", 0.1, 1.0, 80.0,
    "Amplitude A_o of the yaw joints in degrees",
)  # fmt: skip

USUAL_PERIOD = PERIOD.between(2.0, 20.0, 4.0)
USUAL_WAVELENGTH = WAVELENGTH.between(12.0, 40.0, 16.0)
