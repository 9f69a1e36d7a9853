"""docs/live.md and the tests agree: each row of its tables of rules and claims names tests that exist."""

import re
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
DIRECTORIES = ("faults", "server", "runtime")
HEADS = ("| what | rule | test", "| claim | test |")


def rows(head: str) -> list[str]:
    """Return the rows of the table of docs/live.md whose first line begins with ``head``."""
    lines = (CHECKOUT / "docs" / "live.md").read_text(encoding="utf-8").splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith(head)) + 2
    last = next(k for k in range(first, len(lines)) if not lines[k].startswith("|"))
    return lines[first:last]


def existing_tests() -> set[str]:
    files = [path for directory in DIRECTORIES for path in (CHECKOUT / "tests" / directory).glob("test_*.py")]
    return {name for path in files for name in re.findall(r"^def (test_\w+)\(", path.read_text("utf-8"), re.MULTILINE)}


@pytest.mark.parametrize("row", [row for head in HEADS for row in rows(head)])
def test_a_row_names_tests_that_exist(row: str) -> None:
    named = re.findall(r"`(test_\w+)`", row.rsplit("|", 2)[1])
    assert named, "no test is named"
    assert set(named) <= existing_tests()


def test_the_tables_are_found() -> None:
    assert [len(rows(head)) > 5 for head in HEADS] == [True, True]
