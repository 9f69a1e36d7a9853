"""Recordings in the registry of backends."""

from typing import TYPE_CHECKING

from snakeslam.backends.kind import BackendKind, BackendRequest
from snakeslam.errors import InputError
from snakeslam.recording.settings import ReplaySettings

if TYPE_CHECKING:
    from snakeslam.backends.base import Backend


def _open(request: BackendRequest[ReplaySettings]) -> "Backend":
    from snakeslam.backends.replay.backend import ReplayBackend

    if request.settings.recording is None:
        raise InputError("replay.recording", "names no recording, which backend: replay needs", "a recording's folder")
    return ReplayBackend(request.settings.recording, request.settings)


REPLAY = BackendKind("replay", "a recording, settings under replay:", "replay", _open, recorded=True)
