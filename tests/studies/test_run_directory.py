"""A run directory appears whole or not at all."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from snakeslam.errors import InputError
from snakeslam.studies.run_directory import default_out, new_directory


def tree(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_it_appears_at_the_end(tmp_path: Path) -> None:
    out = tmp_path / "a" / "run"
    with new_directory(out) as part:
        (part / "file").write_text("x")
        assert not out.exists()
    assert tree(tmp_path) == ["a", "a/run", "a/run/file"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_a_failure_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    def fail() -> None:
        with new_directory(tmp_path / "a" / "b" / "run") as part:
            (part / "file").write_text("x")
            raise error

    with pytest.raises(error):
        fail()
    assert tree(tmp_path) == []


def test_an_empty_folder_may_be_filled(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with new_directory(tmp_path / "run") as part:
        (part / "file").touch()
    assert tree(tmp_path) == ["run", "run/file"]


def test_what_is_there_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine").write_text("keep")
    (tmp_path / "note").write_text("keep")
    for name in ("run", "note"):
        with pytest.raises(InputError, match=f"{name}: exists already"), new_directory(tmp_path / name):
            pass
    assert tree(tmp_path) == ["note", "run", "run/mine"]


def test_a_file_on_the_way_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "note").write_text("keep")
    with pytest.raises(InputError, match="the output folder cannot be made"), new_directory(tmp_path / "note" / "run"):
        pass
    assert tree(tmp_path) == ["note"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_no_permission_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "closed").mkdir(mode=0o500)
    with (
        pytest.raises(InputError, match="cannot be made: Permission denied"),
        new_directory(tmp_path / "closed" / "x" / "run"),
    ):
        pass
    assert tree(tmp_path) == ["closed"]


def test_no_permission_as_the_system_says_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same for root, to whom the system never says it."""

    def refuse(self: Path, *args: object, **kwargs: object) -> None:
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(InputError, match="cannot be made: Permission denied"), new_directory(tmp_path / "run"):
        pass
    assert tree(tmp_path) == []


def test_the_default_is_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    first = default_out("name")
    assert first.parent == Path("runs")
    assert first.name.endswith("-name")
    first.mkdir(parents=True)
    assert not default_out("name").exists()


def test_a_name_is_claimed_at_the_start(tmp_path: Path) -> None:
    """Two runs of one name in the same second: the second worked to its end and was lost at the last rename."""
    with new_directory(tmp_path / "run") as part:
        (part / "file").touch()
        with pytest.raises(InputError, match="run: is being written by another run"), new_directory(tmp_path / "run"):
            pass
    assert tree(tmp_path) == ["run", "run/file"]


def test_runs_of_one_name_in_one_second_get_names_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with new_directory(None, "a") as first, new_directory(None, "a") as second, new_directory(None, "a") as third:
        assert len({first.out, second.out, third.out}) == 3
        for part in (first, second, third):
            (part / "file").touch()
    assert len(list((tmp_path / "runs").glob("*-a*/file"))) == 3
    assert {path.name for path in (tmp_path / "runs").iterdir()} == {new.out.name for new in (first, second, third)}


def test_a_result_is_kept_when_its_name_was_taken_meanwhile(tmp_path: Path) -> None:
    with new_directory(tmp_path / "run") as new:
        (new / "file").touch()
        (tmp_path / "run").mkdir()
        (tmp_path / "run" / "theirs").touch()
        (tmp_path / "run-2").touch()
    assert new.out == tmp_path / "run-3"
    assert tree(tmp_path) == ["run", "run-2", "run-3", "run-3/file", "run/theirs"]


def test_what_a_killed_run_left_is_cleared_by_the_next(tmp_path: Path) -> None:
    killed = "import os, sys; from pathlib import Path; from snakeslam.studies.run_directory import new_directory\n"
    killed += "with new_directory(Path(sys.argv[1])) as part:\n (part / 'half').touch(); os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", killed, str(tmp_path / "old")], check=False)
    (tmp_path / ".theirs.part").mkdir()
    (tmp_path / ".theirs.part" / "file").touch()
    assert tree(tmp_path) != [".theirs.part", ".theirs.part/file"]
    with new_directory(tmp_path / "run"):
        pass
    assert tree(tmp_path) == [".theirs.part", ".theirs.part/file", "run"]
