"""Keeps processes alive: one that dies is started again, after a wait that grows with each death."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import wait
from time import monotonic

import structlog

from snakeslam.runtime.process.log_limit import error_words
from snakeslam.runtime.process.node import Child, EndReason

FIRST_S, LONGEST_S = 0.2, 5.0
STEADY_S = 20.0
"""After a life of this length a death counts as the first one again."""
TRIES = 5

OnDeath = Callable[[str, str, bool], None]
_log = structlog.get_logger("supervisor")


@dataclass(slots=True)
class _Kept:
    start: Callable[[], Child]
    child: Child
    started_s: float
    deaths: int = 0


def backoff_s(deaths: int) -> float:
    """Return how long to wait before the start after so many deaths in a row."""
    return min(FIRST_S * 2.0 ** max(deaths - 1, 0), LONGEST_S)


class Supervisor:
    """Watches child processes by name; calls ``on_death(name, reason, final)`` for each death, from its own threads.

    A death is final when the child's input is wrong, because it would only fail again, when it is the last of TRIES in
    a row, and when it was a planned end, for which the reason is empty. With ``endless`` only a planned end is final.
    """

    def __init__(self, on_death: OnDeath, *, endless: bool = False) -> None:
        self._on_death, self._endless = on_death, endless
        self._lock = threading.Lock()
        self._kept: dict[str, _Kept] = {}
        self._closing = threading.Event()
        self._threads: list[threading.Thread] = []

    def start(self, name: str, start: Callable[[], Child]) -> None:
        """Start a child and keep it alive."""
        kept = _Kept(start, start(), monotonic())
        with self._lock:
            self._kept[name] = kept
        thread = threading.Thread(target=self._keep, args=(name, kept), name=f"keep {name}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def pid(self, name: str) -> int | None:
        """Return the process number of a child."""
        with self._lock:
            return self._kept[name].child.process.pid if name in self._kept else None

    def close(self) -> None:
        """End every child, all at the same time; safe to call twice."""
        self._closing.set()
        with self._lock:
            children = [kept.child for kept in self._kept.values()]
        enders = [threading.Thread(target=child.stop) for child in children]
        for ender in enders:
            ender.start()
        for thread in (*enders, *self._threads):
            thread.join()

    def _keep(self, name: str, kept: _Kept) -> None:
        while not self._closing.is_set():
            if not wait([kept.child.process.sentinel], 0.2):
                continue
            if self._closing.is_set() or not self._revive(name, kept):
                return

    def _revive(self, name: str, kept: _Kept) -> bool:
        """Report a death and start the child again; return False when the death was final."""
        kept.child.process.join()
        reported = _end_reason(kept.child)
        planned = reported is None and kept.child.process.exitcode == 0
        reason = "" if planned else describe_exit(kept.child) if reported is None else reported.reason
        steady = monotonic() - kept.started_s > STEADY_S
        kept.deaths = 1 if steady else kept.deaths + 1
        refused = reported is not None and reported.final and not self._endless
        while not (planned or refused or (kept.deaths >= TRIES and not self._endless)):
            self._report(name, reason, False)
            if self._closing.wait(backoff_s(kept.deaths)):
                return False
            try:
                return self._start_again(kept)
            except Exception as error:  # noqa: BLE001
                # No process could be started: that counts as another death.
                kept.deaths, reason = kept.deaths + 1, error_words(error)
        self._report(name, reason, True)
        return False

    def _start_again(self, kept: _Kept) -> bool:
        """Start the child; return False when the supervisor has been closed meanwhile."""
        with self._lock:
            if self._closing.is_set():
                return False
            kept.child, kept.started_s = kept.start(), monotonic()
        return True

    def _report(self, name: str, reason: str, final: bool) -> None:
        """Call ``on_death``; an error there must not leave the child unwatched."""
        try:
            self._on_death(name, reason, final)
        except Exception as error:  # noqa: BLE001
            _log.error("death not reported", child=name, reason=reason, error=error_words(error))


def _end_reason(child: Child) -> EndReason | None:
    try:
        return child.pipe.recv() if child.pipe.poll() else None
    except (EOFError, OSError):
        return None


def describe_exit(child: Child) -> str:
    """Return how a process ended that reported no reason."""
    code = child.process.exitcode
    how = "no exit code" if code is None else f"signal {-code}" if code < 0 else f"exit code {code}"
    return f"the process ended unexpectedly ({how})"
