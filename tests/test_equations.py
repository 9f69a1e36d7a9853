"""The list of equations is complete, and what it points to exists."""

import importlib
import re
from pathlib import Path
from typing import Any

import pytest

from snakeslam.equations import EQUATIONS, Equation, equation
from snakeslam.errors import InputError

NAMED = re.compile(r"Eq\. \((\d+)\)(?:-\((\d+)\))?")


def numbers_named(text: str) -> set[int]:
    """The numbers in "Eq. (1)" and "Eq. (22)-(24)"."""
    found: set[int] = set()
    for first, last in NAMED.findall(text):
        found |= set(range(int(first), int(last or first) + 1))
    return found


def resolve(name: str) -> Any:
    """The object of a dotted name: the longest importable module, then attributes."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            found = getattr(found, part)
        return found
    raise ModuleNotFoundError(name)


def test_the_list_is_complete() -> None:
    assert list(EQUATIONS) == list(range(1, 42))
    for one in EQUATIONS.values():
        assert one.title
        assert one.formula
        assert (one.home is None) == (one.test is None), f"Eq. ({one.number}) is built without a test or tested unbuilt"


BUILT = [one for one in EQUATIONS.values() if one.home is not None]


@pytest.mark.parametrize("one", BUILT, ids=lambda one: str(one.number))
def test_a_home_names_its_equation_and_so_does_its_test(one: Any, checkout: Path) -> None:
    assert one.number in numbers_named(resolve(one.home).__doc__ or ""), one.home
    assert one.number in numbers_named((checkout / one.test).read_text()), one.test


def test_what_the_code_says_it_implements_is_in_the_list(checkout: Path) -> None:
    """A function whose docstring begins to speak of an equation gives it a home; the list may not forget it."""
    for path in (checkout / "snakeslam").rglob("*.py"):
        if path.name == "equations.py":
            continue
        for number in numbers_named(path.read_text()):
            assert EQUATIONS[number].home is not None, f"{path.name} names Eq. ({number}), the list has no home for it"


def test_an_equation_is_printed_with_its_home_and_test() -> None:
    text = equation(1).describe()
    assert "Eq. (1)" in text
    assert "home: snakeslam.gaits.parametric.joint_angles" in text
    assert "test: tests/gaits/" in text
    assert "home: not built yet" in Equation(99, "Later", "x = y").describe()


@pytest.mark.parametrize("number", [0, 42, -1])
def test_the_paper_has_41_equations(number: int) -> None:
    with pytest.raises(InputError, match="1 to 41"):
        equation(number)
