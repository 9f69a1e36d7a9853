"""Which process goes first when the machine is busy: control, the server, all else in shares, scripted runs.

The server takes little time and brings the operator's stop. What sees has a share of its own: before a browser on the
same machine, it would leave the operator to look at what was. Slam's share is the larger one, because a robot whose
slam is silent is held.
"""

import contextlib
import os
from pathlib import Path

import structlog

CONTROL_PRIORITY = 10
"""Of 1 to 99; the kernel's own interrupt threads have 50. It leaves the rest of the machine 5 % whatever happens."""
SERVER_PRIORITY = 5
LATE_NICE = 10
SLAM_NICE = -4
"""Slam's share is two and a half times a browser's."""

_log = structlog.get_logger(__name__)


def go_first() -> bool:
    """Let this thread, and those it starts, go before all others (SCHED_RR); return whether the system allows it.

    It allows a user with the limit ``rtprio`` (``ulimit -r``) of at least 10, and root with CAP_SYS_NICE.
    """
    if not _run_by_turns(CONTROL_PRIORITY):
        _log.info("control has no priority over other programs", remedy="allow rtprio 10: docs/live.md")
        return False
    return True


def go_second() -> bool:
    """Let this thread, and those it starts, go before all but control; return whether the system allows it."""
    return _run_by_turns(SERVER_PRIORITY)


def go_apart(nice: int = 0) -> None:
    """Let this process go as others do, with a share for itself where the kernel deals shares out to sessions.

    A share larger than usual (``nice`` < 0) needs root or the limit ``nice``; who may not have it gets the usual one.
    """
    go_along()
    with contextlib.suppress(PermissionError):  # it leads its terminal's group, which stays what it is
        os.setsid()
    if nice:
        _weigh_session(nice)


def go_along() -> None:
    """Let this thread, and those it starts, go as other programs do, whatever its parent was allowed."""
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def go_last() -> None:
    """Let this process have what others leave."""
    go_apart()
    os.setpriority(os.PRIO_PROCESS, 0, LATE_NICE)
    _weigh_session(LATE_NICE)


def _weigh_session(nice: int) -> None:
    """Kernels that deal out to sessions compare their nice values, not those of the threads inside."""
    with contextlib.suppress(OSError):
        if os.getsid(0) == os.getpid():
            Path("/proc/self/autogroup").write_text(str(nice))


def _run_by_turns(priority: int) -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
    except OSError:  # not allowed, or a kernel (a sandbox's) that knows no turns
        return False
    return True
