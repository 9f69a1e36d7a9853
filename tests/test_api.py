"""The public API: its names, an import that costs nothing, and the example that uses it."""

import inspect
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import snakeslam
from tests.small_recordings import write_euroc

HEAVY = ("numpy", "pybullet", "cv2", "pydantic", "numba", "fastapi", "scipy")


def python(*arguments: str, cwd: Path) -> str:
    done = subprocess.run([sys.executable, *arguments], cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_the_package_loads_nothing(checkout: Path) -> None:
    loaded = python("-c", "import sys, snakeslam, json; print(json.dumps(sorted(sys.modules)))", cwd=checkout)
    assert not [name for name in json.loads(loaded) if name.split(".")[0] in HEAVY or name.startswith("snakeslam.")]


def test_running_nothing_needs_no_simulator(checkout: Path) -> None:
    use = "import sys, snakeslam as s; s.load_config(); s.run, s.replay, s.study; print('pybullet' in sys.modules)"
    assert python("-c", use, cwd=checkout).strip() == "False"


@pytest.mark.parametrize("name", snakeslam.__all__)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    public = getattr(snakeslam, name)
    assert inspect.getdoc(public)
    assert name in dir(snakeslam)
    assert public.__module__ == snakeslam._HOMES[name]


def test_other_names_are_not() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'walk'"):
        snakeslam.walk  # type: ignore[attr-defined]  # noqa: B018


def test_the_example_is_short_and_runs(checkout: Path, tmp_path: Path) -> None:
    example = checkout / "examples" / "gaits.py"
    assert len(example.read_text().splitlines()) <= 16
    said = python(str(example), cwd=tmp_path)
    for gait in ("serpentine", "sidewinding"):
        assert re.search(rf"^{gait}: \d\.\d\d m of path, error \d+\.\d mm", said, re.MULTILINE)
    assert len(list((tmp_path / "runs").iterdir())) == 2


def test_a_recording_is_replayed(tmp_path: Path) -> None:
    result = snakeslam.replay(write_euroc(tmp_path / "clip"), out=tmp_path / "run")
    assert isinstance(result, snakeslam.RunResult)
    assert isinstance(result.metrics, snakeslam.Metrics)
    assert (tmp_path / "run" / "run.json").exists()
    with pytest.raises(snakeslam.InputError, match="nowhere"):
        snakeslam.replay("nowhere", out=tmp_path / "other")


def test_a_study_that_is_not_there_is_one_line() -> None:
    with pytest.raises(snakeslam.InputError, match=r"nowhere\.yaml"):
        snakeslam.study("nowhere.yaml")
