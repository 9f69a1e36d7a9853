"""A run directory appears whole or not at all: it is written beside its place and moved there at the end."""

import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from snakeslam.errors import InputError

DEFAULT_PARENT = Path("runs")


def default_out(name: str) -> Path:
    """Return a free runs/<UTC time>-<name>."""
    stem = f"{datetime.now(UTC):%Y%m%d-%H%M%S}-{name}"
    candidates = (DEFAULT_PARENT / (stem if k == 1 else f"{stem}-{k}") for k in range(1, 1000))
    return next(path for path in candidates if not path.exists())


@contextmanager
def new_directory(out: Path) -> Generator[Path]:
    """Yield a folder to write into; it becomes ``out`` if the block ends well and vanishes otherwise.

    InputError when ``out`` exists and is not an empty folder, or may not be written.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(str(out), "exists already", "a new or an empty folder for the run")
    out = out.absolute()
    part = out.parent / f".{out.name}.{os.getpid()}.part"
    made = [parent for parent in (out.parent, *out.parent.parents) if not parent.exists()]
    try:
        part.mkdir(parents=True)
        if not os.access(part, os.W_OK):
            raise PermissionError(13, os.strerror(13))
    except OSError as error:
        _remove_empty(made)
        raise InputError(str(out), f"the output folder cannot be made: {error.strerror}") from error
    try:
        yield part
        part.rename(out)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        _remove_empty(made)
        raise


def _remove_empty(folders: list[Path]) -> None:
    """Remove the folders that were made on the way and hold nothing, the innermost first."""
    for folder in folders:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
