"""A Unix socket at a path that a user gave; a file or a socket in use at that path is never removed.

Zenoh removes what is at the path before it binds, a running node's socket and a text file alike. So the path is checked
first, and a lock admits one node at a time from the check until its socket listens.
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
ALLOWED = "a path where nothing is, or a socket at which no process listens any more"
LONGEST = 107
"""Linux's limit for the path of a Unix socket, in bytes."""
DEAD = (errno.ECONNREFUSED, errno.ENOENT)


def check_socket_paths(folder: Path, names: Sequence[str]) -> None:
    """Raise InputError where sockets of these names in a temporary folder would have paths that are too long."""
    longest = LONGEST - max(map(len, names)) - 1
    if len(os.fsencode(folder)) > longest:
        raise InputError("TMPDIR", f"{folder}: too long for the sockets in it", f"at most {longest} bytes")


@contextmanager
def claimed(path: Path) -> Generator[None]:
    """Hold the lock for a socket at ``path`` until it listens; InputError when a file or a socket in use is there."""
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
    """Return a descriptor of the lock file, locked; a separate file, because the folder may be locked by its owner."""
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        # Its previous owner may have removed the file, and the lock of a removed file excludes nobody.
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
        raise InputError(WHERE, f"{path} exists and is not a socket", ALLOWED)
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
    """Return whether a process has the socket at ``path`` open, even if it is frozen or another user's."""
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM, socket.SOCK_SEQPACKET):
        with socket.socket(socket.AF_UNIX, kind) as probe:
            probe.setblocking(False)
            code = probe.connect_ex(str(path))
        if code != errno.EPROTOTYPE:
            return code not in DEAD
    return True
