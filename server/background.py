"""What runs beside the requests: a failure there is logged and said, and never ends the work silently."""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

import structlog

AFTER_FAILURE_S = 1.0
"""Pause after a failed step, so that a loop whose every step fails does not fill the log."""
Say = Callable[[str, str], None]
"""Takes a level and words for the timeline."""
_log = structlog.get_logger("background")


def reason(error: BaseException) -> str:
    """Return why something failed, in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]


def note(name: str, error: BaseException, say: Say | None = None) -> None:
    """Log the failure of ``name`` and say it on the timeline."""
    _log.error("background work failed", what=name, error=reason(error))
    if say is not None:
        try:
            say("error", f"{name} failed ({reason(error)}) and goes on")
        except Exception as second:  # noqa: BLE001  words must not end what goes on
            _log.error("a failure could not be said", what=name, error=reason(second))


async def keep_on(name: str, step: Callable[[], Awaitable[None]], say: Say | None = None) -> None:
    """Repeat ``step`` until cancelled; one that fails is noted, and the next follows after a pause."""
    while True:
        try:
            await step()
        except Exception as error:  # noqa: BLE001  whatever it is, the loop goes on
            note(name, error, say)
            await asyncio.sleep(AFTER_FAILURE_S)


def attempt(name: str, step: Callable[[], None], say: Say | None = None) -> None:
    """Run ``step`` once; a failure is logged."""
    try:
        step()
    except Exception as error:  # noqa: BLE001  whatever it is, the caller goes on
        note(name, error, say)


async def first_of(name: str, *works: Coroutine[Any, Any, None]) -> None:
    """Run both sides of a socket until the first ends; the other is cancelled, and a failure of either is noted."""
    tasks = [asyncio.create_task(work) for work in works]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        for result in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(result, Exception):
                note(name, result)
