"""What the dataset readers share."""

import bisect
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from snakeslam.errors import InputError
from snakeslam.recording.recording import FrameFile
from snakeslam.settings import Settings

Model = TypeVar("Model", bound=Settings)


def validated(model: type[Model], values: dict[str, Any], path: Path) -> Model:
    """Return the settings, or an InputError that names the file and the key."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: {key}", first["msg"]) from error


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
