"""EuRoC MAV folders [Burri16] and those of TUM-VI [Schubert18]: mav0/cam0, mav0/imu0 and, where known, the truth.

The calibration is that of ``cam0/sensor.yaml`` and ``imu0/sensor.yaml``, where these are missing that of a Kalibr chain
in the folder; ``replay.calibration`` goes before both.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from snakeslam.calibration import CameraCalibration, ImuCalibration, SensorRig
from snakeslam.errors import InputError
from snakeslam.messages import Float
from snakeslam.recording import tables
from snakeslam.recording.checks import FRAME_RATES_HZ, IMU_RATES_HZ, check_overlap, check_rate, median_rate_hz
from snakeslam.recording.datasets import calibration_files as files
from snakeslam.recording.datasets.common import frame_stamps, image_path, shift_frames
from snakeslam.recording.datasets.euroc_truth import read_truth
from snakeslam.recording.recording import FrameFile, ImuTable, Recording
from snakeslam.recording.settings import ReplaySettings

OTHER_CALIBRATION = "--set replay.calibration=FILE, or camchain.yaml beside mav0"


@dataclass(frozen=True, slots=True)
class _Calibration:
    """The sensors, and the body's frame that truth and sensor files refer to: ``T_BI`` (4, 4)."""

    rig: SensorRig
    T_BI: Float


def find_root(path: Path) -> Path | None:
    """Return the mav0 folder of ``path`` (the folder above it or itself), or None when it is no EuRoC folder."""
    if (path / "mav0").is_dir():
        return path / "mav0"
    return path if (path / "cam0").is_dir() else None


def read_euroc(path: Path, settings: ReplaySettings) -> Recording:
    """Read an EuRoC folder; InputError names the file and the line or key."""
    root = find_root(path)
    if root is None:
        raise InputError(str(path), "is no EuRoC folder", "a folder with mav0/cam0")
    notes: list[str] = []
    frames, imu = read_frames(root), read_imu(root / "imu0" / "data.csv")
    calibration = _read_calibration(root, settings, notes, median_rate_hz(imu.t_ns))
    cam0, imu0 = calibration.rig.cam0, calibration.rig.imu0
    assert imu0 is not None
    frames_csv, imu_csv = root / "cam0" / "data.csv", root / "imu0" / "data.csv"
    notes += check_rate(frames_csv, frame_stamps(frames), cam0.rate_hz, FRAME_RATES_HZ, "nanoseconds")
    notes += check_rate(imu_csv, imu.t_ns, imu0.update_rate, IMU_RATES_HZ, "nanoseconds")
    frames = shift_frames(frames, cam0.timeshift_cam_imu)
    notes += check_overlap(imu_csv, imu.t_ns, frame_stamps(frames))
    truth = read_truth(root, calibration.T_BI, frame_stamps(frames), notes)
    notes += _without_effect(cam0, settings)
    cam0 = cam0.model_copy(update={"timeshift_cam_imu": 0.0, "depth_scale": None})
    return Recording(
        name=(root.resolve().parent if root.name == "mav0" else root.resolve()).name,
        kind="euroc",
        rig=SensorRig(cam0=cam0, imu0=imu0),
        frames=frames,
        imu=imu,
        truth=truth,
        notes=tuple(notes),
    )


def _without_effect(cam0: CameraCalibration, settings: ReplaySettings) -> list[str]:
    """Return notes on what was given for depth images, which an EuRoC folder does not have."""
    given = {
        "replay.association_ms": settings.association_ms != ReplaySettings().association_ms,
        "cam0.depth_scale": cam0.depth_scale is not None,
    }
    return [
        f"{name}: has no effect, an EuRoC folder has no depth images" for name, is_given in given.items() if is_given
    ]


def read_frames(root: Path) -> tuple[FrameFile, ...]:
    """Return the stamped image files of cam0, in order."""
    table = root / "cam0" / "data.csv"
    rows = tables.read_names(table, tables.stamp_from_ns)
    folder = root / "cam0" / "data"
    return tuple(FrameFile(row.t_ns, image_path(folder, row.cells[0], f"{table}: line {row.line}")) for row in rows)


def read_imu(path: Path) -> ImuTable:
    """Return rows of t_ns, gyro xyz (rad/s), accel xyz (m/s^2)."""
    rows = tables.read_table(path, tables.stamp_from_ns, columns=(7,))
    values = tables.floats(path, rows, 6)
    return ImuTable(tables.stamps(rows), values[:, :3], values[:, 3:])


def _read_calibration(root: Path, settings: ReplaySettings, notes: list[str], rate_hz: float | None) -> _Calibration:
    """Return the calibration from ``replay.calibration``, else the sensors' files, else a chain in the folder."""
    folders = [root, root.parent, root.parent / "dso"] if root.name == "mav0" else [root]
    camera_file, imu_file = root / "cam0" / "sensor.yaml", root / "imu0" / "sensor.yaml"
    T_BI = _body_transform(imu_file)
    chain = settings.calibration
    if chain is not None and camera_file.exists():
        notes.append(f"{chain}: replay.calibration is used instead of {camera_file}")
    if chain is None and not camera_file.exists():
        chain = files.find_chain(folders)
        if chain is None:
            raise InputError(str(camera_file), "the file is missing", OTHER_CALIBRATION)
        notes.append(f"{chain}: is the calibration, {camera_file} is missing")
    if chain is None:
        return _Calibration(_sensor_files(camera_file, imu_file, folders, T_BI, notes, rate_hz), T_BI)
    rig = files.read_rig(chain, notes, rate_hz)
    if rig.imu0 is None:
        rig = rig.model_copy(update={"imu0": _read_imu_noise(imu_file, folders, notes, rate_hz)})
    return _Calibration(rig, T_BI)


def _sensor_files(
    camera_file: Path, imu_file: Path, folders: list[Path], T_BI: Float, notes: list[str], rate_hz: float | None
) -> SensorRig:
    imu0 = _read_imu_noise(imu_file, folders, notes, rate_hz)
    sensor = files.read_mapping(camera_file)
    if not any(key in sensor for key in files.TRANSFORMS):
        raise InputError(f"{camera_file}: T_BS", "is missing", "4 rows of 4 numbers, from the camera to the body")
    cam0 = files.read_camera(camera_file, "", sensor, notes)
    return SensorRig(cam0=_from_imu(cam0, T_BI), imu0=imu0)


def _from_imu(cam0: CameraCalibration, T_BI: Float) -> CameraCalibration:
    """Return the camera placed from the IMU instead of the body: T_CI = T_CB T_BI."""
    T_CI = cam0.T_CI @ T_BI
    return cam0.model_copy(update={"T_cam_imu": tuple(tuple(row) for row in T_CI.tolist())})


def _body_transform(imu_file: Path) -> Float:
    """Return T_BI (4, 4), the identity in EuRoC and where there is no file."""
    if not imu_file.exists():
        return np.eye(4)
    sensor = files.read_mapping(imu_file)
    return files.transform(f"{imu_file}: T_BS", sensor["T_BS"]) if "T_BS" in sensor else np.eye(4)


def _read_imu_noise(imu_file: Path, folders: list[Path], notes: list[str], rate_hz: float | None) -> ImuCalibration:
    if imu_file.exists():
        return files.read_imu_noise(imu_file, "", files.read_mapping(imu_file), notes, rate_hz)
    other = files.find_imu_file(folders)
    if other is None:
        raise InputError(str(imu_file), "the file is missing", OTHER_CALIBRATION)
    notes.append(f"{other}: is the IMU's calibration, {imu_file} is missing")
    return files.read_imu_file(other, notes, rate_hz)
