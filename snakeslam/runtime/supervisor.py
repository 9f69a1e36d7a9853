"""Keeps processes alive: one that dies without a word is started again, after a while that grows with each time."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import wait
from time import monotonic

from snakeslam.runtime.node import Child

FIRST_S, LONGEST_S = 0.2, 5.0
STEADY_S = 20.0
"""Who has lived for so long starts afresh with its back-off."""
TRIES = 5

Tell = Callable[[str, str, bool], None]


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
    """Watches children by name; ``tell(name, reason, final)`` hears of each death, from a thread of the supervisor.

    Final is a death with a last word (it would only fail again), the last of TRIES in a row, and an end as planned, for
    which the reason is empty. With ``endless`` only an end as planned is final: what has died is tried again for ever.
    """

    def __init__(self, tell: Tell, *, endless: bool = False) -> None:
        self._tell, self._endless = tell, endless
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
        """Tell of a death and start anew; False when that was final."""
        kept.child.process.join()
        word = _last_word(kept.child)
        kept.deaths = 1 if monotonic() - kept.started_s > STEADY_S else kept.deaths + 1
        done = word is None and kept.child.process.exitcode == 0
        given_up = not self._endless and (word is not None or kept.deaths >= TRIES)
        final = done or given_up
        self._tell(name, "" if done else word or how_it_ended(kept.child), final)
        if final or self._closing.wait(backoff_s(kept.deaths)):
            return False
        with self._lock:
            if self._closing.is_set():
                return False
            kept.child, kept.started_s = kept.start(), monotonic()
        return True


def _last_word(child: Child) -> str | None:
    try:
        return child.pipe.recv() if child.pipe.poll() else None
    except (EOFError, OSError):
        return None


def how_it_ended(child: Child) -> str:
    """Return in words how a process ended without a word."""
    code = child.process.exitcode
    how = "no exit code" if code is None else f"signal {-code}" if code < 0 else f"exit code {code}"
    return f"the process ended unexpectedly ({how})"
