"""Settings of the paper's planar filter and of its motion models."""

from typing import Annotated, Literal

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]
RollingModel = Literal["fan", "paper"]


class PlanarSettings(Settings):
    """The planar filter, Eq. (37)-(41); one sigma each."""

    friction_ratio: Positive = 3.0
    """Friction across the body over friction along it, assumed by the serpentine model."""
    rolling: RollingModel = "fan"
    """Speed of arc rolling: paper is Eq. (35)-(36), fan the corrected form."""
    slip_share: Positive = 0.2
    """Error of the motion model's speed, as a share of the speed at which the joints move the links."""
    still_m_s: Positive = 0.002
    """Least error of that speed, which a stationary robot has too, in m/s."""
    slip_time_s: Positive = 3.0
    """Time over which these errors last, in s."""
    turn_arm_m: Positive = 0.5
    """The error of the yaw rate is the error of the speed divided by this length, in m."""
    unmodelled_m_s: Positive = 0.3
    """Error of the speed in a gait for which the paper has no model, in m/s."""
    pose_m: Positive = 0.001
    """White noise of the observed position from frame to frame, without its drift, in m."""
    pose_deg: Positive = 0.05
    """White noise of the observed yaw from frame to frame, in deg."""
