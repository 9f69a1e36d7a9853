"""The deadman limit of 300 ms stands in one place; what else lasts as long has another meaning and is named here."""

import ast
from collections.abc import Iterator
from pathlib import Path

from server.api import create_api
from snakeslam.runtime.robot.deadman import DEADMAN_NS, DEADMAN_S

ROOT = Path(__file__).parents[2]
OTHERS = {
    "snakeslam/runtime/robot/blindness.py: SIGHT_NS",
    "snakeslam/runtime/nodes/robot.py: LAG_NS",
}
"""How long sight must last to count, and how far a simulation may run ahead of slam."""
SAME_TIME = {DEADMAN_S, DEADMAN_NS, DEADMAN_S * 1e3}


def constants(path: Path) -> Iterator[str]:
    """Yield the constants of a module that are as long as the deadman limit in s, ms or ns."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant) and node.value.value in SAME_TIME:
            for name in node.targets:
                yield f"{path.relative_to(ROOT)}: {ast.unparse(name)}"


def test_the_page_gets_the_deadman_limit_from_the_schema() -> None:
    assert create_api().openapi()["x-deadman-ms"] == DEADMAN_S * 1e3
    assert "declare const DEADMAN_MS" in (ROOT / "web/src/app/teleop.ts").read_text(encoding="utf-8")


def test_the_deadman_limit_is_set_in_one_module() -> None:
    modules = [*(ROOT / "snakeslam/runtime").rglob("*.py"), *(ROOT / "server").rglob("*.py")]
    found = {constant for path in modules for constant in constants(path)}
    assert found == OTHERS | {"snakeslam/runtime/robot/deadman.py: DEADMAN_S"}
