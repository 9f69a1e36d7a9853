"""The serpentine gait: the body winds forward on the ground as a serpenoid curve."""

from collections.abc import Mapping

import numpy as np

from snakeslam.gaits import serpenoid
from snakeslam.gaits.gait import Gait
from snakeslam.gaits.parameters import AMPLITUDE, USUAL_PERIOD, WAVELENGTH, WINDING_ANGLE, Parameter
from snakeslam.gaits.parametric import ParametricGait
from snakeslam.robot.model import SnakeModel

LONG_ROBOT_JOINTS = 30
"""From this length on there is room for waves of 20 joints; a shorter robot winds in waves of 16."""
SHORT_WAVELENGTH_JOINTS = 16.0
LITTLE_ADVANCE = 0.25
"""With less advance per wave than this share of its length the operator is warned."""
FOLDS_BACK_RAD = 2.4048
"""The first zero of J0: from this winding angle on the waves overlap, whatever J0 does beyond."""


class Serpentine(Gait):
    """Yaw joints only; friction that is larger across the body than along it drives it forward."""

    name = "serpentine"
    title = "Serpentine"
    summary = "Winds forward on the ground like a grass snake; turn bends its path."
    parameters = (WINDING_ANGLE.between(0.05, 0.7, 0.3), WAVELENGTH.between(12.0, 40.0, 20.0), USUAL_PERIOD)
    substitutes = ((AMPLITUDE, WINDING_ANGLE.key),)
    travels = "forward"
    steers = True
    head_form = "line"
    rank = 1

    def waves(self, values: Mapping[str, float]) -> ParametricGait:
        """Return A_o = 2 alpha sin(2 pi / L), or the amplitude where that was given."""
        wavelength = values[WAVELENGTH.key]
        if AMPLITUDE.key in values:
            amplitude = float(np.deg2rad(values[AMPLITUDE.key]))
        else:
            amplitude = serpenoid.amplitude_from_alpha(np.pi * values[WINDING_ANGLE.key], wavelength)
        k = 2.0 * np.pi / wavelength
        return ParametricGait(amplitude, k_o=k, k_e=k)

    def parameters_for(self, model: SnakeModel) -> tuple[Parameter, ...]:
        """Return the parameters; a short robot winds in shorter waves."""
        parameters = super().parameters_for(model)
        if model.joint_count >= LONG_ROBOT_JOINTS:
            return parameters
        return tuple(
            p.with_default(min(p.default, SHORT_WAVELENGTH_JOINTS)) if p.kind is WAVELENGTH else p for p in parameters
        )

    def notice(self, waves: ParametricGait) -> str | None:
        """Return a warning where the body barely advances even without slip: J0(alpha) < 0.25."""
        if waves.amplitude_o == 0.0:
            return None
        alpha_rad, share = _advance(waves)
        angle = f"At a winding angle of {alpha_rad / np.pi:.2f} pi"
        if alpha_rad >= FOLDS_BACK_RAD:
            return f"{angle} the waves fold back on themselves: expect no progress"
        if share >= LITTLE_ADVANCE:
            return None
        percent = f"{100.0 * share:.0f} %"
        return f"{angle} even an ideal snake moves forward only {percent} of its wave: expect almost no progress"

    def remark(self, waves: ParametricGait) -> str | None:
        """Return how far an ideal body would advance with each wave."""
        return f"At this angle an ideal body advances {100.0 * _advance(waves)[1]:.0f} % of the wave."


def _advance(waves: ParametricGait) -> tuple[float, float]:
    """Return the winding angle (rad) and J0 of it, the share of a wave that an ideal body advances."""
    alpha_rad = serpenoid.alpha_from_amplitude(abs(waves.amplitude_o), 2.0 * np.pi / waves.k_o)
    return alpha_rad, serpenoid.advance_ratio(alpha_rad)


GAIT = Serpentine()
