"""The recordings that the page offers, by ids that say nothing of where they lie."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from snakeslam.recording.datasets import Summary, find_recordings

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
        found: dict[Path, Summary] = {}
        for folder in self.folders:
            found |= {summary.path.resolve(): summary for summary in find_recordings(folder)}
        return {_id(path): summary for path, summary in found.items()}


def _id(path: Path) -> str:
    return hashlib.blake2b(str(path).encode(), digest_size=6).hexdigest()


def recording_json(key: str, summary: Summary) -> dict[str, Any]:
    """One entry of GET /recordings."""
    return {
        "id": key,
        "name": summary.name,
        "kind": summary.kind,
        "frames": summary.frames,
        "duration_s": summary.duration_s,
    }
