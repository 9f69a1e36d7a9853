"""Loops are compiled by the first second of a run, which ``make setup`` makes: never again while a robot moves."""

import subprocess
import sys
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
PROGRAM = """
import sys
from numba.core.dispatcher import Dispatcher
from snakeslam.cli import main

def forms():
    modules = [vars(module) for name, module in sys.modules.items() if name.startswith("snakeslam.")]
    loops = [o for names in modules for o in names.values() if isinstance(o, Dispatcher)]
    return {f"{loop.__module__}.{loop.__name__}": len(loop.signatures) for loop in loops}

def run(out, *settings):
    assert main(["run", "configs/sim.yaml", "--out", f"%s/{out}", *settings]) == 0
    return forms()

first = run("first", "--set", "head.controller=predictive", "--duration", "1")
assert len(first) > 30, first
later = [
    run("winds", "--set", "head.controller=predictive", "--duration", "2.5"),
    run("rolls", "--set", "gait.name=arc_rolling", "--set", "head.controller=none", "--duration", "2.5"),
]
for forms in later:
    assert forms == first, sorted(forms.items() - first.items())
"""


def test_a_robot_that_moves_waits_for_no_compiler(tmp_path: Path) -> None:
    command = [sys.executable, "-c", PROGRAM % tmp_path]
    ended = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
