"""Settings of the gait as a sensor."""

from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class GaitSensorSettings(Settings):
    """The gait as a sensor of ``fused``: assumptions about the ground, and the errors of the model."""

    friction_ratio: Annotated[float, Field(ge=1, le=20)] = 3.0
    """Friction across the body over friction along it, at the start; then it is estimated."""
    ratio_sigma: Annotated[float, Field(ge=0)] = 0.5
    """Sigma of the logarithm of that ratio; with 0 it is not estimated."""
    bias_sigma_m_s: Annotated[float, Field(ge=0)] = 0.01
    """Sigma of a constant bias of the modelled velocity along the ground, in m/s; with 0 it is not estimated."""
    wave_sigma_m_s: Annotated[float, Field(ge=0)] = 0.05
    """Sigma of a bias that is periodic with the gait, in m/s; with 0 it is not estimated."""
    rate_hz: Positive = 20.0
    """How often the balance of friction is solved, per second; at least once between two frames."""
    slip_scale: Positive = 1.0
    """Error of the velocity at the start, in sigmas of the scatter of the links' slips; then it is estimated."""
    slip_time_s: Positive = 0.5
    """Correlation time of that error, in s."""
    max_inflation: Annotated[float, Field(ge=1)] = 4.0
    """A displacement outside of its gate is used with a sigma larger by up to this factor, or left out."""
    max_blind_s: Positive = 60.0
    """Time in s without the camera after which the estimator starts anew, while the gait bounds the error."""
