"""Whether a parameter set moves the robot at all: what the operator should know before waiting for it."""

import numpy as np

from snakeslam.gaits import serpenoid
from snakeslam.gaits.catalogue import ResolvedGait

BARELY = 0.25
"""With less advance per wave than this the operator is told."""
FOLDS_BACK_RAD = 2.4048
"""The first zero of J0: from this winding angle on the waves overlap, whatever J0 does beyond."""


def advance_notice(gait: ResolvedGait) -> str | None:
    """Return one sentence when ``gait`` barely advances even without slip (serpentine, J0(alpha) < .25), else None."""
    if gait.name != "serpentine" or gait.shape.amplitude_o == 0.0:
        return None
    alpha_rad = serpenoid.alpha_from_amplitude(abs(gait.shape.amplitude_o), 2.0 * np.pi / gait.shape.k_o)
    share = serpenoid.advance_ratio(alpha_rad)
    angle = f"At a winding angle of {alpha_rad / np.pi:.2f} pi"
    if alpha_rad >= FOLDS_BACK_RAD:
        return f"{angle} the waves fold back on themselves: expect no progress"
    if share >= BARELY:
        return None
    percent = f"{100.0 * share:.0f} %"
    return f"{angle} even an ideal snake moves forward only {percent} of its wave: expect almost no progress"
