"""Settings of the gait as a sensor."""

from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class GaitSensorSettings(Settings):
    """The gait as a sensor of ``fused``: what is assumed of the ground, and how far the model is believed."""

    friction_ratio: Annotated[float, Field(ge=1, le=20)] = 3.0
    """Friction across the body over friction along it, at the start; it is estimated from then on."""
    ratio_sigma: Annotated[float, Field(ge=0)] = 0.5
    """Sigma of the logarithm of that ratio; 0 holds it."""
    bias_sigma_m_s: Annotated[float, Field(ge=0)] = 0.01
    """Sigma of a velocity along the ground that the balance of friction misses, in m/s; it is estimated; 0 leaves it at
    none."""
    wave_sigma_m_s: Annotated[float, Field(ge=0)] = 0.05
    """Sigma of such a velocity that turns with the gait, in m/s; 0 leaves it at none."""
    rate_hz: Positive = 20.0
    """How often the balance of friction is solved, per second; at least once between two frames."""
    slip_scale: Positive = 1.0
    """Error of the velocity, in sigmas of the scatter of the links' slips; it is estimated from then on."""
    slip_time_s: Positive = 0.5
    """Time over which that error lasts, in s."""
    max_inflation: Annotated[float, Field(ge=1)] = 4.0
    """A motion that the filter does not expect is taken with a sigma larger by up to this factor, then left out."""
    max_blind_s: Positive = 60.0
    """Blind for longer than this, the gait holding the state, the estimator starts anew, in s."""
