"""Camera and IMU calibration in Kalibr's form: what a backend tells the estimator about its sensors."""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import Field, ValidationError, field_validator

from snakeslam.errors import InputError
from snakeslam.geometry import se3
from snakeslam.messages import Float
from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]
ROTATION_TOLERANCE = 1e-3
KALIBR_EXTRAS = ("rostopic", "cam_overlaps")
"""Keys that Kalibr writes and nobody here needs."""


class CameraCalibration(Settings):
    """One camera: pinhole with radial-tangential or equidistant distortion, or none."""

    T_cam_imu: tuple[tuple[float, float, float, float], ...]
    """Rows of the 4x4 transform that maps points from the IMU frame to the camera frame (T_CI)."""
    camera_model: Literal["pinhole"] = "pinhole"
    intrinsics: tuple[Positive, Positive, float, float]
    """fx, fy, cx, cy in px."""
    distortion_model: Literal["radtan", "equidistant", "none"] = "none"
    distortion_coeffs: tuple[float, ...] = ()
    """radtan: k1 k2 p1 p2 [k3]; equidistant: k1 k2 k3 k4."""
    resolution: tuple[int, int]
    """Width, height in px."""
    timeshift_cam_imu: float = 0.0
    """Seconds to add to a camera stamp to get the IMU's time."""
    timeshift_sigma_s: Annotated[float, Field(ge=0)] | None = None
    """What may be wrong with that, 0: nothing; the estimator's settings say it where this does not (our addition)."""
    depth_scale: Positive | None = None
    """Units of the depth image per metre (TUM: 5000)."""
    rate_hz: Positive | None = None
    shutter: Literal["global", "rolling", "unknown"] = "unknown"
    """Whether all rows are exposed at once (our addition to the form); the estimator finds out what is not said."""

    @field_validator("T_cam_imu")
    @classmethod
    def _is_rigid(cls, rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
        T = np.array(rows)
        if T.shape != (4, 4) or not np.allclose(T[3], [0, 0, 0, 1]):
            raise ValueError("must be 4 rows of 4 numbers ending in 0 0 0 1")
        R = T[:3, :3]
        if not np.allclose(R @ R.T, np.eye(3), atol=ROTATION_TOLERANCE) or np.linalg.det(R) < 0:
            raise ValueError("the left 3x3 block must be a rotation")
        return rows

    @property
    def T_CI(self) -> Float:
        """IMU to camera, (4, 4)."""
        return np.array(self.T_cam_imu)

    @property
    def T_IC(self) -> Float:
        """Camera to IMU, (4, 4)."""
        return se3.inv(self.T_CI)


class ImuCalibration(Settings):
    """Continuous-time noise of the IMU."""

    gyroscope_noise_density: Positive
    """rad/s/sqrt(Hz)"""
    gyroscope_random_walk: Positive
    """rad/s^2/sqrt(Hz)"""
    accelerometer_noise_density: Positive
    """m/s^2/sqrt(Hz)"""
    accelerometer_random_walk: Positive
    """m/s^3/sqrt(Hz)"""
    update_rate: Positive
    """Hz"""
    sample_kind: Literal["point", "mean"] = "point"
    """Whether a sample is the value at its time or the mean since the sample before (our addition to the form)."""


class SensorRig(Settings):
    """The sensors of one head: a camera and, unless the recording has none, an IMU."""

    cam0: CameraCalibration
    imu0: ImuCalibration | None = None


def load_rig(path: Path) -> SensorRig:
    """Read a Kalibr-form YAML file; InputError names the file and key."""
    try:
        raw: Any = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(str(path), f"cannot be read: {' '.join(str(error).split())}") from error
    try:
        return SensorRig.model_validate(_without_extras(raw))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "top level"
        raise InputError(f"{path}: {key}", first["msg"]) from error


def _without_extras(raw: Any) -> Any:
    if not isinstance(raw, dict):
        return raw
    groups: dict[Any, Any] = {
        name: {key: value for key, value in group.items() if key not in KALIBR_EXTRAS}
        if isinstance(group, dict)
        else group
        for name, group in raw.items()
    }
    return groups


def dump_rig(rig: SensorRig, path: Path) -> None:
    """Write ``rig`` in Kalibr's form."""
    path.write_text(yaml.safe_dump(rig.model_dump(mode="json", exclude_none=True), sort_keys=False))
