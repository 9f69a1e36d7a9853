"""Measure where the time of a simulated run goes, against the budgets; ``make bench`` prints the table.

``python -m bench [SECONDS]`` measures the time, ``python -m bench consistency [SEEDS]`` the NEES, ``python -m bench
turn`` a commanded turn, ``python -m bench live [SECONDS]`` the nodes beside the server.
"""

import functools
import platform
import sys
from collections import defaultdict
from contextlib import closing
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from bench import consistency, live, turn
from snakeslam.backends.sim.camera import Camera
from snakeslam.backends.sim.physics import SnakePhysics
from snakeslam.backends.sim.renderer import Renderer
from snakeslam.config import load_config
from snakeslam.control import Control
from snakeslam.estimation import sliding_window
from snakeslam.estimation.frontend import Frontend
from snakeslam.estimation.sliding_window import SlidingWindow
from snakeslam.estimation.state import State
from snakeslam.mapping.keyframes import KeyframeMapper
from snakeslam.messages import GaitCommand
from snakeslam.runtime.assembly import build_backend, build_control, build_slam
from snakeslam.runtime.lockstep import Loop
from snakeslam.slam import Slam
from snakeslam.studies.recorder import Recorder

SECONDS = 10.0
SETTING = "head.controller=predictive"
"""The dearest control."""
WARM_UP_S = 1.0
# Where, what, budget in ms (None: reported only).
STAGES: tuple[tuple[Any, str, str, float | None], ...] = (
    (Control, "step", "control, one 100 Hz step", 0.5),
    (SnakePhysics, "step", "simulator: one physics step", 1.3),
    (Renderer, "render", "simulator: one picture drawn", 10.0),
    (Camera, "expose", "simulator: its noise, blur, holes", 5.0),
    (Frontend, "process", "estimator: front-end", None),
    (State, "propagate", "estimator: propagation", None),
    (SlidingWindow, "correct", "estimator: correction, all of it", None),
    (sliding_window, "update", "estimator: of that, the iterated update", None),
    (KeyframeMapper, "update", "map: one frame", 5.0),
)


def watch(owner: Any, name: str, times_ms: list[float]) -> None:
    """Replace ``owner.name`` by itself with a clock around it."""
    inner = getattr(owner, name)

    @functools.wraps(inner)
    def timed(*args: Any, **kwargs: Any) -> Any:
        started = perf_counter()
        try:
            return inner(*args, **kwargs)
        finally:
            times_ms.append((perf_counter() - started) * 1e3)

    setattr(owner, name, timed)


def run(seconds: float) -> tuple[Recorder, float]:
    """Run the default simulation and return what it recorded and its wall time."""
    config = load_config(None, [SETTING])
    recorder = Recorder()
    with closing(build_backend(config)) as backend:
        loop = Loop(backend, build_control(config, backend), build_slam(config, backend), recorder)
        assert loop.control is not None
        loop.control.command(GaitCommand(0, config.gait.name))
        started = perf_counter()
        while backend.t_ns < seconds * 1e9:
            loop.step()
        return recorder, perf_counter() - started


def main() -> None:
    if sys.argv[1:2] == ["consistency"]:
        consistency.main()
        return
    if sys.argv[1:2] == ["live"]:
        live.main(*map(float, sys.argv[2:3]))
        return
    if sys.argv[1:2] == ["turn"]:
        turn.main()
        return
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    times: dict[str, list[float]] = defaultdict(list)
    for owner, name, label, _ in STAGES:
        watch(owner, name, times[label])
    watch(Slam, "process", times["slam"])
    recorder, wall_s = run(seconds)
    frame_ms = np.array(recorder.frame_ms[int(WARM_UP_S * 20) :])
    table = Table("stage", "mean ms", "p95 ms", "budget ms", title=f"{seconds:g} s of configs/sim.yaml, {SETTING}")
    for _, _, label, budget in STAGES:
        ms = np.array(times[label]) if times[label] else np.array([np.nan])
        table.add_row(
            label, f"{ms.mean():.3f}", f"{np.percentile(ms, 95):.3f}", "" if budget is None else f"{budget:g}"
        )
    table.add_row(
        "estimator and map, one frame", f"{frame_ms.mean():.2f}", f"{np.percentile(frame_ms, 95):.2f}", "9 / 14"
    )
    console = Console()
    console.print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    console.print(table)
    console.print(f"real-time factor of the whole in one process: {seconds / wall_s:.2f}")


if __name__ == "__main__":
    main()
