"""The pedal gait: a serpentine wave whose strongly bent parts are lifted."""

from collections.abc import Mapping

import numpy as np

from snakeslam.gaits.gait import Gait
from snakeslam.gaits.parameters import AMPLITUDE, USUAL_PERIOD, USUAL_WAVELENGTH, WAVELENGTH
from snakeslam.gaits.parametric import ParametricGait


class Pedal(Gait):
    """A pitch wave of half the length and half the period of the yaw wave."""

    name = "pedal"
    title = "Pedal"
    summary = "Winds forward with the strongly bent parts lifted, so that only a few points push; turn bends its path."
    parameters = (AMPLITUDE.between(2.0, 45.0, 34.4), USUAL_WAVELENGTH, USUAL_PERIOD)
    travels = "forward"
    steers = True
    rank = 5

    def waves(self, values: Mapping[str, float]) -> ParametricGait:
        """Return A_e = A_o / 3, k_e = 2 k_o, omega_e = 2 omega_o."""
        amplitude, k = float(np.deg2rad(values[AMPLITUDE.key])), 2.0 * np.pi / values[WAVELENGTH.key]
        return ParametricGait(amplitude, amplitude / 3.0, k, 2.0 * k, harmonic_e=2.0, delta=np.pi / 2.0)


GAIT = Pedal()
