"""Who is signed in: sessions that can be ended for good, in memory and in a SQLite file that outlives the server."""

import asyncio
import hashlib
import os
import secrets
import sqlite3
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from time import time
from typing import Literal, TypeVar

import structlog

T = TypeVar("T")
Role = Literal["viewer", "operator"]
FILE = "sessions.sqlite"
IDENTITY_CHARS = 12
SALT_BYTES, SECRET_BYTES = 16, 32
SCRYPT_N, SCRYPT_R, SCRYPT_P = 2**14, 8, 1
BUSY_S = 2.0
MOST = 4096
"""Sessions that are open at a time; then the oldest ends."""
SCHEMA = """
CREATE TABLE IF NOT EXISTS secret (salt BLOB NOT NULL);
CREATE TABLE IF NOT EXISTS sessions (
  id TEXT PRIMARY KEY, role TEXT NOT NULL, token BLOB NOT NULL, opened_s REAL NOT NULL, expires_s REAL NOT NULL
) WITHOUT ROWID;
"""
_log = structlog.get_logger("sessions")


@dataclass(frozen=True, slots=True)
class Session:
    """One signed-in browser; ``id`` is the digest of its cookie, which is kept nowhere."""

    id: str
    role: Role
    expires_s: float

    @property
    def identity(self) -> str:
        """What the logs and the limits call it."""
        return self.id[:IDENTITY_CHARS]


def digest(credential: str) -> str:
    """Return what stands for a credential without giving it away."""
    return hashlib.sha256(credential.encode()).hexdigest()


def state_folder(given: str | None) -> Path:
    """Return the folder of what outlives the server: ``given``, else snakeslam's below $XDG_STATE_HOME."""
    if given is not None:
        return Path(given).expanduser()
    base = Path(os.environ.get("XDG_STATE_HOME", ""))
    return (base if base.is_absolute() else Path.home() / ".local" / "state") / "snakeslam"


class Sessions:
    """The open sessions of the ``tokens`` in force; those that another token opened are over.

    Without a ``folder``, or where it cannot be written, sessions end with the server. All methods belong to the event
    loop's thread; the file is written in a thread of its own.
    """

    def __init__(
        self, tokens: dict[Role, str], folder: Path | None, lasting_s: float, clock: Callable[[], float] = time
    ) -> None:
        self.lasting_s, self._clock = lasting_s, clock
        self._file = _open(folder)
        salt = _salt(self._file)
        self._tokens = {role: _token_digest(token, salt) for role, token in tokens.items()}
        self._executor = ThreadPoolExecutor(1, "sessions")
        self._version = self._data_version()
        self._open = self._read()

    def find(self, secret: str) -> Session | None:
        """Return the open session of a cookie."""
        session = self._open.get(digest(secret)) if secret else None
        return session if session is not None and session.expires_s > self._clock() else None

    async def open(self, role: Role) -> str:
        """Open a session and return its cookie."""
        secret, now_s = secrets.token_urlsafe(SECRET_BYTES), self._clock()
        session = Session(digest(secret), role, now_s + self.lasting_s)
        row = (session.id, role, self._tokens[role], now_s, session.expires_s)
        self._open[session.id] = session
        await self._in_thread(lambda: self._write("INSERT INTO sessions VALUES (?, ?, ?, ?, ?)", [row]))
        while len(self._open) > MOST:
            await self.end([next(iter(self._open.values()))])
        return secret

    async def end(self, ended: list[Session]) -> None:
        """End sessions for good."""
        for session in ended:
            self._open.pop(session.id, None)
        rows = [(session.id,) for session in ended]
        await self._in_thread(lambda: self._write("DELETE FROM sessions WHERE id = ?", rows))

    def all(self) -> list[Session]:
        """Return every open session, the oldest first."""
        return list(self._open.values())

    async def poll(self) -> list[Session]:
        """Return the sessions that have ended by themselves, or in another server with the same file."""
        now_s = self._clock()
        ended = [session for session in self._open.values() if session.expires_s <= now_s]
        if ended:
            await self.end(ended)
        version = await self._in_thread(self._data_version)
        if version == self._version:
            return ended
        before = self._open
        self._open, self._version = await self._in_thread(self._read), version
        return ended + [session for key, session in before.items() if key not in self._open]

    def close(self) -> None:
        """Close the file."""
        self._executor.shutdown()
        self._file.close()

    async def _in_thread(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._executor, work)

    def _read(self) -> dict[str, Session]:
        rows = self._file.execute("SELECT id, role, token, expires_s FROM sessions ORDER BY opened_s").fetchall()
        now_s = self._clock()
        return {
            key: Session(key, role, expires_s)
            for key, role, token, expires_s in rows
            if expires_s > now_s and self._tokens.get(role) == token
        }

    def _data_version(self) -> int:
        """Return a number that changes when another program has written the file."""
        return int(self._file.execute("PRAGMA data_version").fetchone()[0])

    def _write(self, statement: str, rows: Sequence[tuple[object, ...]]) -> None:
        try:
            with self._file:
                self._file.executemany(statement, rows)
        except sqlite3.Error as error:
            _log.error("the sessions could not be written; they end with the server", reason=str(error))


def _open(folder: Path | None) -> sqlite3.Connection:
    """Open the file in ``folder``, for this user only; in memory where that is not possible."""
    if folder is None:
        return _connected(":memory:")
    path = folder / FILE
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        os.close(os.open(path, os.O_CREAT | os.O_RDWR, 0o600))
        path.chmod(0o600)
        return _connected(str(path))
    except sqlite3.DatabaseError as error:
        aside = path.with_suffix(".broken")
        _log.warning(
            "the sessions' file is broken: everybody has to sign in again", moved_to=str(aside), why=str(error)
        )
        path.replace(aside)
        return _open(folder)
    except OSError as error:
        _log.warning("sessions end with this server: their file cannot be had", file=str(path), reason=error.strerror)
        return _connected(":memory:")


def _connected(path: str) -> sqlite3.Connection:
    connection = sqlite3.connect(path, timeout=BUSY_S, check_same_thread=False)
    try:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.executescript(SCHEMA)
        connection.execute("SELECT id, role, token, opened_s, expires_s FROM sessions LIMIT 1").fetchall()
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def _salt(file: sqlite3.Connection) -> bytes:
    """Return the file's salt, made at its first use."""
    with file:
        file.execute(
            "INSERT INTO secret SELECT ? WHERE NOT EXISTS (SELECT 1 FROM secret)", [secrets.token_bytes(SALT_BYTES)]
        )
    return bytes(file.execute("SELECT salt FROM secret").fetchone()[0])


def _token_digest(token: str, salt: bytes) -> bytes:
    """Return the mark by which the file names the token that opened a session; slow to guess the token from."""
    return hashlib.scrypt(token.encode(), salt=salt, n=SCRYPT_N, r=SCRYPT_R, p=SCRYPT_P)
