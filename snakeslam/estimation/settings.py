"""Settings of the estimators; units are in the names."""

from typing import Annotated, Literal

from pydantic import Field

from snakeslam.estimation.gait.settings import GaitSensorSettings
from snakeslam.estimation.planar.settings import PlanarSettings
from snakeslam.estimation.visual.settings import VisualSettings
from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]
Mode = Literal["visual", "vio", "planar", "fused", "gait"]


class FrontendSettings(Settings):
    """Feature detection and tracking."""

    max_tracks: Annotated[int, Field(ge=20, le=2000)] = 200
    min_distance_px: Annotated[float, Field(ge=4)] = 20.0
    fast_threshold: Annotated[int, Field(ge=2, le=100)] = 12
    """FAST contrast threshold in grey levels; lowered by itself where the picture is poor."""
    klt_window_px: Annotated[int, Field(ge=5, le=61)] = 13
    klt_levels: Annotated[int, Field(ge=0, le=6)] = 2
    ransac_threshold_px: Positive = 1.5


class NoiseSettings(Settings):
    """Measurement noise, one sigma; IMU noise comes from the calibration and is scaled here."""

    pixel_px: Positive = 1.0
    blur_share: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Error of a feature that is smeared, as a part of the smear's length; it adds to ``pixel_px``."""
    unknown_exposure_ms: Annotated[float, Field(ge=0, le=100)] = 10.0
    """Exposure of a frame that does not tell its own."""
    track_drift_px: Annotated[float, Field(ge=0)] = 0.1
    """How far a followed feature wanders over the surface from one frame to the next."""
    depth_offset_m: Positive = 0.004
    """a in sigma_z = a + b z^2."""
    depth_square_per_m: Positive = 0.004
    """b in sigma_z = a + b z^2, 1/m."""
    depth_min_m: Positive = 0.25
    depth_max_m: Positive = 6.0
    imu_white_scale: Positive = 5.0
    """Factor on the calibrated white noise densities: a still IMU's do not hold in motion (vibration, scale, axes)."""
    imu_walk_scale: Positive = 1.0


class CalibrationSettings(Settings):
    """What the filter may correct of the camera's calibration: one sigma of what is wrong with it, 0 holds it."""

    time_offset_sigma_ms: Annotated[float, Field(ge=0, le=100)] = 5.0
    rotation_sigma_deg: Annotated[float, Field(ge=0, le=10)] = 0.0
    position_sigma_mm: Annotated[float, Field(ge=0, le=200)] = 0.0
    readout_sigma_ms: Annotated[float, Field(ge=0, le=100)] = 15.0
    """The time from the first row's exposure to the last one's, about 0; held there where the shutter is global."""


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


class WindowSettings(Settings):
    """The window of pose clones and the landmarks in the state."""

    clones: Annotated[int, Field(ge=4, le=30)] = 11
    keyframe_disparity_px: Positive = 12.0
    """A frame whose features moved less than this since the clone before it leaves the window first, without depth."""
    keyframe_disparity_depth_px: Positive = 3.0
    """The same with depth."""
    max_landmarks: Annotated[int, Field(ge=0, le=200)] = 30


class EstimatorSettings(Settings):
    """Which estimator runs, and its parts."""

    mode: Mode = "fused"
    max_iterations: Annotated[int, Field(ge=1, le=10)] = 3
    gravity_m_s2: Positive = 9.81
    frontend: FrontendSettings = FrontendSettings()
    noise: NoiseSettings = NoiseSettings()
    window: WindowSettings = WindowSettings()
    calibration: CalibrationSettings = CalibrationSettings()
    health: HealthSettings = HealthSettings()
    visual: VisualSettings = VisualSettings()
    planar: PlanarSettings = PlanarSettings()
    gait: GaitSensorSettings = GaitSensorSettings()
