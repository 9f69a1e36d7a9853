"""The truth of EuRoC-like folders: poses of the body or of a marker, or positions of a prism."""

from pathlib import Path

import numpy as np

from snakeslam.errors import InputError
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float, GroundTruth
from snakeslam.recording import tables
from snakeslam.recording.checks import Stamps, check_truth
from snakeslam.recording.datasets import calibration_files as files

SOURCES = ("state_groundtruth_estimate0", "mocap0", "gt", "gt0", "groundtruth0", "vicon0", "leica0")
"""Folders that may hold the truth, the best one first; TUM-VI's is mocap0."""
QUATERNION_TOLERANCE = 0.05
POSITION_COLUMNS, POSE_COLUMNS, VELOCITY_COLUMNS, BIAS_COLUMNS = 4, 8, 11, 17
KINDS = (BIAS_COLUMNS, VELOCITY_COLUMNS, POSE_COLUMNS, POSITION_COLUMNS)


def read_truth(root: Path, T_BI: Float, frames_ns: Stamps, notes: list[str]) -> tuple[GroundTruth, ...]:
    """Return the IMU's poses from the first source in ``root``: T_WI = T_WB T_BI; nothing without one.

    A row is t_ns, p_WB, q_WB (w x y z) and, where given, v_W, gyro bias, accelerometer bias; a position alone gives
    poses whose orientation is unknown. InputError names file and line.
    """
    path = next((root / name / "data.csv" for name in SOURCES if (root / name / "data.csv").exists()), None)
    if path is None:
        return ()
    if path.parent.name != SOURCES[0]:
        notes.append(f"{path}: is the ground truth")
    rows = tables.read_table(path, tables.stamp_from_ns, columns=(POSITION_COLUMNS, POSE_COLUMNS), repeats=True)
    columns = _columns(path, rows)
    notes += check_truth(path, tables.stamps(rows), frames_ns)
    if columns < POSE_COLUMNS:
        return _positions(path, rows, notes)
    values = tables.floats(path, rows, columns - 1)
    _check_quaternions(path, rows, values[:, 3:7])
    Ts_WS = se3.from_rt(so3.matrix_from_quat_wxyz(values[:, 3:7]), values[:, :3])
    Ts_WI = Ts_WS @ se3.inv(_sensor_transform(path)) @ T_BI
    same_origin = bool(np.allclose(T_BI[:3, 3], 0.0))
    return tuple(
        GroundTruth(
            t_ns=row.t_ns,
            T_WI=Ts_WI[k],
            v_W=values[k, 7:10] if columns >= VELOCITY_COLUMNS and same_origin else None,
            gyro_bias_I=T_BI[:3, :3].T @ values[k, 10:13] if columns >= BIAS_COLUMNS else None,
            accel_bias_I=T_BI[:3, :3].T @ values[k, 13:16] if columns >= BIAS_COLUMNS else None,
        )
        for k, row in enumerate(rows)
    )


def _columns(path: Path, rows: list[tables.Row]) -> int:
    """Return how many columns are used of each row; InputError for a row with fewer than the first one has."""
    columns = next(count for count in KINDS if count <= 1 + len(rows[0].cells))
    short = next((row for row in rows if 1 + len(row.cells) < columns), None)
    if short is not None:
        problem = f"{1 + len(short.cells)} columns"
        raise InputError(f"{path}: line {short.line}", problem, f"{columns} or more, as in the first row")
    return columns


def _sensor_transform(path: Path) -> Float:
    """Return T_BS (4, 4) of what the truth is of, the identity without its sensor.yaml."""
    sensor_file = path.parent / "sensor.yaml"
    sensor = files.read_mapping(sensor_file) if sensor_file.exists() else {}
    return files.transform(f"{sensor_file}: T_BS", sensor["T_BS"]) if "T_BS" in sensor else np.eye(4)


def _check_quaternions(path: Path, rows: list[tables.Row], quats: Float) -> None:
    bad = np.flatnonzero(np.abs(np.linalg.norm(quats, axis=1) - 1.0) > QUATERNION_TOLERANCE)
    if bad.size:
        raise InputError(f"{path}: line {rows[int(bad[0])].line}", "the quaternion has not length 1")


def _positions(path: Path, rows: list[tables.Row], notes: list[str]) -> tuple[GroundTruth, ...]:
    """Return positions of a prism, whose offset to the IMU cannot be removed without the orientation."""
    values = tables.floats(path, rows, 3)
    offset_m = float(np.linalg.norm(_sensor_transform(path)[:3, 3]))
    notes.append(
        f"{path}: has positions only: no errors of orientation are known, those of position include the "
        f"offset of {offset_m:.3f} m to the IMU"
    )
    Ts_WI = se3.from_rt(np.broadcast_to(np.eye(3), (len(rows), 3, 3)), values)
    return tuple(GroundTruth(row.t_ns, Ts_WI[k], orientation_known=False) for k, row in enumerate(rows))
