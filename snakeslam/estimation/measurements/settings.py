"""Settings of the measurement noise."""

from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class NoiseSettings(Settings):
    """Measurement noise, one sigma; IMU noise comes from the calibration and is scaled here."""

    pixel_px: Positive = 1.0
    """Position of a feature, in px."""
    blur_share: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Error of a feature with motion blur, as a share of the blur's length; it adds to ``pixel_px`` in squares."""
    unknown_exposure_ms: Annotated[float, Field(ge=0, le=100)] = 10.0
    """Exposure assumed of a frame that does not report its own, in ms."""
    track_drift_px: Annotated[float, Field(ge=0)] = 0.1
    """Drift of a tracked feature over its surface from one frame to the next, in px."""
    depth_offset_m: Positive = 0.004
    """a in sigma_z = a + b z^2."""
    depth_square_per_m: Positive = 0.004
    """b in sigma_z = a + b z^2, 1/m."""
    depth_min_m: Positive = 0.25
    """The nearest depth used, in m."""
    depth_max_m: Positive = 6.0
    """The farthest depth used, in m."""
    imu_white_scale: Positive = 5.0
    """Factor on the calibrated white noise densities: those of a stationary IMU are too small in motion (vibration,
    scale, axes)."""

    imu_walk_scale: Positive = 1.0
    """Factor on the calibrated random walks."""
