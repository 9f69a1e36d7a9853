"""A Unix socket at a path that a user gave: nothing that is there and belongs to somebody is ever removed.

The bus removes what is at the path before it binds, a living node's socket and a text file alike. So it is found out
first who owns it, and until the new socket listens nobody else may find out: a lock lets one start at a time.
"""

import errno
import fcntl
import os
import socket
import stat
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

from snakeslam.errors import InputError

WHERE = "--listen"
ALLOWED = "a path where nothing is, or a socket at which nobody listens any more"
LONGEST = 107
"""Bytes of a Unix socket's path, of Linux."""
DEAD = (errno.ECONNREFUSED, errno.ENOENT)


def check_room_for_sockets(folder: Path, names: Sequence[str]) -> None:
    """Raise InputError where sockets of these names in a temporary folder would have paths that are too long."""
    room = LONGEST - max(map(len, names)) - 1
    if len(os.fsencode(folder)) > room:
        raise InputError("TMPDIR", f"{folder}: too long for the sockets in it", f"at most {room} bytes")


@contextmanager
def claimed(path: Path) -> Generator[None]:
    """Hold the right to make a socket at ``path``, until it listens; InputError where there is something of others'."""
    if len(os.fsencode(path)) > LONGEST:
        raise InputError(WHERE, f"{path}: too long for a socket", f"at most {LONGEST} bytes")
    lock = path.with_name(f".{path.name}.starting")
    try:
        descriptor = _locked(lock)
    except OSError as error:
        raise InputError(WHERE, f"{path.parent}: {error.strerror}", "a socket in a folder that exists") from error
    try:
        _check_free(path)
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(descriptor)


def _locked(lock: Path) -> int:
    """Return a descriptor of the lock file, locked; a file of its own, for the folder may be locked by its owner."""
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        # Whoever had it before has removed the file: the lock of a file that is gone keeps nobody out.
        if _is(lock, descriptor):
            return descriptor
        os.close(descriptor)


def _is(lock: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(lock.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _check_free(path: Path) -> None:
    mode = _mode(path)
    if mode is not None and not stat.S_ISSOCK(mode):
        raise InputError(WHERE, f"{path} exists and is no socket", ALLOWED)
    if mode is not None and somebody_listens(path):
        raise InputError(WHERE, f"{path} is in use: another process listens there", ALLOWED)
    lock = path.with_name(path.name + ".lock")
    if (mode := _mode(lock)) is not None and not (stat.S_ISREG(mode) and lock.stat().st_size == 0):
        raise InputError(WHERE, f"{lock}, the lock of the socket, is a file of another kind", "an empty file or none")


def _mode(path: Path) -> int | None:
    try:
        return path.lstat().st_mode
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(WHERE, f"{path}: {error.strerror}", ALLOWED) from error


def somebody_listens(path: Path) -> bool:
    """Whether a process has the socket at ``path`` open; one that is frozen, or not ours, counts."""
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM, socket.SOCK_SEQPACKET):
        with socket.socket(socket.AF_UNIX, kind) as probe:
            probe.setblocking(False)
            code = probe.connect_ex(str(path))
        if code != errno.EPROTOTYPE:
            return code not in DEAD
    return True
