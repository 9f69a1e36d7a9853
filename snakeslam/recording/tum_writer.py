"""Writes a session's sensors as a TUM RGB-D folder [Sturm12] that ``replay`` and others' tools read.

rgb/ and depth/ (16-bit, ``depth_scale`` units a metre) with rgb.txt, depth.txt, groundtruth.txt (of the colour camera);
our additions are imu.csv, joints.csv, exposure.csv, calibration.yaml and session.yaml. Stamps are exact, numbers are
written in full, so that a replay gives the estimator what the session gave it.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import SensorRig, dump_rig
from snakeslam.errors import InputError
from snakeslam.messages import CameraFrame, Float, GroundTruth, ImuSample, JointState, Packet, check_packet
from snakeslam.recording.datasets.session import write_session
from snakeslam.recording.trajectory import write_trajectory
from snakeslam.robot.model import SnakeModel

DEPTH_SCALE = 5000.0
FAST_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
IMU_TITLES = ("t_ns", *(f"gyro_{c}_rad_s" for c in "xyz"), *(f"accel_{c}_m_s2" for c in "xyz"))
LARGEST = np.iinfo(np.uint16).max


class TumWriter:
    """Takes packets in order, images go to disk at once; ``finish`` writes the tables. The folder must not exist."""

    def __init__(self, folder: Path, rig: SensorRig, model: SnakeModel | None, seed: int) -> None:
        self._folder, self._model, self._seed = folder, model, seed
        self._scale = rig.cam0.depth_scale or DEPTH_SCALE
        self._rig = rig.model_copy(update={"cam0": rig.cam0.model_copy(update={"depth_scale": self._scale})})
        self._images: list[str] = []
        self._depths: list[str] = []
        self._exposures: list[str] = []
        self._imu: list[str] = []
        self._joints: list[str] = []
        for name in ("rgb", "depth"):
            (folder / name).mkdir(parents=True)

    def add(self, packet: Packet) -> None:
        """Add a packet; InputError for a camera without depth, which the format cannot hold."""
        check_packet(packet)
        if isinstance(packet, ImuSample):
            self._imu.append(_row(packet.t_ns, packet.gyro_I, packet.accel_I))
        elif isinstance(packet, JointState):
            self._joints.append(_row(packet.t_ns, packet.q_rad, packet.dq_rad_s))
        else:
            self._add_frame(packet)

    def finish(self, truth: Iterable[GroundTruth]) -> None:
        """Write all tables; ``truth`` is that of the IMU and becomes the colour camera's, T_WC = T_WI T_IC."""
        _write_lines(self._folder / "rgb.txt", "# color images\n# timestamp filename", self._images)
        _write_lines(self._folder / "depth.txt", "# depth maps\n# timestamp filename", self._depths)
        if any(self._exposures):
            _write_lines(self._folder / "exposure.csv", "t_ns,exposure_ns", self._exposures)
        if self._imu:
            _write_lines(self._folder / "imu.csv", ",".join(IMU_TITLES), self._imu)
        if self._joints and self._model is not None:
            _write_lines(self._folder / "joints.csv", ",".join(joint_titles(self._model.joint_count)), self._joints)
        write_session(self._folder / "session.yaml", self._model, self._seed)
        dump_rig(self._rig, self._folder / "calibration.yaml")
        T_IC = self._rig.cam0.T_IC
        poses = [(sample.t_ns, sample.T_WI @ T_IC) for sample in truth]
        if poses:
            write_trajectory(self._folder / "groundtruth.txt", poses)

    def _add_frame(self, frame: CameraFrame) -> None:
        if frame.depth_m is None:
            raise InputError("recording.enabled", "the camera has no depth, a TUM RGB-D folder needs it", "false")
        seconds, rest = divmod(frame.t_ns, 1_000_000_000)
        stamp = f"{seconds}.{rest:09d}"
        colour = frame.gray if frame.rgb is None else cv2.cvtColor(np.asarray(frame.rgb), cv2.COLOR_RGB2BGR)
        self._write_png(f"rgb/{stamp}.png", np.asarray(colour))
        self._write_png(f"depth/{stamp}.png", depth_units(frame.depth_m, self._scale))
        self._images.append(f"{stamp} rgb/{stamp}.png")
        self._depths.append(f"{stamp} depth/{stamp}.png")
        if frame.exposure_ns:
            self._exposures.append(f"{frame.t_ns},{frame.exposure_ns}")

    def _write_png(self, name: str, image: NDArray[Any]) -> None:
        coded, data = cv2.imencode(".png", image, FAST_PNG)
        if not coded:
            raise InputError(str(self._folder / name), "the image cannot be coded")
        (self._folder / name).write_bytes(data.tobytes())


def depth_units(depth_m: NDArray[np.float32], units_per_m: float) -> NDArray[np.uint16]:
    """Return depth (H, W) m in whole units; what does not fit into 16 bits is unknown, 0."""
    units = np.rint(depth_m * np.float32(units_per_m))
    return np.where((units > 0) & (units <= LARGEST), units, 0).astype(np.uint16)


def joint_titles(count: int) -> tuple[str, ...]:
    """Return the titles of joints.csv for ``count`` joints, tail to head."""
    numbers = range(1, count + 1)
    return ("t_ns", *(f"q_{n}_rad" for n in numbers), *(f"dq_{n}_rad_s" for n in numbers))


def _row(t_ns: int, *vectors: Float) -> str:
    """Return one line; Python's shortest text of a float reads back as the same float."""
    return ",".join([str(t_ns), *(repr(value) for vector in vectors for value in vector.tolist())])


def _write_lines(path: Path, title: str, lines: Sequence[str]) -> None:
    path.write_text("\n".join([title, *lines]) + "\n", encoding="ascii")
