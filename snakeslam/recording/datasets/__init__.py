"""Recordings in the layouts of public data sets."""

import os
from dataclasses import dataclass
from pathlib import Path

from snakeslam.errors import InputError, NotBuiltError
from snakeslam.recording.checks import with_checked_images
from snakeslam.recording.datasets import euroc, tum_rgbd
from snakeslam.recording.recording import Recording
from snakeslam.recording.settings import ReplaySettings

FORMATS = "an EuRoC folder (mav0/cam0), a TUM RGB-D folder (rgb.txt, depth.txt)"

SENSORS = "sensors"
"""The folder of a run's own sensors; it goes by the run's name."""


@dataclass(frozen=True, slots=True)
class Summary:
    """What a list of recordings shows of one; frames, duration and start are None where the tables are broken.

    ``t_start_ns`` is the first frame's stamp by the recording's own clock.
    """

    name: str
    kind: str
    path: Path
    frames: int | None
    duration_s: float | None
    t_start_ns: int | None = None


def recording_kind(path: Path) -> str | None:
    """Return "euroc", "tum_rgbd", "mcap", "rosbag" by the layout, or None."""
    if path.is_dir():
        if euroc.find_root(path) is not None:
            return "euroc"
        if (path / "rgb.txt").is_file() or (path / "depth.txt").is_file():
            return "tum_rgbd"
        return "rosbag" if (path / "metadata.yaml").exists() else None
    return {".mcap": "mcap", ".bag": "rosbag", ".db3": "rosbag"}.get(path.suffix.lower()) if path.is_file() else None


def open_recording(path: Path, settings: ReplaySettings) -> Recording:
    """Read a recording's tables and check its images; InputError says what is wrong where.

    What is odd but usable is said in the recording's ``notes``.
    """
    if not path.exists():
        raise InputError(str(path), "no such recording", FORMATS)
    kind = recording_kind(path)
    if kind == "euroc":
        recording = euroc.read_euroc(path, settings)
    elif kind == "tum_rgbd":
        recording = tum_rgbd.read_tum_rgbd(path, settings)
    elif kind is not None:
        raise NotBuiltError(str(path), f"reading {kind}", FORMATS)
    else:
        raise InputError(str(path), "is not a recording", FORMATS)
    return with_checked_images(recording)


def summarise(path: Path) -> Summary | None:
    """Return what is known of a recording from its frame table alone, or None when ``path`` is none."""
    kind = recording_kind(path)
    root = euroc.find_root(path)
    try:
        if kind == "euroc" and root is not None:
            frames = euroc.read_frames(root)
        elif kind == "tum_rgbd":
            frames = tum_rgbd.read_frames(path, ReplaySettings().association_ms)
        else:
            return None
    except InputError:
        # A broken recording stays in the list; opening it says what is wrong.
        return Summary(_name(path), str(kind), path, None, None)
    first_ns, last_ns = frames[0].t_ns, frames[-1].t_ns
    return Summary(_name(path), kind, path, len(frames), (last_ns - first_ns) / 1e9, first_ns)


def candidates(folder: Path) -> list[Path]:
    """Return where recordings may lie: ``folder`` itself, or what is directly below it, the sensors of runs too."""
    if not folder.is_dir():
        return []
    if recording_kind(folder):
        return [folder]
    return [_sensors_or(child) for child in sorted(folder.iterdir()) if _is_open_folder(child)]


def find_recordings(folder: Path) -> list[Summary]:
    """Return the recordings of ``folder``, by name."""
    return [summary for path in candidates(folder) if (summary := summarise(path)) is not None]


def _is_open_folder(path: Path) -> bool:
    """Whether ``path`` is a folder that may be entered."""
    return path.is_dir() and os.access(path, os.R_OK | os.X_OK)


def _sensors_or(folder: Path) -> Path:
    sensors = folder / SENSORS
    return sensors if os.access(sensors, os.R_OK | os.X_OK) and recording_kind(sensors) else folder


def _name(path: Path) -> str:
    return path.parent.name if path.name == SENSORS and path.parent.name else path.name
