"""TUM RGB-D folders [Sturm12]: rgb.txt, depth.txt and, where known, groundtruth.txt of the colour camera.

Our additions: ``calibration.yaml`` in Kalibr's form, ``imu.csv`` (t_ns, gyro xyz rad/s, accel xyz m/s^2),
``exposure.csv`` (t_ns of a colour image, ns) and the joints (``datasets.session``).
"""

import re
from dataclasses import replace
from pathlib import Path, PurePosixPath

from snakeslam.calibration import SensorRig, load_rig
from snakeslam.errors import InputError
from snakeslam.messages import GroundTruth
from snakeslam.paths import configs_dir
from snakeslam.recording import tables
from snakeslam.recording.datasets.common import nearest_pairs, shift_frames
from snakeslam.recording.datasets.euroc import read_imu
from snakeslam.recording.datasets.session import read_joints, read_session
from snakeslam.recording.recording import FrameFile, ImuTable, Recording
from snakeslam.recording.settings import ReplaySettings
from snakeslam.recording.trajectory import read_trajectory

KNOWN_CAMERA = re.compile(r"(?:freiburg|fr)([123])(?![0-9])")


def read_tum_rgbd(path: Path, settings: ReplaySettings) -> Recording:
    """Read a TUM RGB-D folder; InputError names the file and the line or key."""
    rig = find_rig(path, settings)
    if rig.cam0.depth_scale is None:
        raise InputError(f"{path}: calibration", "cam0.depth_scale is missing")
    session = read_session(path)
    frames = _with_exposures(read_frames(path, settings.association_ms), path / "exposure.csv")
    return Recording(
        name=path.resolve().name,
        kind="tum_rgbd",
        rig=rig.model_copy(update={"cam0": rig.cam0.model_copy(update={"timeshift_cam_imu": 0.0})}),
        frames=shift_frames(frames, rig.cam0.timeshift_cam_imu),
        imu=_read_imu(path / "imu.csv", rig, frames),
        truth=_read_truth(path / "groundtruth.txt", rig),
        joints=read_joints(path, session),
        seed=None if session.run is None else session.run.seed,
    )


def find_rig(path: Path, settings: ReplaySettings) -> SensorRig:
    """Return the folder's calibration, else the setting's, else the benchmark's by the folder's name.

    Without an IMU the IMU frame is the camera's, so that trajectories are still those of I.
    """
    if (path / "calibration.yaml").exists():
        rig = load_rig(path / "calibration.yaml")
    elif settings.calibration is not None:
        rig = load_rig(settings.calibration)
    else:
        known = KNOWN_CAMERA.search(path.resolve().name.lower())
        if known is None:
            raise InputError(
                f"{path}: calibration.yaml",
                "the file is missing and the folder's name tells no camera",
                "calibration.yaml in the folder, --set replay.calibration=FILE, or freiburg1, 2, 3 in the name",
            )
        rig = load_rig(configs_dir() / "calib" / f"tum_fr{known[1]}.yaml")
    return rig if (path / "imu.csv").exists() else _without_imu(rig)


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
    """Read rows of stamp and image file; names that lead out of the folder are refused."""
    images: list[tuple[int, Path]] = []
    for row in tables.read_table(path, tables.stamp_from_s, columns=(2,)):
        name = PurePosixPath(row.cells[0])
        if name.is_absolute() or ".." in name.parts:
            raise InputError(f"{path}: line {row.line}", f"{row.cells[0]!r} leads out of the folder")
        images.append((row.t_ns, path.parent / name))
    return images


def _with_exposures(frames: tuple[FrameFile, ...], path: Path) -> tuple[FrameFile, ...]:
    """Give each frame the exposure that the table has for its stamp."""
    if not path.exists():
        return frames
    rows = tables.read_table(path, tables.stamp_from_ns, columns=(2,), separator=",")
    values = tables.floats(path, rows, 1)[:, 0]
    known = {row.t_ns: round(value) for row, value in zip(rows, values.tolist(), strict=True)}
    return tuple(replace(frame, exposure_ns=known.get(frame.t_ns, 0)) for frame in frames)


def _read_imu(path: Path, rig: SensorRig, frames: tuple[FrameFile, ...]) -> ImuTable | None:
    if not path.exists():
        return None
    if rig.imu0 is None:
        raise InputError(str(path), "the calibration has no imu0 for it", "calibration.yaml with cam0 and imu0")
    imu = read_imu(path)
    if imu.t_ns[0] > frames[-1].t_ns or imu.t_ns[-1] < frames[0].t_ns:
        raise InputError(str(path), "no sample lies within the frames' time", "stamps of one clock")
    return imu


def _read_truth(path: Path, rig: SensorRig) -> tuple[GroundTruth, ...]:
    """Move the camera's truth to the IMU: T_WI = T_WC T_CI."""
    if not path.exists():
        return ()
    t_ns, Ts_WC = read_trajectory(path)
    Ts_WI = Ts_WC @ rig.cam0.T_CI
    return tuple(GroundTruth(t_ns=int(t), T_WI=T) for t, T in zip(t_ns, Ts_WI, strict=True))


def _without_imu(rig: SensorRig) -> SensorRig:
    identity = tuple(tuple(float(i == j) for j in range(4)) for i in range(4))
    cam0 = rig.cam0.model_copy(update={"T_cam_imu": identity, "timeshift_cam_imu": 0.0})
    return SensorRig(cam0=cam0, imu0=None)
