"""The sidewinding gait: lifted parts of the body are set down beside where they were."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from snakeslam.gaits.gait import Gait
from snakeslam.gaits.parameters import AMPLITUDE, USUAL_PERIOD, USUAL_WAVELENGTH, WAVELENGTH
from snakeslam.gaits.parametric import ParametricGait

STEERING_TAPER = 0.7
"""Taper of the amplitudes at full turn; an offset of the yaw joints does not turn this gait."""


class Sidewinding(Gait):
    """Yaw and pitch waves of one length, a quarter period apart."""

    name = "sidewinding"
    title = "Sidewinding"
    summary = "Lifts and lays its body in a travelling wave and moves to its left, backwards to its right."
    parameters = (AMPLITUDE.between(2.0, 45.0, 28.6), USUAL_WAVELENGTH, USUAL_PERIOD)
    travels = "left"
    steers = True
    rank = 2

    def waves(self, values: Mapping[str, float]) -> ParametricGait:
        """Return A_e = A_o / 2."""
        amplitude, k = float(np.deg2rad(values[AMPLITUDE.key])), 2.0 * np.pi / values[WAVELENGTH.key]
        return ParametricGait(amplitude, 0.5 * amplitude, k, k, delta=np.pi / 2.0)

    def steered(self, waves: ParametricGait, turn: float) -> ParametricGait:
        """Return the waves tapered: the robot turns about the end that makes the smaller steps."""
        return replace(waves, taper=-turn * STEERING_TAPER)


GAIT = Sidewinding()
