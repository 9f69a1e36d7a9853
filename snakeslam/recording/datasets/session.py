"""What a session adds to its sensors' folder: joints.csv (t_ns, q of all joints in rad, dq in rad/s), session.yaml.

``session.yaml`` has the form of the settings: ``robot`` (whose joints these are) and ``run.seed`` (of the estimator).
"""

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
from snakeslam.robot.model import SnakeModel, robot_document, snake_model
from snakeslam.robot.settings import RobotSettings
from snakeslam.settings import Settings
from snakeslam.yaml_reader import read_yaml


class SessionRun(Settings):
    """What of the run a replay needs."""

    seed: int


class SessionFacts(Settings):
    """What made the recording."""

    robot: RobotSettings | None = None
    run: SessionRun | None = None


def write_session(path: Path, model: SnakeModel | None, seed: int) -> None:
    """Write ``session.yaml``."""
    facts: dict[str, Any] = {"run": {"seed": seed}}
    if model is not None:
        facts["robot"] = robot_document(model).model_dump(mode="json", exclude_unset=True)
    path.write_text(yaml.safe_dump(facts), encoding="ascii")


def read_session(folder: Path) -> SessionFacts:
    """Return what a folder's session.yaml says, nothing where there is none; InputError names the file and the key."""
    path = folder / "session.yaml"
    if not path.exists():
        return SessionFacts()
    raw = read_yaml(path)
    return validated(SessionFacts, raw if isinstance(raw, dict) else {}, path)


def read_joints(folder: Path, facts: SessionFacts) -> JointTable | None:
    """Return the joint states of a folder, None where it has none; InputError names the file and the line or key.

    Rates may be left out: they are then the differences of the angles since the row before.
    """
    path = folder / "joints.csv"
    if not path.exists():
        return None
    if facts.robot is None:
        raise InputError(str(path), "session.yaml does not say of which robot", "robot: {model: sim35} in session.yaml")
    model = snake_model(facts.robot)
    count = model.joint_count
    rows = tables.read_table(path, tables.stamp_from_ns, columns=(1 + count, 1 + 2 * count))
    lengths = {count if len(row.cells) < 2 * count else 2 * count for row in rows}
    if len(lengths) > 1:
        raise InputError(str(path), "some rows have rates and others have none", f"{1 + count} or {1 + 2 * count}")
    values = tables.floats(path, rows, lengths.pop())
    t_ns = tables.stamps(rows)
    q_rad = values[:, :count]
    dq_rad_s = values[:, count:] if values.shape[1] > count else _differences(t_ns, q_rad)
    return JointTable(model, t_ns, q_rad, dq_rad_s)


def _differences(t_ns: NDArray[np.int64], q_rad: Float) -> Float:
    """Return the rates (M, N) of angles (M, N) from each row and the one before; 0 in the first."""
    return np.vstack([np.zeros_like(q_rad[:1]), np.diff(q_rad, axis=0) / (np.diff(t_ns) / 1e9)[:, None]])
