"""A recording on disk as the rest of the house sees it, whatever folder layout it came in."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.messages import CameraFrame, Float, GroundTruth, ImuSample
from snakeslam.recording.images import check_image, read_depth, read_gray


@dataclass(frozen=True, slots=True)
class FrameFile:
    """One camera frame that is still on disk; ``depth`` is None where no depth image belongs to it."""

    t_ns: int
    image: Path
    depth: Path | None = None


@dataclass(frozen=True, slots=True)
class ImuTable:
    """IMU samples ``t_ns`` (N,), ``gyro_I`` (N, 3) rad/s, ``accel_I`` (N, 3) m/s^2."""

    t_ns: NDArray[np.int64]
    gyro_I: Float
    accel_I: Float


@dataclass(frozen=True, slots=True)
class Recording:
    """Sensors and, where known, the truth; stamps are the IMU's time, images are read when they are wanted."""

    name: str
    kind: str
    rig: SensorRig
    frames: tuple[FrameFile, ...]
    imu: ImuTable | None
    truth: tuple[GroundTruth, ...]

    def check_images(self) -> None:
        """Raise InputError for the first image that is missing, truncated or of another size; reads no pixels."""
        for frame in self.frames:
            check_image(frame.image, self.rig.cam0.resolution)
            if frame.depth is not None:
                check_image(frame.depth, self.rig.cam0.resolution, bits=16)

    def packets(self, start_ns: int = 0) -> Iterator[ImuSample | CameraFrame]:
        """Yield packets from ``start_ns`` on in time order; at equal stamps the IMU's sample comes first."""
        k = 0
        count = 0 if self.imu is None else len(self.imu.t_ns)
        for seq, frame in enumerate(self.frames):
            while k < count and self.imu is not None and self.imu.t_ns[k] <= frame.t_ns:
                if self.imu.t_ns[k] >= start_ns:
                    yield self._imu_sample(self.imu, k)
                k += 1
            if frame.t_ns >= start_ns:
                yield self.read_frame(seq)

    def read_frame(self, seq: int) -> CameraFrame:
        """Decode one frame; InputError names a damaged file."""
        file = self.frames[seq]
        gray, rgb = read_gray(file.image)
        self._check_shape(file.image, gray.shape)
        return CameraFrame(t_ns=file.t_ns, seq=seq, gray=gray, rgb=rgb, depth_m=self._read_depth(file))

    def _read_depth(self, file: FrameFile) -> NDArray[np.float32] | None:
        """A frame of an RGB-D camera whose depth image is missing has unknown depth everywhere."""
        units_per_m = self.rig.cam0.depth_scale
        if units_per_m is None:
            return None
        if file.depth is None:
            width, height = self.rig.cam0.resolution
            return np.zeros((height, width), dtype=np.float32)
        depth_m = read_depth(file.depth, units_per_m)
        self._check_shape(file.depth, depth_m.shape)
        return depth_m

    def _check_shape(self, path: Path, shape: tuple[int, ...]) -> None:
        width, height = self.rig.cam0.resolution
        if shape != (height, width):
            raise InputError(str(path), f"the image is {shape[1]} x {shape[0]} px", f"{width} x {height}")

    @staticmethod
    def _imu_sample(imu: ImuTable, k: int) -> ImuSample:
        return ImuSample(t_ns=int(imu.t_ns[k]), gyro_I=imu.gyro_I[k], accel_I=imu.accel_I[k])
