"""Joint states beside a recording: joints.csv (t_ns, q of all joints in rad, dq in rad/s) and robot.yaml."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from snakeslam.errors import InputError
from snakeslam.messages import Float
from snakeslam.recording import tables
from snakeslam.recording.datasets.common import validated
from snakeslam.recording.recording import JointTable
from snakeslam.robot.model import PRESETS, RobotSettings, SnakeModel, snake_model


def read_joints(folder: Path) -> JointTable | None:
    """Return the joint states of a folder, None where it has none; InputError names the file and the line or key.

    Rates may be left out: they are then the differences of the angles since the row before.
    """
    path = folder / "joints.csv"
    if not path.exists():
        return None
    model = _read_robot(folder / "robot.yaml")
    count = model.joint_count
    rows = tables.read_table(path, tables.stamp_from_ns, columns=(1 + count, 1 + 2 * count), separator=",")
    if len({len(row.cells) for row in rows}) > 1:
        raise InputError(str(path), "some rows have rates and others have none", f"{count} or {2 * count} after t_ns")
    values = tables.floats(path, rows, len(rows[0].cells))
    t_ns = tables.stamps(rows)
    q_rad = values[:, :count]
    dq_rad_s = values[:, count:] if values.shape[1] > count else _differences(t_ns, q_rad)
    return JointTable(model, t_ns, q_rad, dq_rad_s)


def _differences(t_ns: NDArray[np.int64], q_rad: Float) -> Float:
    """Return the rates (M, N) of angles (M, N) from each row and the one before; 0 in the first."""
    return np.vstack([np.zeros_like(q_rad[:1]), np.diff(q_rad, axis=0) / (np.diff(t_ns) / 1e9)[:, None]])


def _read_robot(path: Path) -> SnakeModel:
    """Read which robot the joints are of, in the form of the settings' group ``robot``."""
    if not path.exists():
        raise InputError(str(path), "the file is missing, joints.csv needs it", f"model: {' or '.join(PRESETS)}")
    try:
        raw: Any = yaml.safe_load(tables.read_text(path))
    except yaml.YAMLError as error:
        raise InputError(str(path), f"is no YAML: {' '.join(str(error).split())}") from error
    if not isinstance(raw, dict) or "model" not in raw:
        raise InputError(f"{path}: model", "is missing", ", ".join(PRESETS))
    return snake_model(validated(RobotSettings, raw, path))
