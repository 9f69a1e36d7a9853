"""JSON of other programs, strictly by RFC 8259: all else is a ValueError, also what Python's reader accepts."""

import json
from pathlib import Path
from typing import Any

MAX_BYTES = 4 * 1024 * 1024


def parse(text: str | bytes) -> Any:
    """Return the value of ``text``; ValueError for anything else, NaN, lone surrogates and deep nesting too."""
    try:
        value = json.loads(text, parse_constant=_refuse)
        # Numbers beyond a float, and lone surrogates, come in by escapes and exponents and could not be sent on.
        json.dumps(value, allow_nan=False, ensure_ascii=False).encode()
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    return value


def read(path: Path) -> Any:
    """Return the value of a file of up to 4 MiB; ValueError or OSError where there is none."""
    if not path.is_file():
        raise ValueError("no regular file")
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise ValueError("too large")
    return parse(data)


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is no JSON")
