"""Settings of the filter: what it may correct of the calibration, and its window."""

from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class CalibrationSettings(Settings):
    """What the filter may correct of the camera's calibration: one sigma of its error; with 0 it is not estimated."""

    time_offset_sigma_ms: Annotated[float, Field(ge=0, le=100)] = 5.0
    """Offset of the camera's clock to the IMU's, in ms; timeshift_sigma_s of the calibration takes precedence."""
    rotation_sigma_deg: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Orientation of the camera on the IMU, in deg."""
    position_sigma_mm: Annotated[float, Field(ge=0, le=200)] = 0.0
    """Position of the camera on the IMU, in mm."""
    readout_sigma_ms: Annotated[float, Field(ge=0, le=100)] = 15.0
    """Readout time of the shutter from the first row to the last, about 0, in ms; not estimated where the calibration
    has "shutter: global"."""


class WindowSettings(Settings):
    """The window of pose clones and the landmarks in the state."""

    clones: Annotated[int, Field(ge=4, le=30)] = 11
    """Past camera poses kept in the filter."""
    keyframe_disparity_px: Positive = 12.0
    """A frame whose features moved less than this since the clone before it leaves the window first, where there is no
    depth; in px."""
    keyframe_disparity_depth_px: Positive = 3.0
    """The same with depth."""

    max_landmarks: Annotated[int, Field(ge=0, le=200)] = 30
    """Landmarks kept in the filter's state at most."""
