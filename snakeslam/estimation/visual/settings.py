"""Settings of the visual mode: ORB features matched to a map of points from depth."""

from typing import Annotated

from pydantic import Field

from snakeslam.estimation.orb_map.settings import OrbMapSettings

Positive = Annotated[float, Field(gt=0)]


class VisualSettings(OrbMapSettings):
    """ORB odometry on RGB-D frames, without IMU."""

    max_sigma_m: Positive = 0.1
    """A pose is rejected if its position is less certain than this, one sigma in m."""
    max_speed_m_s: Positive = 2.0
    """A pose is rejected if it requires a faster motion than this, in m/s."""
    max_acceleration_m_s2: Positive = 10.0
    """Acceleration that bounds how far a pose with few inliers may be from the prediction, in m/s^2."""
    max_rate_deg_s: Positive = 720.0
    """A pose is rejected if it requires a faster rotation than this, in deg/s."""
