"""Camera and IMU calibration in Kalibr's form: what the estimator knows about the sensors of a backend."""

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from pydantic import Field, ValidationError, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from snakeslam.errors import InputError
from snakeslam.geometry import se3
from snakeslam.messages import Float
from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]
ROTATION_TOLERANCE = 1e-3
DistortionModel = Literal["radtan", "equidistant", "none"]
COEFFICIENT_COUNTS: dict[DistortionModel, tuple[int, ...]] = {"radtan": (4, 5, 8, 12, 14), "equidistant": (4,)}
"""radtan: OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tau_x tau_y]]]]; without distortion all are zero."""
DISTORTION_NAMES: dict[DistortionModel, tuple[str, ...]] = {
    "radtan": ("radial-tangential", "plumb-bob", "brown-conrady", "rational-polynomial", "rational", "opencv"),
    "equidistant": ("equi", "kannala-brandt", "kannala-brandt4", "kb4", "fisheye", "opencv-fisheye"),
    "none": ("", "no", "null", "undistorted", "perfect"),
}
"""What other tools call the models; case, ``_`` and spaces do not matter."""


def rigid_problem(T: Float) -> str | None:
    """Return why ``T`` (4, 4) is no rigid transform; None when it is one."""
    if not np.all(np.isfinite(T)):
        return "has numbers that are not finite"
    if not np.allclose(T[3], [0, 0, 0, 1]):
        return "the last row must be 0 0 0 1"
    R = T[:3, :3]
    if not np.allclose(R @ R.T, np.eye(3), atol=ROTATION_TOLERANCE) or np.linalg.det(R) < 0:
        return "the left 3x3 block must be a rotation"
    return None


def distortion_model(name: object) -> object:
    """Return our word for the model that another tool calls ``name``; what is unknown as it is."""
    word = "none" if name is None else str(name).strip().lower().replace("_", "-").replace(" ", "-")
    return next((model for model, names in DISTORTION_NAMES.items() if word in (model, *names)), name)


class CameraCalibration(Settings):
    """One camera: pinhole with radial-tangential or equidistant distortion, or none."""

    T_cam_imu: tuple[tuple[float, float, float, float], ...]
    """Rows of the 4x4 transform that maps points from the IMU frame to the camera frame (T_CI)."""
    camera_model: Literal["pinhole"] = "pinhole"
    intrinsics: tuple[Positive, Positive, float, float]
    """fx, fy, cx, cy in px."""
    distortion_model: DistortionModel = "none"
    distortion_coeffs: Annotated[tuple[float, ...], Field(validate_default=True)] = ()
    """As many as ``COEFFICIENT_COUNTS`` allows, in OpenCV's order; equidistant: k1 k2 k3 k4."""
    resolution: tuple[int, int]
    """Width, height in px."""
    timeshift_cam_imu: Annotated[float, Field(ge=-1000, le=1000)] = 0.0
    """Seconds to add to a camera stamp to get the IMU's time."""
    timeshift_sigma_s: Annotated[float, Field(ge=0)] | None = None
    """What may be wrong with that, 0: nothing; the estimator's settings say it where this does not (our addition)."""
    depth_scale: Positive | None = None
    """Units of the depth image per metre (TUM: 5000)."""
    rate_hz: Positive | None = None
    shutter: Literal["global", "rolling", "unknown"] = "unknown"
    """Whether all rows are exposed at once (our addition to the form); the estimator finds out what is not said."""

    @field_validator("distortion_model", mode="before")
    @classmethod
    def _by_any_name(cls, name: object) -> object:
        return distortion_model(name)

    @field_validator("distortion_coeffs")
    @classmethod
    def _fits_the_model(cls, values: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        model: DistortionModel | None = info.data.get("distortion_model")
        if model == "none" and any(values):
            raise PydanticCustomError(
                "distortion", "not zero without a distortion model", {"allowed": "zeros, or a distortion_model"}
            )
        counts = COEFFICIENT_COUNTS.get(model) if model is not None else None
        if counts is not None and len(values) not in counts:
            allowed = ", ".join(str(count) for count in counts)
            raise PydanticCustomError(
                "distortion", "{found} values", {"found": len(values), "allowed": f"{allowed} for {model}"}
            )
        return values

    @field_validator("T_cam_imu")
    @classmethod
    def _is_rigid(cls, rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
        if len(rows) != 4:
            raise ValueError("must be 4 rows of 4 numbers ending in 0 0 0 1")
        if (problem := rigid_problem(np.array(rows))) is not None:
            raise ValueError(problem)
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


def calibration_error(path: Path, error: ValidationError, group: str = "") -> InputError:
    """Return the first complaint about a file, or about its ``group``, as one line."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in ((group,) if group else ()) + first["loc"]) or "top level"
    allowed = first.get("ctx", {}).get("allowed")
    problem = "is missing" if first["type"] == "missing" else first["msg"].removeprefix("Value error, ")
    return InputError(f"{path}: {key}", problem, allowed)


def dump_rig(rig: SensorRig, path: Path) -> None:
    """Write ``rig`` in Kalibr's form."""
    path.write_text(yaml.safe_dump(rig.model_dump(mode="json", exclude_none=True), sort_keys=False))
