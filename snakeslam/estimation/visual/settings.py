"""Settings of the visual mode: ORB features matched to a map of points from depth."""

from typing import Annotated

from pydantic import Field

from snakeslam.estimation.orb_map.settings import OrbMapSettings

Positive = Annotated[float, Field(gt=0)]


class VisualSettings(OrbMapSettings):
    """ORB odometry on RGB-D frames, without IMU."""

    max_sigma_m: Positive = 0.1
    """A pose whose position is less certain than this is not believed, one sigma in m."""
    max_speed_m_s: Positive = 2.0
    """A pose that asks for a faster motion than this is not believed, in m/s."""
    max_acceleration_m_s2: Positive = 10.0
    """How far a pose with few points in agreement may be from the prediction, in m/s^2."""
    max_rate_deg_s: Positive = 720.0
    """The same for turning, in deg/s."""
