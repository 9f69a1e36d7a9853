"""``--listen PATH``: whatever is at the path and belongs to somebody stays, and the user has one line about it."""

import os
import re
import signal
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from snakeslam.cli import main as cli
from snakeslam.errors import InputError, SnakeslamError
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.link import Link, unix_endpoint
from snakeslam.runtime.bus.socket_path import LONGEST
from snakeslam.runtime.process.node import Life, spawn

STARTERS = 3


def wait_for(condition: Callable[[], object], timeout_s: float = 60.0) -> None:
    until = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < until, "it did not happen in time"
        time.sleep(0.02)


def listening(folder: Path) -> Link:
    return Link(unix_endpoint(folder), listens=True)


def listen(link: Link, ready: str, life: Life) -> None:
    with closing(Bus(link)):
        Path(ready).touch()
        life.wait(60.0)


def assert_reachable(folder: Path) -> None:
    Bus(Link(unix_endpoint(folder)), timeout_s=10.0).close()


@pytest.mark.parametrize("frozen", [False, True])
def test_the_socket_of_a_living_node_stays(tmp_path: Path, frozen: bool, capsys: pytest.CaptureFixture[str]) -> None:
    """Also through the command line, as the user would do it; the one that lives may be frozen."""
    child = spawn("first", listen, listening(tmp_path), str(tmp_path / "ready"))
    pid = child.process.pid
    assert pid is not None
    try:
        wait_for((tmp_path / "ready").exists)
        if frozen:
            os.kill(pid, signal.SIGSTOP)
        inode = (tmp_path / "bus.sock").stat().st_ino
        assert cli(["node", "slam", "--listen", unix_endpoint(tmp_path)]) == 2
        said = capsys.readouterr().err.strip().splitlines()
        assert len(said) == 1
        assert "bus.sock is in use" in said[0]
        assert (tmp_path / "bus.sock").stat().st_ino == inode
        os.kill(pid, signal.SIGCONT)
        assert_reachable(tmp_path)
    finally:
        os.kill(pid, signal.SIGCONT)
        child.stop()


@pytest.mark.parametrize("kind", ["file", "folder", "link", "fifo", "lock"])
def test_what_is_no_socket_stays(tmp_path: Path, kind: str) -> None:
    path, other = tmp_path / "bus.sock", tmp_path / "other"
    other.write_text("precious")
    if kind == "file":
        path.write_text("precious")
    elif kind == "folder":
        path.mkdir()
    elif kind == "link":
        path.symlink_to(other)
    elif kind == "fifo":
        os.mkfifo(path)
    else:
        path = tmp_path / "bus.sock.lock"
        path.write_text("precious")
    before = path.lstat()
    with pytest.raises(InputError, match=r"--listen: .*allowed"):
        Bus(listening(tmp_path))
    assert path.lstat() == before
    assert other.read_text() == "precious"


@pytest.mark.parametrize("kind", [socket.SOCK_STREAM, socket.SOCK_DGRAM, socket.SOCK_SEQPACKET])
def test_a_foreign_socket_stays_while_it_lives_and_is_taken_over_when_it_is_dead(tmp_path: Path, kind: int) -> None:
    path = tmp_path / "bus.sock"
    with socket.socket(socket.AF_UNIX, kind) as foreign:
        foreign.bind(str(path))
        if kind != socket.SOCK_DGRAM:
            foreign.listen()
        with pytest.raises(InputError, match="in use"):
            Bus(listening(tmp_path))
        assert stat.S_ISSOCK(path.lstat().st_mode)
    with closing(Bus(listening(tmp_path))):
        assert_reachable(tmp_path)


def test_the_socket_of_a_killed_node_is_taken_over(tmp_path: Path) -> None:
    child = spawn("first", listen, listening(tmp_path), str(tmp_path / "ready"))
    wait_for((tmp_path / "ready").exists)
    child.process.kill()
    child.process.join()
    assert (tmp_path / "bus.sock").exists()
    with closing(Bus(listening(tmp_path))):
        assert_reachable(tmp_path)


def test_a_folder_that_is_not_there_and_a_path_that_is_too_long_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file or directory"):
        Bus(listening(tmp_path / "nowhere"))
    deep = tmp_path / ("d" * LONGEST)
    deep.mkdir()
    with pytest.raises(InputError, match="too long"):
        Bus(listening(deep))


def start_with_others(folder: str, name: str, life: Life) -> None:
    """Wait for the file `go`, listen, and write into the file `name` how that went."""
    together = Path(folder)
    while not (together / "go").exists():
        if life.over:
            return
    try:
        with closing(Bus(listening(together))):
            (together / name).write_text("listens")
            life.wait(60.0)
    except SnakeslamError as error:
        (together / name).write_text(str(error))


@pytest.mark.parametrize("stale", [False, True])
def test_of_several_that_start_at_once_one_listens_and_the_others_get_an_error(tmp_path: Path, stale: bool) -> None:
    if stale:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as dead:
            dead.bind(str(tmp_path / "bus.sock"))
    starters = [spawn(f"starter {k}", start_with_others, str(tmp_path), f"said {k}") for k in range(STARTERS)]
    try:
        time.sleep(2.0)  # until they are there, or some of them: in any order one must win
        (tmp_path / "go").touch()
        wait_for(lambda: len([path for path in tmp_path.glob("said *") if path.read_text()]) == STARTERS)
        said = [path.read_text() for path in tmp_path.glob("said *")]
        assert said.count("listens") == 1
        assert sum("in use" in words for words in said) == STARTERS - 1
        assert_reachable(tmp_path)
    finally:
        for starter in starters:
            starter.stop()


def test_a_temporary_folder_whose_sockets_would_not_fit_is_one_line(tmp_path: Path) -> None:
    """Over the real command: viser would wait for ever."""
    folder = tmp_path / ("long" * 20)
    folder.mkdir()
    command = [sys.executable, "-m", "snakeslam", "serve", "--port", "0"]
    done = subprocess.run(
        command, env={**os.environ, "TMPDIR": str(folder)}, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert re.fullmatch(
        r"snakeslam: TMPDIR: .* too long for the sockets in it \(allowed: at most \d+ bytes\)\n", done.stderr
    )
