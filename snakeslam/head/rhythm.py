"""The part of the head's sway that the body model does not predict repeats with the gait: it is learned and cancelled.

Of a sideways velocity D e^(i phi), phi the gait's phase and w its rate, feedback of gain K leaves a sway
E e^(i phi) with E = D / (K + i w). Adding Re(c e^(i phi)) to the velocity asked for, with

    dc/dt = -2 rho (K + i w) e^(-i phi) e_y,

makes c tend to -D as exp(-rho t), whatever offset the distance e_y to the line has.
"""

import cmath
from dataclasses import dataclass

import numpy as np

LEARNED_PER_PERIOD = 0.5
"""rho in units of 1 / period."""
MOST_M_S = 0.1


@dataclass(slots=True)
class GaitRhythm:
    """The sideways velocity that is to be added, as the coefficient c of the gait's phase."""

    phase_rad: float = 0.0
    coefficient_m_s: complex = 0j

    @property
    def correction_m_s(self) -> float:
        """What to add to the sideways velocity now, positive to the left."""
        return (self.coefficient_m_s * cmath.exp(1j * self.phase_rad)).real

    def learn(self, lateral_m: float, gain_rad_s: float, pace: float, period_s: float, dt_s: float) -> None:
        """Go on by ``dt_s`` with the head ``lateral_m`` to the left of its line; at pace 0 nothing is learned.

        Only the period itself is learned: at three times its rate the sensors' delay would turn learning about.
        """
        rate_rad_s = 2.0 * np.pi * pace / period_s
        self.phase_rad += rate_rad_s * dt_s
        step = 2.0 * LEARNED_PER_PERIOD * abs(pace) / period_s * dt_s * lateral_m
        learned = self.coefficient_m_s - step * (gain_rad_s + 1j * rate_rad_s) * cmath.exp(-1j * self.phase_rad)
        self.coefficient_m_s = learned * min(1.0, MOST_M_S / max(abs(learned), MOST_M_S))
