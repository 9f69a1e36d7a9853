"""The commands of the README work on a fresh copy, in their order."""

import itertools
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from snakeslam.config import load_config
from snakeslam.studies.study import load_study

QUICK = ("recording.enabled=true", "replay ", "eq ")


def commands(checkout: Path) -> list[list[str]]:
    lines = (checkout / "README.md").read_text().splitlines()
    found = [line.split()[1:] for line in lines if line.startswith("    snakeslam ")]
    assert len(found) > 4
    return found


@pytest.fixture
def fresh(tmp_path: Path, checkout: Path) -> Path:
    """A folder with what a clone has after ``make setup``: the compiled loops too, but nothing that a command made."""
    for name in ("README.md", "pyproject.toml"):
        shutil.copy(checkout / name, tmp_path)
    for name in ("snakeslam", "server", "configs"):
        shutil.copytree(checkout / name, tmp_path / name)
    return tmp_path


def test_the_quick_ones_do_what_they_say(fresh: Path) -> None:
    """The replay line named a recording that a clone does not have."""
    said: dict[str, str] = {}
    for arguments in commands(fresh):
        if any(word in " ".join(arguments) for word in QUICK):
            done = subprocess.run(
                [sys.executable, "-m", "snakeslam", *arguments], cwd=fresh, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, done.stderr
            assert "Traceback" not in done.stderr
            said[arguments[0]] = done.stdout
            if arguments[0] == "run":
                assert "running: " in done.stderr
                assert "goes to runs/first" in done.stderr
                assert "head is null: " in done.stderr
                assert "written: runs/first" in done.stderr
    assert set(said) == {"run", "replay", "eq"}
    run, replay = (json.loads(said[name].splitlines()[-1]) for name in ("run", "replay"))
    assert run["frames"] == replay["frames"] == 100
    assert replay["tracked_fraction"] > 0.5


def test_the_others_name_what_there_is(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(fresh)
    for arguments in commands(fresh):
        settings = [after for before, after in itertools.pairwise(arguments) if before == "--set"]
        if arguments[0] == "run":
            load_config(Path(arguments[1]), settings)
        elif arguments[0] == "study":
            load_study(Path(arguments[1]))
        elif arguments[0] == "serve":
            assert arguments[1:] == ["--recordings", "runs"]
