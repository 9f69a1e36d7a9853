"""Rules of the repository that no linter knows."""

import dataclasses
import re
import subprocess
from pathlib import Path

import pytest

from snakeslam import messages

ROOT = Path(__file__).parents[2]
TRACKED = [
    ROOT / name
    for name in subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
]
OWN_TEXT = [p for p in TRACKED if p.suffix in {".py", ".md", ".toml", ".yaml", ".yml", ".ts", ".css", ".html", ".json"}]


@pytest.mark.parametrize("path", OWN_TEXT, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_file_speaks_of_one_machine(path: Path) -> None:
    """Paths of somebody's machine and addresses of package registries are nobody else's business."""
    if path == Path(__file__) or not path.exists():
        return
    found = re.findall(r"/work/\w+|/root/|/home/\w+|registry\.npmjs|files\.pythonhosted|pypi\.org", path.read_text())
    assert not found


def test_lock_files_name_no_registry() -> None:
    for path in (ROOT / "requirements.lock", ROOT / "web/package-lock.json"):
        assert "://" not in re.sub(r'"funding": \[[^\]]*\]|"(url|funding)": "[^"]*"', "", path.read_text()), path


def test_every_message_is_frozen_and_slotted() -> None:
    types = [t for t in vars(messages).values() if isinstance(t, type) and dataclasses.is_dataclass(t)]
    assert len(types) > 8
    for message in types:
        assert message.__dataclass_params__.frozen, message  # type: ignore[attr-defined]
        assert "__slots__" in vars(message), message


def test_only_the_command_line_and_the_server_print() -> None:
    """Logs are structured; what a user sees is written by the ways in."""
    speakers = {"snakeslam/cli.py"}
    for path in (ROOT / "snakeslam").rglob("*.py"):
        if str(path.relative_to(ROOT)) not in speakers:
            assert not re.search(r"^\s*print\(", path.read_text(), re.M), path
