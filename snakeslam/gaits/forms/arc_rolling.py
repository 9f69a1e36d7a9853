"""The arc rolling gait: the body lies in an arc and rolls about its own axis."""

from collections.abc import Mapping

import numpy as np

from snakeslam.gaits.gait import Gait
from snakeslam.gaits.parameters import AMPLITUDE, USUAL_PERIOD
from snakeslam.gaits.parametric import ParametricGait
from snakeslam.robot.model import SnakeModel


class ArcRolling(Gait):
    """All yaw joints alike and all pitch joints alike, a quarter period apart."""

    name = "arc_rolling"
    title = "Arc rolling"
    summary = "Lies in an arc and rolls sideways over the ground; it cannot turn."
    parameters = (AMPLITUDE.between(2.0, 11.5, 8.6), USUAL_PERIOD)
    travels = "right"
    rolls = True
    head_form = "carried"
    rank = 3

    def waves(self, values: Mapping[str, float]) -> ParametricGait:
        """Return A_e = A_o and no wave along the body."""
        amplitude = float(np.deg2rad(values[AMPLITUDE.key]))
        return ParametricGait(amplitude, amplitude, delta=np.pi / 2.0)

    def start_sigma(self, waves: ParametricGait, model: SnakeModel) -> float:
        """Return the phase at which the arc lies flat."""
        del waves, model
        return np.pi / 2.0


GAIT = ArcRolling()
