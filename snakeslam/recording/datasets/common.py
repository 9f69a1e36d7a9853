"""What the dataset readers share."""

import bisect
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from snakeslam.calibration import calibration_error
from snakeslam.errors import InputError
from snakeslam.recording.recording import FrameFile
from snakeslam.settings import Settings

LONGEST_NAME = 255

Model = TypeVar("Model", bound=Settings)


def validated(model: type[Model], values: dict[str, Any], path: Path, group: str = "") -> Model:
    """Return the settings, or an InputError that names the file, the ``group`` in it and the key."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise calibration_error(path, error, group) from error


def frame_stamps(frames: Sequence[FrameFile]) -> NDArray[np.int64]:
    """Return the stamps of frames, (N,) ns."""
    return np.array([frame.t_ns for frame in frames], dtype=np.int64)


def image_path(folder: Path, name: str, where: str) -> Path:
    """Return the file ``name`` below ``folder``; InputError for a name that leads out of it or can be none."""
    pure = PurePosixPath(name)
    if any(len(part.encode()) > LONGEST_NAME for part in pure.parts):
        raise InputError(where, f"{name[:80]!r}... is no file name", f"up to {LONGEST_NAME} bytes")
    if pure.is_absolute() or ".." in pure.parts or "\0" in name:
        raise InputError(where, f"{name[:80]!r} leads out of the folder")
    return folder / pure


def shift_frames(frames: tuple[FrameFile, ...], seconds: float) -> tuple[FrameFile, ...]:
    """Return the frames stamped in the IMU's time."""
    shift_ns = round(seconds * 1e9)
    return tuple(replace(frame, t_ns=frame.t_ns + shift_ns) for frame in frames) if shift_ns else frames


def nearest_pairs(a_ns: Sequence[int], b_ns: Sequence[int], limit_ns: int) -> dict[int, int]:
    """Return index pairs {a: b}, each stamp used once, closest pairs first; both sequences increase."""
    candidates: list[tuple[int, int, int]] = []
    for i, t in enumerate(a_ns):
        first = bisect.bisect_left(b_ns, t - limit_ns)
        last = bisect.bisect_right(b_ns, t + limit_ns)
        candidates += [(abs(b_ns[j] - t), i, j) for j in range(first, last)]
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in sorted(candidates):
        if i not in pairs and j not in taken:
            pairs[i] = j
            taken.add(j)
    return pairs
