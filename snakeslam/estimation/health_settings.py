"""Limits of the verdict on a frame."""

from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class HealthSettings(Settings):
    """Limits of the verdict, and when the estimator starts anew."""

    few_features: Annotated[int, Field(ge=4)] = 15
    """Fewer tracked features than this degrade the verdict."""
    min_features: Annotated[int, Field(ge=1)] = 5
    """With fewer tracked features the frame is blind."""
    max_blind_s: Positive = 3.0
    """Time in s without the camera after which the estimator starts anew."""
    max_sigma_v_m_s: Positive = 0.6
    """The estimator starts anew when the sigma of its velocity is larger than this, in m/s."""
    max_imu_gap_s: Positive = 0.05
    """A longer time without an IMU sample degrades the verdict, in s."""
    max_innovation: Positive = 3.0
    """The verdict is degraded when the median squared innovation exceeds this multiple of the predicted one."""
