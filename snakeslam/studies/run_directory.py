"""A run directory appears whole or not at all: it is written beside its final name and moved there at the end.

Its name is claimed at the start, so that two runs that start together never work for the same one.
"""

import os
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from snakeslam.claims import Claim, claim, clear_all_dead
from snakeslam.errors import InputError

DEFAULT_PARENT = Path("runs")
MOST_NAMES = 10_000


@dataclass(slots=True)
class NewDirectory:
    """A run directory while it is written: files go into ``part``, which becomes ``out`` at the end."""

    part: Path
    out: Path

    def __truediv__(self, name: str) -> Path:
        """Return a file's path in ``part``."""
        return self.part / name


def default_out(name: str) -> Path:
    """Return a free runs/<UTC time>-<name>, with -2, -3, ... where that exists or is being written."""
    stem = DEFAULT_PARENT / f"{datetime.now(UTC):%Y%m%d-%H%M%S}-{name}"
    return next(path for path in _numbered(stem) if not os.path.lexists(path) and not os.path.lexists(_part(path)))


def _numbered(path: Path) -> Generator[Path]:
    return (path if k == 1 else path.with_name(f"{path.name}-{k}") for k in range(1, MOST_NAMES))


def _part(out: Path) -> Path:
    out = out.absolute()
    return out.parent / f".{out.name}.part"


@contextmanager
def new_directory(out: Path | None, name: str = "run") -> Generator[NewDirectory]:
    """Yield a folder to write into; it becomes ``out`` if the block ends well and vanishes otherwise.

    Without ``out`` it is runs/<UTC time>-<name>. InputError when ``out`` exists and is not an empty folder, is being
    written by another process, or may not be written. Should something else stand there at the end, the result is kept
    under the next free name.
    """
    made: list[Path] = []
    try:
        found, folder = _claimed(out, name, made)
    except (OSError, InputError) as error:
        _remove_empty(made)
        if isinstance(error, InputError):
            raise
        raise InputError(str(out or DEFAULT_PARENT), f"the output folder cannot be made: {error.strerror}") from error
    new = NewDirectory(found.path, folder)
    try:
        yield new
        new.out = _move(found, folder)
        found.release()
    except BaseException:
        found.remove()
        _remove_empty(made)
        raise


def _claimed(out: Path | None, name: str, made: list[Path]) -> tuple[Claim, Path]:
    """Claim ``out`` or a free default; ``made`` gets the parent folders that were made."""
    while True:
        folder = default_out(name) if out is None else out
        if folder.is_symlink() or (folder.exists() and (not folder.is_dir() or any(folder.iterdir()))):
            raise InputError(str(folder), "exists already", "a new or an empty folder for the run")
        parent = folder.absolute().parent
        made += [folder for folder in (parent, *parent.parents) if not folder.exists()]
        parent.mkdir(parents=True, exist_ok=True)
        clear_all_dead(parent, ".*.part")
        found = claim(_part(folder))
        if found is not None:
            break
        if out is not None:
            raise InputError(str(folder), "is being written by another run", "a folder of its own")
    if not os.access(found.path, os.W_OK):
        found.remove()
        raise PermissionError(13, os.strerror(13))
    return found, folder


def _move(found: Claim, folder: Path) -> Path:
    """Move the finished folder to ``folder``; where something stands that was not there before, to the next name."""
    found.unmark()
    for target in _numbered(folder):
        if target.is_symlink() or target.is_file():
            continue
        try:
            return _renamed(found.path, target)
        except OSError:
            if not os.path.lexists(target):
                raise
    raise InputError(str(folder), "no free name is left beside it")


def _renamed(part: Path, target: Path) -> Path:
    """Move onto what does not exist or is an empty folder; OSError for all else."""
    part.rename(target.absolute())
    return target


def _remove_empty(folders: list[Path]) -> None:
    """Remove the folders that were made for the run and are empty, the innermost first."""
    for folder in folders:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
