"""Which process runs first on a busy machine: control, then the server, then all else in shares, scripted runs last.

The server needs little time and passes on the operator's stop. Camera and slam have no priority over a browser on the
same machine, or the operator would see old images, but a share of the processor of their own. Slam's share is the
larger one, because a robot whose slam is silent is held.
"""

import contextlib
import os
from pathlib import Path

import structlog

CONTROL_PRIORITY = 10
"""Of 1 to 99; the kernel's interrupt threads have 50. The kernel keeps 5 % of the time for all other processes."""
SERVER_PRIORITY = 5
LATE_NICE = 10
SLAM_NICE = -4
"""Gives slam two and a half times the share of a browser."""

_log = structlog.get_logger(__name__)


def set_control_priority() -> bool:
    """Run this thread, and those it starts, before all others (SCHED_RR); return whether the system allows it.

    It allows this to a user with the limit ``rtprio`` (``ulimit -r``) of at least 10, and to root with CAP_SYS_NICE.
    """
    if not _set_round_robin(CONTROL_PRIORITY):
        _log.info("control has no priority over other programs", remedy="allow rtprio 10: docs/live.md")
        return False
    return True


def set_server_priority() -> bool:
    """Run this thread, and those it starts, before all but control; return whether the system allows it."""
    return _set_round_robin(SERVER_PRIORITY)


def set_own_share(nice: int = 0) -> None:
    """Run this process at normal priority, with a share of its own where the kernel gives shares to sessions.

    A share larger than usual (``nice`` < 0) needs root or the limit ``nice``; without it the share is the usual one.
    """
    set_normal_priority()
    with contextlib.suppress(PermissionError):  # it leads the group of its terminal, and stays in it
        os.setsid()
    if nice:
        _weigh_session(nice)


def set_normal_priority() -> None:
    """Run this thread, and those it starts, at normal priority, whatever priority it inherited."""
    if os.sched_getscheduler(0) != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def set_lowest_priority() -> None:
    """Run this process only in the time that others leave."""
    set_own_share()
    os.setpriority(os.PRIO_PROCESS, 0, LATE_NICE)
    _weigh_session(LATE_NICE)


def _weigh_session(nice: int) -> None:
    """Set the session's nice value: kernels that give shares to sessions ignore those of the threads inside."""
    with contextlib.suppress(OSError):
        if os.getsid(0) == os.getpid():
            Path("/proc/self/autogroup").write_text(str(nice))


def _set_round_robin(priority: int) -> bool:
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
    except OSError:  # not allowed, or a kernel (a sandbox's) without this scheduler
        return False
    return True
