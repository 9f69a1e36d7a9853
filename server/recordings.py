"""The recordings that the page offers, by ids that say nothing of where they lie."""

import hashlib
import os
from collections.abc import Generator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from time import time_ns
from typing import Any

from server import strict_json
from server.background import note
from server.models import Answer
from server.run_store import record_of_facts
from snakeslam.recording.datasets import SENSORS, Summary, candidates, summarise

EARLIEST_NS = 946_684_800 * 10**9
"""The year 2000: an earlier stamp is of a clock that began with the device."""
DEFAULT_FOLDERS = (Path("recordings"), Path("../shared/data"))


@dataclass(frozen=True, slots=True)
class Library:
    """Finds recordings below folders, anew for each listing."""

    folders: tuple[Path, ...]

    @classmethod
    def of(cls, folders: list[Path]) -> "Library":
        """Return the library of the given folders and of the default ones that exist."""
        return cls(tuple(folder.absolute() for folder in (*folders, *DEFAULT_FOLDERS) if folder.is_dir()))

    def all(self) -> dict[str, Summary]:
        """Return the recordings by id."""
        found = dict(pair for folder in self.folders for pair in _recordings(folder))
        return {_id(path): summary for path, summary in found.items()}


def _recordings(folder: Path) -> Generator[tuple[Path, Summary]]:
    """Yield the recordings of a folder with their true paths; one that cannot be read hides no other."""
    try:
        paths = candidates(folder)
    except OSError as error:
        note(f"listing the recordings in {folder}", error)
        return
    for path in paths:
        try:
            summary = summarise(path)
            if summary is not None:
                yield path.resolve(), summary
        except Exception as error:  # noqa: BLE001  whatever somebody's files hold
            note(f"listing the recording {printable(str(path))}", error)


def _id(path: Path) -> str:
    return hashlib.blake2b(os.fsencode(path), digest_size=6).hexdigest()


def printable(name: str) -> str:
    """Return a file's name as text that can be sent: a name on disk is any bytes."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in name)


class RecordingAnswer(Answer):
    """One entry of GET /recordings; null: unknown."""

    id: str
    name: str
    kind: str
    frames: int | None
    duration_s: float | None
    gait: str | None
    """Of the run that recorded its own sensors, as world and seed; null for others' recordings."""
    world: str | None
    seed: int | None
    when: str | None
    """UTC, ISO 8601."""


def recording_answer(key: str, summary: Summary) -> RecordingAnswer:
    """Return one entry of GET /recordings."""
    return RecordingAnswer(
        id=key,
        name=printable(summary.name),
        kind=summary.kind,
        frames=summary.frames,
        duration_s=summary.duration_s,
        **_origin(summary),
    )


def _origin(summary: Summary) -> dict[str, Any]:
    """Gait, world and seed of the run that recorded its own sensors, and when it was recorded; None where unknown."""
    unknown = {"gait": None, "world": None, "seed": None, "when": _date(summary.t_start_ns)}
    if summary.path.name != SENSORS:
        return unknown
    try:
        record = record_of_facts("recording", strict_json.read(summary.path.parent / "run.json"))
    except (OSError, ValueError):
        return unknown  # A run without its facts is still a recording.
    return {"gait": record.gait, "world": record.world, "seed": record.seed, "when": record.when}


def _date(t_ns: int | None) -> str | None:
    """Return a stamp as UTC; None for one of a clock that does not count from 1970, as a simulator's does not."""
    if t_ns is None or not EARLIEST_NS <= t_ns <= time_ns():
        return None
    return f"{datetime.fromtimestamp(t_ns // 10**9, UTC):%Y-%m-%dT%H:%M:%SZ}"
