"""TUM RGB-D folders [Sturm12]: rgb.txt, depth.txt and, where known, groundtruth.txt of the colour camera.

Our additions: ``calibration.yaml`` in Kalibr's form, ``imu.csv`` (t_ns, gyro xyz rad/s, accel xyz m/s^2),
``exposure.csv`` (t_ns of a colour image, ns) and the joints (``datasets.session``).
"""

import re
from dataclasses import replace
from pathlib import Path

from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.messages import GroundTruth
from snakeslam.paths import configs_dir
from snakeslam.recording import tables
from snakeslam.recording.checks import (
    FRAME_RATES_HZ,
    IMU_RATES_HZ,
    JOINT_RATES_HZ,
    check_overlap,
    check_rate,
    check_truth,
    median_rate_hz,
)
from snakeslam.recording.datasets.calibration_files import find_chain, read_rig
from snakeslam.recording.datasets.common import frame_stamps, image_path, nearest_pairs, shift_frames
from snakeslam.recording.datasets.euroc import read_imu
from snakeslam.recording.datasets.session import read_joints, read_session
from snakeslam.recording.recording import FrameFile, ImuTable, Recording
from snakeslam.recording.settings import ReplaySettings
from snakeslam.recording.trajectory import read_trajectory

KNOWN_CAMERA = re.compile(r"(?<![a-z0-9])(?:freiburg|fr)([123])(?![a-z0-9])")
"""The benchmark's names as a word of the folder's name: what merely contains one is another camera."""
UNKNOWN_RATE_HZ = 200.0
"""Of an IMU with a single sample."""
EXPOSURE_NS = 1_000_000
"""A row of exposures belongs to the image whose stamp differs by no more: stamps written as floats lose digits."""


def read_tum_rgbd(path: Path, settings: ReplaySettings) -> Recording:
    """Read a TUM RGB-D folder; InputError names the file and the line or key."""
    notes: list[str] = []
    frames = _with_exposures(read_frames(path, settings.association_ms), path / "exposure.csv")
    notes += _unpaired(path, frames)
    imu = read_imu(path / "imu.csv") if (path / "imu.csv").exists() else None
    rig = find_rig(path, settings, notes, None if imu is None else median_rate_hz(imu.t_ns) or UNKNOWN_RATE_HZ)
    if rig.cam0.depth_scale is None:
        raise InputError(f"{path}: calibration", "cam0.depth_scale is missing", "units of the depth image per metre")
    notes += check_rate(path / "rgb.txt", frame_stamps(frames), rig.cam0.rate_hz, FRAME_RATES_HZ, "seconds")
    session = read_session(path)
    frames = shift_frames(frames, rig.cam0.timeshift_cam_imu)
    if imu is not None:
        notes += _check_imu(path / "imu.csv", imu, rig, frames)
    joints = read_joints(path, session)
    if joints is not None:
        notes += check_rate(path / "joints.csv", joints.t_ns, None, JOINT_RATES_HZ, "nanoseconds")
        notes += check_overlap(path / "joints.csv", joints.t_ns, frame_stamps(frames))
    return Recording(
        name=path.resolve().name,
        kind="tum_rgbd",
        rig=rig.model_copy(update={"cam0": rig.cam0.model_copy(update={"timeshift_cam_imu": 0.0})}),
        frames=frames,
        imu=imu,
        truth=_read_truth(path / "groundtruth.txt", rig, frames, notes),
        joints=joints,
        seed=None if session.run is None else session.run.seed,
        notes=tuple(notes),
    )


def find_rig(path: Path, settings: ReplaySettings, notes: list[str], imu_rate_hz: float | None) -> SensorRig:
    """Return the setting's calibration, else the folder's, else the benchmark's by the folder's name.

    Without an IMU the IMU frame is the camera's, so that trajectories are still those of I.
    """
    own = find_chain([path])
    if settings.calibration is not None:
        if own is not None:
            notes.append(f"{settings.calibration}: replay.calibration is used instead of {own}")
        rig = read_rig(settings.calibration, notes, imu_rate_hz)
    elif own is not None:
        rig = read_rig(own, notes, imu_rate_hz)
    else:
        rig = _known_rig(path, notes)
    return rig if imu_rate_hz is not None else _without_imu(rig)


def _known_rig(path: Path, notes: list[str]) -> SensorRig:
    known = KNOWN_CAMERA.search(path.resolve().name.lower())
    if known is None:
        raise InputError(
            f"{path}: calibration.yaml",
            "the file is missing and the folder's name tells no camera",
            "calibration.yaml in the folder, --set replay.calibration=FILE, or freiburg1, 2, 3 in the name",
        )
    notes.append(f"{path}: the calibration is freiburg{known[1]}'s, by the folder's name")
    return read_rig(configs_dir() / "calib" / f"tum_fr{known[1]}.yaml", notes, None)


def read_frames(path: Path, association_ms: float) -> tuple[FrameFile, ...]:
    """Return the colour images in order, each with its depth image where one is near enough in time."""
    colour = _read_list(path / "rgb.txt")
    depth = _read_list(path / "depth.txt")
    pairs = nearest_pairs([t for t, _ in colour], [t for t, _ in depth], round(association_ms * 1e6))
    if not pairs:
        raise InputError(f"{path}: depth.txt", f"no depth image lies within {association_ms:g} ms of a colour image")
    return tuple(
        FrameFile(t_ns, image, depth[pairs[k]][1] if k in pairs else None) for k, (t_ns, image) in enumerate(colour)
    )


def _read_list(path: Path) -> list[tuple[int, Path]]:
    """Read rows of stamp and image file."""
    rows = tables.read_names(path, tables.stamp_from_s)
    return [(row.t_ns, image_path(path.parent, row.cells[0], f"{path}: line {row.line}")) for row in rows]


def _unpaired(path: Path, frames: tuple[FrameFile, ...]) -> list[str]:
    count = sum(frame.depth is None for frame in frames)
    return [f"{path / 'depth.txt'}: {count} of {len(frames)} colour images have no depth image"] if count else []


def _with_exposures(frames: tuple[FrameFile, ...], path: Path) -> tuple[FrameFile, ...]:
    """Give each frame the exposure that the table has for its stamp."""
    if not path.exists():
        return frames
    rows = tables.read_table(path, tables.stamp_from_ns, columns=(2,))
    values = tables.floats(path, rows, 1)[:, 0].tolist()
    pairs = nearest_pairs([frame.t_ns for frame in frames], [row.t_ns for row in rows], EXPOSURE_NS)
    return tuple(
        replace(frame, exposure_ns=round(values[pairs[k]])) if k in pairs else frame for k, frame in enumerate(frames)
    )


def _check_imu(path: Path, imu: ImuTable, rig: SensorRig, frames: tuple[FrameFile, ...]) -> list[str]:
    """Return notes on the IMU's stamps; InputError without its calibration or for another clock."""
    if rig.imu0 is None:
        raise InputError(str(path), "the calibration has no imu0 for it", "calibration.yaml with cam0 and imu0")
    notes = check_rate(path, imu.t_ns, rig.imu0.update_rate, IMU_RATES_HZ, "nanoseconds")
    return notes + check_overlap(path, imu.t_ns, frame_stamps(frames))


def _read_truth(path: Path, rig: SensorRig, frames: tuple[FrameFile, ...], notes: list[str]) -> tuple[GroundTruth, ...]:
    """Move the camera's truth to the IMU: T_WI = T_WC T_CI."""
    if not path.exists():
        return ()
    t_ns, Ts_WC = read_trajectory(path)
    notes += check_truth(path, t_ns, frame_stamps(frames))
    Ts_WI = Ts_WC @ rig.cam0.T_CI
    return tuple(GroundTruth(t_ns=int(t), T_WI=T) for t, T in zip(t_ns, Ts_WI, strict=True))


def _without_imu(rig: SensorRig) -> SensorRig:
    identity = tuple(tuple(float(i == j) for j in range(4)) for i in range(4))
    cam0 = rig.cam0.model_copy(update={"T_cam_imu": identity, "timeshift_cam_imu": 0.0})
    return SensorRig(cam0=cam0, imu0=None)
