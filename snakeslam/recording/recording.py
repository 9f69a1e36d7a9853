"""A recording on disk as the other packages see it, whatever folder layout it came in."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from heapq import merge
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.messages import CameraFrame, Float, GroundTruth, ImuSample, JointState, Packet
from snakeslam.recording.images import read_depth, read_gray
from snakeslam.robot.model import SnakeModel


@dataclass(frozen=True, slots=True)
class FrameFile:
    """One camera frame that is still on disk; ``depth`` is None where no depth image belongs to it."""

    t_ns: int
    image: Path
    depth: Path | None = None
    exposure_ns: int = 0


@dataclass(frozen=True, slots=True)
class ImuTable:
    """IMU samples ``t_ns`` (N,), ``gyro_I`` (N, 3) rad/s, ``accel_I`` (N, 3) m/s^2."""

    t_ns: NDArray[np.int64]
    gyro_I: Float
    accel_I: Float


@dataclass(frozen=True, slots=True)
class JointTable:
    """Joint states ``t_ns`` (M,), ``q_rad`` (M, N), ``dq_rad_s`` (M, N) of the robot ``model``, tail to head."""

    model: SnakeModel
    t_ns: NDArray[np.int64]
    q_rad: Float
    dq_rad_s: Float


@dataclass(frozen=True, slots=True)
class Recording:
    """Sensors and, where known, the truth; stamps are the IMU's time, images are read when they are wanted.

    ``seed`` is that of the estimator when the recording was made; ``gray_bits`` are used of 16-bit images;
    ``notes`` are lines on what is odd about the files and was read nevertheless.
    """

    name: str
    kind: str
    rig: SensorRig
    frames: tuple[FrameFile, ...]
    imu: ImuTable | None
    truth: tuple[GroundTruth, ...]
    joints: JointTable | None = None
    seed: int | None = None
    gray_bits: int = 16
    notes: tuple[str, ...] = ()

    def packets(self, start_ns: int = 0) -> Iterator[Packet]:
        """Yield packets from ``start_ns`` to the last frame in time order; at equal stamps IMU, joints, camera."""
        sources: list[tuple[list[int], Callable[[int], Packet]]] = []
        if self.imu is not None:
            sources.append((self.imu.t_ns.tolist(), self._imu_sample))
        if self.joints is not None:
            sources.append((self.joints.t_ns.tolist(), self._joint_state))
        sources.append(([frame.t_ns for frame in self.frames], self.read_frame))
        stamped = ([(t_ns, rank, k) for k, t_ns in enumerate(stamps)] for rank, (stamps, _) in enumerate(sources))
        for t_ns, rank, k in merge(*stamped):
            if t_ns > self.frames[-1].t_ns:
                return
            if t_ns >= start_ns:
                yield sources[rank][1](k)

    def read_frame(self, seq: int) -> CameraFrame:
        """Decode one frame; InputError names a damaged file."""
        file = self.frames[seq]
        gray, rgb = read_gray(file.image, self.gray_bits)
        self._check_shape(file.image, gray.shape)
        return CameraFrame(file.t_ns, seq, gray, rgb, self._read_depth(file), file.exposure_ns)

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

    def _imu_sample(self, k: int) -> ImuSample:
        assert self.imu is not None
        return ImuSample(t_ns=int(self.imu.t_ns[k]), gyro_I=self.imu.gyro_I[k], accel_I=self.imu.accel_I[k])

    def _joint_state(self, k: int) -> JointState:
        """Current and temperature are not recorded: NaN."""
        assert self.joints is not None
        unknown = np.full(self.joints.model.joint_count, np.nan)
        return JointState(int(self.joints.t_ns[k]), self.joints.q_rad[k], self.joints.dq_rad_s[k], unknown, unknown)
