"""The recordings that the page offers, by ids that say nothing of where they lie."""

import hashlib
import os
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from server.background import note
from snakeslam.recording.datasets import Summary, candidates, summarise

DEFAULT_FOLDERS = (Path("recordings"), Path("../shared/data"))


@dataclass(frozen=True, slots=True)
class Library:
    """Finds recordings below folders, anew at each look."""

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


def recording_json(key: str, summary: Summary) -> dict[str, Any]:
    """One entry of GET /recordings."""
    return {
        "id": key,
        "name": printable(summary.name),
        "kind": summary.kind,
        "frames": summary.frames,
        "duration_s": summary.duration_s,
    }
