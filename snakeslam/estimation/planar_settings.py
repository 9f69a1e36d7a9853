"""Settings of the paper's planar filter and of its motion models."""

from typing import Annotated

from pydantic import Field

from snakeslam.estimation.gait_motion import RollingModel
from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class PlanarSettings(Settings):
    """The planar filter, Eq. (37)-(41); one sigma each."""

    friction_ratio: Positive = 3.0
    """Friction across the body over friction along it, as the serpentine model assumes it."""
    rolling: RollingModel = "fan"
    """Speed of arc rolling: paper is Eq. (35)-(36), fan the corrected form."""
    slip_m_s: Positive = 0.02
    """Error of the motion model's speed."""
    slip_rad_s: Positive = 0.02
    """Error of its turn."""
    slip_time_s: Positive = 3.0
    """Time over which these errors last."""
    across_m_sqrt_s: Positive = 0.01
    """Error across the way, which adds up like a random walk."""
    unmodelled_scale: Annotated[float, Field(ge=1)] = 10.0
    """Factor on them in a gait for which the paper has no model."""
    pose_m: Positive = 0.001
    """Noise of the observed position from frame to frame; what drifts in it is not noise."""
    pose_deg: Positive = 0.05
    """Noise of the observed yaw from frame to frame."""
