"""TUM trajectory files: ``stamp tx ty tz qx qy qz qw`` in seconds, metres, unit quaternion."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from snakeslam.errors import InputError
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float
from snakeslam.recording import tables

QUATERNION_TOLERANCE = 0.05


def read_trajectory(path: Path) -> tuple[NDArray[np.int64], Float]:
    """Return stamps (N,) in ns and poses (N, 4, 4); InputError names file and line."""
    rows = tables.read_table(path, tables.stamp_from_s, columns=(8,), repeats=True)
    values = tables.floats(path, rows, 7)
    norms = np.linalg.norm(values[:, 3:], axis=1)
    bad = np.flatnonzero(np.abs(norms - 1.0) > QUATERNION_TOLERANCE)
    if bad.size:
        raise InputError(f"{path}: line {rows[int(bad[0])].line}", "the quaternion has not length 1")
    quats_wxyz = values[:, [6, 3, 4, 5]]
    return tables.stamps(rows), se3.from_rt(so3.matrix_from_quat_wxyz(quats_wxyz), values[:, :3])


def format_trajectory(stamped: Iterable[tuple[int, Float]]) -> str:
    """Return the text of poses (t_ns, T (4, 4)); stamps are exact, values have 9 decimals."""
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    for t_ns, T in stamped:
        w, x, y, z = so3.quat_wxyz_from_matrix(T[:3, :3])
        seconds, rest = divmod(t_ns, 1_000_000_000)
        values = " ".join(f"{value:.9f}" for value in (*T[:3, 3], x, y, z, w))
        lines.append(f"{seconds}.{rest:09d} {values}")
    return "\n".join(lines) + "\n"


def write_trajectory(path: Path, stamped: Iterable[tuple[int, Float]]) -> None:
    """Write poses (t_ns, T (4, 4)) to ``path``."""
    path.write_text(format_trajectory(stamped), encoding="ascii")
