"""The one reader of YAML: configurations, studies, calibrations, sensor files.

PyYAML parses the syntax; values are built here by YAML 1.2's core schema and not by YAML 1.1, in which ``off`` is
false, ``010`` is 8, ``1:30`` is 90 and ``2024-01-01`` is a date. Keys are text, a duplicate key is an error, only plain
data is built, and size, depth and the expansion of aliases are bounded.
"""

import copy
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from snakeslam.errors import InputError

MAX_BYTES = 256 * 1024
"""PyYAML reads about 90 kB a second; a configuration has 14 kB."""
MAX_DEPTH = 32
MAX_VALUES = 50_000
"""Scalars, lists and mappings of a document, counted again for each alias."""
LONGEST_NUMBER = 100
INT = re.compile(r"[-+]?(0|[1-9][0-9]*)|0x[0-9a-fA-F]+|0o[0-7]+")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
LEADING_ZERO = re.compile(r"[-+]?0[0-9]+")
"""``010`` is 8 in YAML 1.1 and 10 in YAML 1.2; here it stays text."""
INFINITE = {".inf": float("inf"), "+.inf": float("inf"), "-.inf": float("-inf"), ".nan": float("nan")}
WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}
TAG = "tag:yaml.org,2002:"
LISTS, MAPPINGS = ("seq",), ("map", "opencv-matrix")
"""OpenCV marks its matrices: mappings of rows, cols, dt and data."""
UNPRINTABLE = re.compile("[\x00-\x08\x0b-\x1f\x7f\ud800-\udfff]")
"""Characters that an escape in quoted text can produce and that no file name, title or message may have."""
OPENCV_HEAD = re.compile(r"\A((?:[ \t]*(?:#.*)?\r?\n)*)%YAML:.*")
"""OpenCV's first line, which is not a valid YAML directive."""


def read_yaml(path: Path) -> Any:
    """Return the content of the YAML file ``path``: None, bool, int, float, str, lists, and dicts with text keys.

    InputError, one line with file and line number, when it cannot be read or has something that is not allowed;
    FileNotFoundError when there is no such file.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if len(data) > MAX_BYTES:
        raise InputError(str(path), "is too large", f"up to {MAX_BYTES // 1024} KiB")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(str(path), "is not a text file", "UTF-8") from error
    return parse_yaml(text, str(path))


def parse_yaml(text: str, where: str) -> Any:
    """Return the content of the single YAML document ``text``, None if empty; InputError: ``where``, line, problem."""
    if len(text) > MAX_BYTES:
        raise InputError(where, "is too large", f"up to {MAX_BYTES // 1024} KiB")
    text = OPENCV_HEAD.sub(r"\1", text.removeprefix("\ufeff"), count=1)
    try:
        return _Builder(yaml.parse(text, Loader=yaml.SafeLoader)).document()
    except yaml.MarkedYAMLError as error:
        line = f": line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise InputError(f"{where}{line}", _one_line(error.problem or "is no YAML")) from error
    except yaml.YAMLError as error:
        raise InputError(where, f"is no YAML: {_one_line(str(error))}") from error


def _one_line(text: str) -> str:
    return " ".join(text.split())


def scalar(text: str) -> bool | int | float | str | None:
    """Return the value of a plain (unquoted) scalar; it is text unless it clearly has another type."""
    if text.lower() in WORDS and text in (text.lower(), text.capitalize(), text.upper()):
        return WORDS[text.lower()]
    if len(text) > LONGEST_NUMBER or LEADING_ZERO.fullmatch(text):
        return text
    if INT.fullmatch(text):
        return int(text, 0)
    if FLOAT.fullmatch(text):
        return float(text)
    return INFINITE.get(text.lower(), text)


class _Builder:
    """Builds values from PyYAML's events."""

    def __init__(self, events: Iterator[yaml.Event]) -> None:
        self._events = events
        self._anchors: dict[str, tuple[Any, int]] = {}
        self._open: set[str] = set()
        self._values = 0

    def document(self) -> Any:
        """Return the value of the only document."""
        value: Any = None
        for number, event in enumerate(event for event in self._events if isinstance(event, yaml.DocumentStartEvent)):
            if number:
                raise _error(event, "a second document begins here; one is allowed")
            value = self._value(next(self._events), 0)
        return value

    def _value(self, event: yaml.Event, depth: int) -> Any:
        if depth > MAX_DEPTH:
            raise _error(event, f"is nested too deeply; {MAX_DEPTH} levels are allowed")
        if isinstance(event, yaml.AliasEvent):
            return self._alias(event)
        before, anchor = self._values, getattr(event, "anchor", None)
        self._count(event, 1)
        if anchor is not None:
            self._open.add(anchor)
        value = self._new_value(event, depth)
        if anchor is not None:
            self._open.discard(anchor)
            self._anchors[anchor] = value, self._values - before
        return value

    def _new_value(self, event: yaml.Event, depth: int) -> Any:
        if isinstance(event, yaml.SequenceStartEvent):
            _check_tag(event, event.tag, LISTS)
            return [self._value(item, depth + 1) for item in self._until(yaml.SequenceEndEvent)]
        if isinstance(event, yaml.MappingStartEvent):
            _check_tag(event, event.tag, MAPPINGS)
            return self._mapping(depth)
        assert isinstance(event, yaml.ScalarEvent)
        return _scalar(event)

    def _until(self, end: type[yaml.Event]) -> Iterator[yaml.Event]:
        while not isinstance(event := next(self._events), end):
            yield event

    def _mapping(self, depth: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        merged: list[dict[str, Any]] = []
        for event in self._until(yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent):
                raise _error(event, "a key has to be plain text")
            _check_text(event)
            key, value = event.value, self._value(next(self._events), depth + 1)
            if key == "<<" and event.style is None:
                merged += _merged(event, value)
            elif key in found:
                raise _error(event, f"the key {key[:60]!r} is given twice")
            else:
                found[key] = value
        for base in merged:
            found = base | found
        return found

    def _alias(self, event: yaml.AliasEvent) -> Any:
        """Return a copy, so that changing one value does not change the other."""
        name = str(event.anchor)
        if name in self._open:
            raise _error(event, f"*{name} contains itself")
        if name not in self._anchors:
            raise _error(event, f"*{name} stands for nothing: there is no &{name} before it")
        value, size = self._anchors[name]
        self._count(event, size)
        return copy.deepcopy(value)

    def _count(self, event: yaml.Event, size: int) -> None:
        self._values += size
        if self._values > MAX_VALUES:
            raise _error(event, f"has too many values; {MAX_VALUES} are allowed, counted again for each alias")


def _merged(event: yaml.Event, value: Any) -> list[dict[str, Any]]:
    """Return the mappings of ``<<: *base`` or ``<<: [*first, *second]``; an earlier one wins."""
    bases: list[Any] = value if isinstance(value, list) else [value]
    if not all(isinstance(base, dict) for base in bases):
        raise _error(event, "<< takes a mapping, or a list of mappings")
    return bases


def _scalar(event: yaml.ScalarEvent) -> bool | int | float | str | None:
    _check_text(event)
    tag = event.tag
    if tag is None or tag == "!":
        return scalar(event.value) if tag is None and event.style is None else event.value
    if tag == TAG + "str":
        return event.value
    _check_tag(event, tag, ("null", "bool", "int", "float"))
    value = scalar(event.value)
    kinds = {"null": type(None), "bool": bool, "int": int, "float": float}
    kind = kinds[tag.removeprefix(TAG)]
    if kind is float and type(value) is int:
        return float(value)
    if type(value) is not kind:
        raise _error(event, f"{event.value[:40]!r} is no !!{tag.removeprefix(TAG)}")
    return value


def _check_text(event: yaml.ScalarEvent) -> None:
    if UNPRINTABLE.search(event.value):
        raise _error(event, f"{event.value[:40]!r} has a character that cannot be printed")


def _check_tag(event: yaml.Event, tag: str | None, known: tuple[str, ...]) -> None:
    if tag is not None and tag != "!" and tag.removeprefix(TAG) not in known:
        raise _error(event, f"the tag {tag.replace(TAG, '!!')[:60]} is not allowed")


def _error(event: yaml.Event, problem: str) -> yaml.MarkedYAMLError:
    # The stubs declare the mark type of another parser here.
    return yaml.MarkedYAMLError(problem=problem, problem_mark=event.start_mark)  # pyright: ignore[reportArgumentType]
