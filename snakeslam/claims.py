"""Folders that belong to a running process, which holds a lock on them until it ends.

The system releases a lock (flock) when its process dies. A process number would prove nothing, because numbers are
reused, and containers have numbers of their own.
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
"""A file in every claimed folder; a folder without it is never cleared."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A folder that this process created, or found empty, and holds locked until ``release``."""

    path: Path
    descriptor: int

    def unmark(self) -> None:
        """Remove the mark, so that the folder is never cleared."""
        (self.path / MARK).unlink(missing_ok=True)

    def release(self) -> None:
        """Release the lock and leave the folder as it is."""
        with contextlib.suppress(OSError):
            os.close(self.descriptor)

    def remove(self) -> None:
        """Remove the folder with its contents."""
        shutil.rmtree(self.path, ignore_errors=True)
        self.release()


def claim(path: Path, mode: int = 0o777) -> Claim | None:
    """Create and lock the folder ``path``, whose parent exists; None when another process has it.

    A folder that a dead process left under this name is cleared first. OSError when it cannot be created.
    """
    while True:
        try:
            path.mkdir(mode)
        except FileExistsError:
            if not clear_dead(path):
                return None
            continue
        made = _lock(path)
        # Between the two, another process that clears dead folders may have removed the new one, not locked yet.
        if made is not None:
            (path / MARK).touch()
            return made


def _lock(path: Path) -> Claim | None:
    """Lock the folder that ``path`` names now; None when another process has it, or it is gone."""
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
    """Lock an existing folder; None when another process has it. It has no mark, so it is never cleared."""
    return _lock(path)


def clear_dead(path: Path) -> bool:
    """Remove a claimed folder whose process is dead; return False when it lives, or ``path`` was never claimed."""
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
    """Claim and return a new folder in the system's temporary directory that only this user may enter."""
    while True:
        name = f"{prefix}{os.urandom(6).hex()}"
        made = claim(Path(tempfile.gettempdir()) / name, 0o700)
        if made is not None:
            return made


@contextmanager
def temporary_folder(prefix: str) -> Generator[Path]:
    """Yield such a folder and remove it at the end; folders that dead processes left are cleared first."""
    clear_all_dead(Path(tempfile.gettempdir()), f"{prefix}*")
    made = claim_temporary(prefix)
    try:
        yield made.path
    finally:
        made.remove()
