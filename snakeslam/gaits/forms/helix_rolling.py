"""The helix rolling gait: the body winds into a flat helix and rolls about its own axis."""

from collections.abc import Mapping

import numpy as np

from snakeslam.gaits.gait import Gait
from snakeslam.gaits.parameters import AMPLITUDE, USUAL_PERIOD, USUAL_WAVELENGTH, WAVELENGTH
from snakeslam.gaits.parametric import ParametricGait
from snakeslam.robot.model import SnakeModel


class HelixRolling(Gait):
    """Yaw and pitch waves of one length and one amplitude, a quarter period apart."""

    name = "helix_rolling"
    title = "Helix rolling"
    summary = "Winds into a flat helix and rolls sideways, its head low; it cannot turn."
    parameters = (AMPLITUDE.between(2.0, 25.0, 17.2), USUAL_WAVELENGTH, USUAL_PERIOD)
    travels = "right"
    rolls = True
    raises_head = False
    rank = 4

    def waves(self, values: Mapping[str, float]) -> ParametricGait:
        """Return A_e = A_o."""
        amplitude, k = float(np.deg2rad(values[AMPLITUDE.key])), 2.0 * np.pi / values[WAVELENGTH.key]
        return ParametricGait(amplitude, amplitude, k, k, delta=np.pi / 2.0)

    def start_sigma(self, waves: ParametricGait, model: SnakeModel) -> float:
        """Return the phase at which the helix's middle lies on the ground."""
        return float(-waves.k_o * (model.joint_count + 1) / 2.0 % (2.0 * np.pi))


GAIT = HelixRolling()
