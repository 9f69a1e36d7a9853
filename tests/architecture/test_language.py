"""Identifiers, headings of the documents and log events keep to docs/glossary.md.

The glossary's third column names the words that are not used in the sense of their row. Words that a directory still
uses stand in ``language_allowed.txt`` beside this file, one line for each directory; an entry that is no longer used
must be deleted there, so the list can only become shorter.
"""

import ast
import re
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ALLOWED = Path(__file__).with_name("language_allowed.txt")

AMBIGUOUS = {
    "hold": "a term of safety: the robot stands until it is started again",
    "order": "the order of a sequence",
    "round": "rounding of numbers",
}
"""Words of the third column that have a common second meaning; readers must judge these."""
CONTRACTS = {"take_over", "turn", "turn_by_deg", "turns"}
"""Names of the REST interface, docs/glossary.md, row "drive, steering"; they are compared whole."""
PROSE_ONLY_IDENTIFIERS = {"still"}
"""In a sentence this word also means "up to now"."""
LOG_METHODS = {"debug", "info", "warning", "error", "critical", "exception"}


@cache
def banned() -> frozenset[str]:
    """Return the words and phrases of the glossary's third column, ``way``, ``found again``."""
    cells = [line.split("|")[3] for line in (ROOT / "docs/glossary.md").read_text().splitlines() if line.count("|") > 3]
    words = {word.strip() for cell in cells for word in cell.split(",")}
    return frozenset(w for w in words if re.fullmatch(r"[a-z]+( [a-z]+)*", w)) - set(AMBIGUOUS) - {"not"}


def parts(name: str) -> str:
    """Return the words of a snake_case or CamelCase name in lower case, ``T_WI`` apart: "gait way"."""
    return " ".join(re.findall(r"[a-z]+|[A-Z]+(?![a-z])|[A-Z][a-z]*", name)).lower()


def found_in(words: str) -> set[str]:
    """Return the banned words and phrases in a text, in the plural too."""
    return {word for word in banned() if re.search(rf"\b{word}(e?s)?\b", words)}


def identifiers(tree: ast.AST) -> Iterator[str]:
    """Yield the names that a module defines: functions, classes, arguments, variables, attributes."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.arg(arg=name):
                yield name
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name
            case _:
                pass


def log_events(tree: ast.AST) -> Iterator[str]:
    """Yield the events of the structlog calls of a module."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(attr=method, value=logger), args=[ast.Constant(value=str(event)), *_]) if (
                method in LOG_METHODS and "log" in ast.unparse(logger).lower()
            ):
                yield event
            case _:
                pass


def tracked(pattern: str) -> list[Path]:
    """Return the files of the repository that match ``pattern``."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "--", pattern],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return [ROOT / name for name in listed.stdout.splitlines() if (ROOT / name).exists()]


def words_of_python(path: Path) -> set[str]:
    """Return the banned words of a module: in its name, its identifiers and its log events."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = {path.stem, *identifiers(tree)} - CONTRACTS
    in_names = set().union(*(found_in(parts(name)) for name in names))
    in_events = set().union(*(found_in(event.lower()) for event in log_events(tree)))
    return in_names | (in_events - PROSE_ONLY_IDENTIFIERS)


def words_of_document(path: Path) -> set[str]:
    """Return the banned words in the headings of a document."""
    text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return set().union(*(found_in(heading.lower()) for heading in headings)) - PROSE_ONLY_IDENTIFIERS


@cache
def used() -> dict[str, dict[str, list[str]]]:
    """Return for each directory the banned words that are used there, with the files that use them."""
    found: dict[str, dict[str, list[str]]] = {}
    for path in [*tracked("*.py"), *tracked("*.md")]:
        words = words_of_python(path) if path.suffix == ".py" else words_of_document(path)
        directory = str(path.parent.relative_to(ROOT))
        for word in words:
            found.setdefault(directory, {}).setdefault(word, []).append(path.name)
    return found


@cache
def allowed() -> dict[str, set[str]]:
    """Return for each directory the words that are not yet rewritten."""
    lines = [line for line in ALLOWED.read_text().splitlines() if line and not line.startswith("#")]
    return {line.split(":")[0]: {w.strip() for w in line.split(":")[1].split(",")} for line in lines}


@pytest.mark.parametrize("directory", sorted({*used(), *allowed()}))
def test_a_directory_uses_the_words_of_the_glossary(directory: str) -> None:
    here = used().get(directory, {})
    new = {word: files for word, files in here.items() if word not in allowed().get(directory, set())}
    assert not new, f"{directory}: not used in this sense, see docs/glossary.md: {new}"
    rewritten = allowed().get(directory, set()) - set(here)
    assert not rewritten, f"{directory}: delete from {ALLOWED.name}, no longer used: {sorted(rewritten)}"


def test_the_glossary_is_read() -> None:
    assert {"way", "picture", "found again", "room"} <= banned()
    assert found_in(parts("GaitWay")) == {"way"}
    assert found_in(parts("_found_again_px")) == {"found again"}
    assert not found_in(parts("T_WI_always"))


def test_names_and_log_events_are_found() -> None:
    tree = ast.parse("def f(beat_s, *, x=1):\n    self.mount = 1\n    _log.info('the house', room=1)\n")
    assert {"f", "beat_s", "x", "mount"} == set(identifiers(tree))
    assert list(log_events(tree)) == ["the house"]


def shrink() -> None:
    """Delete from the list what is no longer used: ``python tests/architecture/test_language.py``."""
    comments = [line for line in ALLOWED.read_text().splitlines() if line.startswith("#")]
    kept = {directory: sorted(words & set(used().get(directory, {}))) for directory, words in sorted(allowed().items())}
    lines = [f"{directory}: {', '.join(words)}" for directory, words in kept.items() if words]
    ALLOWED.write_text("\n".join([*comments, *lines]) + "\n")


if __name__ == "__main__":
    shrink()
