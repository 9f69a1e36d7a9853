"""Folders that belong to a living process: a lock on the folder says so, and the system takes it back at its death.

A lock (flock) is proof where a process number is none: numbers are given out again, and containers have their own.
"""

import contextlib
import fcntl
import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

MARK = ".claimed"
"""Stands in a claimed folder: without it a folder is not ours to clear."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A folder that this process made, or took over empty, and holds locked until ``release``."""

    path: Path
    descriptor: int

    def unmark(self) -> None:
        """Remove the mark: the folder becomes an ordinary one, which nobody clears."""
        (self.path / MARK).unlink(missing_ok=True)

    def release(self) -> None:
        """Give the folder up and leave it where it is."""
        with contextlib.suppress(OSError):
            os.close(self.descriptor)

    def remove(self) -> None:
        """Remove the folder with all that is in it."""
        shutil.rmtree(self.path, ignore_errors=True)
        self.release()


def claim(path: Path, mode: int = 0o777) -> Claim | None:
    """Make the folder ``path``, whose parent exists, and lock it; None when another process has it, or had it first.

    What a dead process left under this name is cleared. OSError where the folder cannot be made.
    """
    while True:
        try:
            path.mkdir(mode)
        except FileExistsError:
            if not clear_dead(path):
                return None
            continue
        made = _lock(path)
        # Somebody who cleared away what is dead may have come between the two and taken the new folder for it.
        if made is not None:
            (path / MARK).touch()
            return made


def _lock(path: Path) -> Claim | None:
    """Lock the folder that ``path`` is now; None when another has it, or it is gone."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return None
    found = Claim(path, descriptor)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(descriptor), path.lstat()):
            return found
    except OSError:
        pass
    found.release()
    return None


def lock(path: Path) -> Claim | None:
    """Lock a folder that is there; None when another process has it. It is never cleared, for it has no mark."""
    return _lock(path)


def clear_dead(path: Path) -> bool:
    """Remove a claimed folder whose process is dead; False when it lives, or ``path`` was never claimed."""
    found = _lock(path)
    if found is None:
        return not os.path.lexists(path)
    try:
        if any(path.iterdir()) and not (path / MARK).exists():
            return False
        shutil.rmtree(path)
    except OSError:
        return False
    finally:
        found.release()
    return True


def clear_all_dead(folder: Path, pattern: str) -> list[Path]:
    """Remove this user's claimed folders in ``folder`` that match ``pattern`` and whose process is dead."""
    cleared: list[Path] = []
    for path in folder.glob(pattern):
        with contextlib.suppress(OSError):
            if path.lstat().st_uid == os.getuid() and (path / MARK).exists() and clear_dead(path):
                cleared.append(path)
    return cleared


def claim_temporary(prefix: str) -> Claim:
    """Return a new folder that only this user may enter, among the system's temporary ones."""
    while True:
        name = f"{prefix}{os.urandom(6).hex()}"
        made = claim(Path(tempfile.gettempdir()) / name, 0o700)
        if made is not None:
            return made


@contextmanager
def temporary_folder(prefix: str) -> Generator[Path]:
    """Yield such a folder and remove it; those of processes that died before they could are cleared first."""
    clear_all_dead(Path(tempfile.gettempdir()), f"{prefix}*")
    made = claim_temporary(prefix)
    try:
        yield made.path
    finally:
        made.remove()
