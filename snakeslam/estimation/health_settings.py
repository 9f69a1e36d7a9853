"""When the estimator says that it is in trouble."""

from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class HealthSettings(Settings):
    """When the estimator says that it is in trouble."""

    few_features: Annotated[int, Field(ge=4)] = 15
    """Fewer features followed than this degrade the verdict."""
    min_features: Annotated[int, Field(ge=1)] = 5
    """With fewer, the frame counts as blind."""
    max_blind_s: Positive = 3.0
    """Blind for longer, the estimator starts anew."""
    max_sigma_v_m_s: Positive = 0.6
    """With a larger velocity sigma the estimator starts anew."""
    max_imu_gap_s: Positive = 0.05
    """A longer time without an IMU sample degrades the verdict."""
    max_innovation: Positive = 3.0
    """Squared innovations larger than this, as a multiple of what is foreseen (their median), degrade the verdict."""
