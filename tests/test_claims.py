"""Folders that belong to a living process; real processes are killed here."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from snakeslam.claims import MARK, claim, clear_all_dead, clear_dead, lock, temporary_folder

HOLD = """
import sys, time
from pathlib import Path
from snakeslam.claims import claim
made = claim(Path(sys.argv[1]))
(made.path / "token").write_text("secret")
print("held", flush=True)
time.sleep(600)
"""


def hold(path: Path) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def kill(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert process.stdout is not None
    process.stdout.close()


def test_a_claim_lasts_as_long_as_its_process(tmp_path: Path) -> None:
    path = tmp_path / "mine"
    process = hold(path)
    try:
        assert claim(path) is None
        assert not clear_dead(path)
        assert clear_all_dead(tmp_path, "*") == []
        assert (path / "token").exists()
    finally:
        kill(process)
    taken = claim(path)
    assert taken is not None
    assert not (path / "token").exists()
    taken.remove()
    assert not path.exists()


def test_only_claimed_folders_of_the_dead_are_cleared(tmp_path: Path) -> None:
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path / "theirs")
    (tmp_path / "plain").touch()
    kill(hold(tmp_path / "dead"))
    process = hold(tmp_path / "alive")
    try:
        assert clear_all_dead(tmp_path, "*") == [tmp_path / "dead"]
        assert claim(tmp_path / "theirs") is None
    finally:
        kill(process)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["alive", "link", "plain", "theirs"]


def test_of_many_at_once_one_gets_the_name(tmp_path: Path) -> None:
    race = "import sys; from pathlib import Path; from snakeslam.claims import claim\n"
    race += "print(claim(Path(sys.argv[1])) is not None, flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", race, str(tmp_path / "name")]
    racers = [subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    said = [racer.stdout.readline().strip() for racer in racers if racer.stdout is not None]
    for racer in racers:
        racer.communicate("")
    assert sorted(said) == ["False", "False", "False", "True"]


def test_a_temporary_folder_is_private_and_those_of_the_dead_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    kill(hold(tmp_path / "it-old"))
    with temporary_folder("it-") as folder:
        assert folder.stat().st_mode & 0o777 == 0o700
        assert [path.name for path in tmp_path.iterdir()] == [folder.name]
        assert (folder / MARK).exists()
    assert list(tmp_path.iterdir()) == []


def test_a_locked_folder_is_another_ones(tmp_path: Path) -> None:
    first = lock(tmp_path)
    assert first is not None
    assert lock(tmp_path) is None
    first.release()
    again = lock(tmp_path)
    assert again is not None
    again.release()
