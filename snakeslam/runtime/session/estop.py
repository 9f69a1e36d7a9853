"""The server's memory of the E-stop: it outlives sessions and robot nodes, and every new robot node begins with it.

What stops the robot is the latch in the robot node (`robot.target_guard`). A robot node that dies, or a session that is
replaced, takes that latch along, so the server keeps the reason in one place, which the session's host reads.
"""

import threading


class EStopMemory:
    """Whether the E-stop is latched, for every session and robot node to come; may be used from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._reason: str | None = None
        self._latched = 0

    @property
    def reason(self) -> str | None:
        """Why the E-stop is latched; None when it is not."""
        return self._reason

    @property
    def latched(self) -> int:
        """How often an operator has latched it so far, for ``clear``."""
        return self._latched

    def latch(self, reason: str) -> None:
        """Note an operator's E-stop; the first reason is kept."""
        with self._lock:
            self._latched += 1
            self._reason = self._reason or reason

    def report(self, reason: str | None) -> None:
        """Note what the robot itself reports; None, that its E-stop is not latched, changes nothing."""
        with self._lock:
            self._reason = self._reason or reason

    def clear(self, latched: int) -> None:
        """Clear it, unless an operator has latched it again since it was latched ``latched`` times."""
        with self._lock:
            if self._latched == latched:
                self._reason = None
