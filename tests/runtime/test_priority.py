"""Control, server, all else in shares, scripted runs: in this order where it is allowed; control says if not."""

import os
import subprocess
import sys

import pytest

ASK = """
import errno, os, resource
from pathlib import Path
from snakeslam.runtime.process import priority
priority.set_normal_priority()  # whatever the tests run as
{before}
def share():
    try:
        said = Path("/proc/self/autogroup").read_text().split()
    except OSError:
        return "none"
    return said[-1] if said else "none"  # empty where groups are switched off
def say(allowed):
    policy = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    print(allowed, *policy, os.getpriority(os.PRIO_PROCESS, 0), share(), os.getsid(0) == os.getpid())
say(priority.set_control_priority())
say(priority.set_server_priority())
say(priority.set_own_share())
say(priority.set_own_share(priority.SLAM_NICE))
say(priority.set_lowest_priority())
"""
BECOME_NOBODY = "resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0)); os.setuid(65534)"
WITHOUT_ROUND_ROBIN = """
def refuse(pid, policy, param):
    raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
os.sched_setscheduler = refuse
"""
OTHER, ROUND_ROBIN = str(os.SCHED_OTHER), str(os.SCHED_RR)


def ask(before: str = "") -> tuple[list[list[str]], str]:
    """Return what a process says of itself after each step, and what it logs."""
    command = [sys.executable, "-B", "-c", ASK.format(before=before)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.strip().splitlines()
    return [line.split() for line in lines[-5:]], " ".join(lines[:-5])


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_a_user_without_the_limit_gets_a_log_line() -> None:
    (first, second, apart, slam, last), logged = ask(BECOME_NOBODY)
    assert first[:4] == second[:4] == ["False", OTHER, "0", "0"]
    assert apart[1:4] == slam[1:4] == [OTHER, "0", "0"]
    assert slam[4] in ("0", "none")
    assert last[1:4] == [OTHER, "0", "10"]
    assert "docs/live.md" in logged


def test_a_kernel_without_round_robin_is_no_reason_to_stop() -> None:
    (first, second, apart, slam, last), logged = ask(WITHOUT_ROUND_ROBIN)
    assert first[:4] == second[:4] == ["False", OTHER, "0", "0"]
    assert (apart[1], slam[1], last[3]) == (OTHER, OTHER, "10")
    assert "docs/live.md" in logged


def test_control_then_the_server_then_shares_then_runs() -> None:
    (first, second, apart, slam, last), logged = ask()
    assert (first[0] == "False") == ("no priority" in logged)
    if first[0] == "True":
        assert first[1:4] == [ROUND_ROBIN, "10", "0"]
        assert second[:4] == ["True", ROUND_ROBIN, "5", "0"]
    assert apart[1:4] == [OTHER, "0", "0"]
    assert last[1:4] == [OTHER, "0", "10"]
    shares = (apart[4], slam[4], last[4])
    assert shares in (("0", "-4", "10"), ("0", "0", "10"), ("none", "none", "none"))
    assert apart[5] == "True"
