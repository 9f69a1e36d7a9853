"""The one reader of YAML: plain data, bounded, without the surprises of YAML 1.1."""

import math
from pathlib import Path

import pytest

from snakeslam.errors import InputError
from snakeslam.yaml_reader import MAX_BYTES, parse_yaml, read_yaml

BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12)
)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("off", "off"),
        ("Yes", "Yes"),
        ("true", True),
        ("FALSE", False),
        ("~", None),
        ("010", "010"),
        ("-007", "-007"),
        ("0", 0),
        ("-12", -12),
        ("0x1F", 31),
        ("0o17", 15),
        ("1_000", "1_000"),
        ("1:30", "1:30"),
        ("2024-01-01", "2024-01-01"),
        ("2024-01-01T00:00:00Z", "2024-01-01T00:00:00Z"),
        ("1e-3", 0.001),
        ("1.", 1.0),
        ("-.5", -0.5),
        (".Inf", math.inf),
        ("'1'", "1"),
        ("! 12", "12"),
        ("!!str 12", "12"),
        ("!!float 12", 12.0),
        ("!!int '12'", 12),
        ("9" * 5000, "9" * 5000),
        ("=", "="),
        ("", None),
        ("{1: a, on: b, 01: c, null: d}", {"1": "a", "on": "b", "01": "c", "null": "d"}),
        ("\ufeffa: 1", {"a": 1}),
        ("a: 1\r\nb: 2\r\n", {"a": 1, "b": 2}),
        ("%YAML 1.2\n---\na: 1\n...\n", {"a": 1}),
        ("base: &b {x: 1, y: 2}\nc: {<<: *b, x: 3}", {"base": {"x": 1, "y": 2}, "c": {"x": 3, "y": 2}}),
    ],
)
def test_values(text: str, value: object) -> None:
    found = parse_yaml(text, "it")
    assert found == value
    assert type(found) is type(value)


def test_what_opencv_writes() -> None:
    head = "%YAML:1.0 # by OpenCV\n---\n"
    matrix = "M: !!opencv-matrix\n   rows: 1\n   cols: 2\n   dt: d\n   data: [ 1., .Nan,\n       -2.5e+00 ]\n"
    for text in (head + matrix, "\ufeff# a comment\n\n" + head + matrix, "%YAML:1.0\n" + matrix):
        found = parse_yaml(text, "it")["M"]
        assert (found["rows"], found["cols"], found["dt"]) == (1, 2, "d")
        assert found["data"][::2] == [1.0, -2.5]
        assert math.isnan(found["data"][1])


def test_aliases_are_copies() -> None:
    found = parse_yaml("a: &a {x: [1]}\nb: *a\n", "it")
    found["a"]["x"].append(2)
    assert found["b"] == {"x": [1]}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a: 1\nb: 2\na: 3", "it: line 3: the key 'a' is given twice"),
        ("a:\n  {b: 1, 'b': 2}", "it: line 2: the key 'b' is given twice"),
        ("[" * 5000, "it: line 1: is nested too deeply; 32 levels are allowed"),
        ("- " * 50000, "it: line 1: is nested too deeply"),
        ("{a: " * 5000, "it: line 1: is nested too deeply"),
        (BOMB, "it: line 5: has too many values; 50000 are allowed, counted again for each alias"),
        ("a: &a [*a]", "it: line 1: *a contains itself"),
        ("a: *b", "it: line 1: *b stands for nothing"),
        ("? [a]\n: 1", "it: line 1: a key has to be plain text"),
        ("*a : 1", "it: line 1: "),
        (
            "a: !!python/object/apply:os.system [x]",
            "it: line 1: the tag !!python/object/apply:os.system is not allowed",
        ),
        ("a: !mine 3", "it: line 1: the tag !mine is not allowed"),
        ("a: !!int x", "it: line 1: 'x' is no !!int"),
        ("a: !!binary aGk=", "it: line 1: the tag !!binary is not allowed"),
        ("a: {<<: 3}", "it: line 1: << takes a mapping"),
        ("a: 1\n---\nb: 1", "it: line 2: a second document begins here"),
        ("a: \x00", "it: is no YAML: unacceptable character #x0000"),
        ("a: \udc80", "it: is no YAML: unacceptable character #xdc80"),
        ('a: "\\ud800"', "it: line 1: '\\ud800' has a character that cannot be printed"),
        ('"a\\0": 1', "it: line 1: 'a\\x00' has a character that cannot be printed"),
        ("a: b: c", "it: line 1: mapping values are not allowed here"),
        ("a: 'b", "it: line 1: found unexpected end of stream"),
        ("x" * (MAX_BYTES + 1), "it: is too large (allowed: up to 256 KiB)"),
    ],
)
def test_what_is_refused_is_one_line(text: str, problem: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_yaml(text, "it")
    assert str(caught.value).startswith(problem)
    assert "\n" not in str(caught.value)


def test_files(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: \xc2\xb5\n")
    assert read_yaml(path) == {"a": "µ"}
    for data, problem in ((b"\xff\xfea", "is not a text file"), (b"#" * 300_000, "is too large")):
        path.write_bytes(data)
        with pytest.raises(InputError, match=problem):
            read_yaml(path)
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        read_yaml(tmp_path)
    with pytest.raises(InputError, match="cannot be read: embedded null byte"):
        read_yaml(tmp_path / "a\0b")
    with pytest.raises(InputError, match="is too large"):
        read_yaml(Path("/dev/zero"))
    with pytest.raises(FileNotFoundError):
        read_yaml(tmp_path / "none.yaml")
