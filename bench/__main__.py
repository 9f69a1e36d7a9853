"""Measure where the time of a simulated run goes, against the budgets; ``make bench`` prints the table.

``python -m bench [SECONDS]`` measures the time, ``python -m bench consistency [SEEDS]`` the NEES, ``python -m bench
turn`` a commanded turn, ``python -m bench live [SECONDS]`` the nodes beside the server, ``python -m bench estop
[SECONDS]`` the E-stop under floods, ``python -m bench page [SECONDS]`` the whole stack with a browser and many viewers.
"""

import functools
import os
import platform
import sys
from array import array
from collections import defaultdict
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from bench import consistency, floods, live, page, soak, turn
from snakeslam.backends.sim.camera import Camera
from snakeslam.backends.sim.physics import SnakePhysics
from snakeslam.backends.sim.renderer import Renderer
from snakeslam.config import load_config
from snakeslam.control import Control
from snakeslam.estimation.filter.state import State
from snakeslam.estimation.frontend.tracking import Frontend
from snakeslam.estimation.vio import window
from snakeslam.estimation.vio.window import SlidingWindow
from snakeslam.mapping.keyframes import KeyframeMapper
from snakeslam.messages import CameraFrame, Float, GaitCommand, GroundTruth, JointTarget, Packet, SlamUpdate
from snakeslam.runtime.assembly.build import build_backend, build_control
from snakeslam.runtime.session.lockstep import build_loop
from snakeslam.slam import Slam

SECONDS = 10.0
SETTING = "head.controller=predictive"
"""The dearest control."""
WARM_UP_S = 1.0
THERE_S = 60.0
"""Time for which it drives in one direction before it drives back: a wall is in front of it."""
SHARE = 10
"""The times of the first and of the last tenth of a long run are reported, to show whether they grow."""
PHYSICS = "simulator: one physics step"
# Where, what, budget in ms (None: reported only).
STAGES: tuple[tuple[Any, str, str, float | None], ...] = (
    (Control, "step", "control, one 100 Hz step", 0.5),
    (SnakePhysics, "step", PHYSICS, 0.6),
    (Renderer, "render", "simulator: one image drawn", 10.0),
    (Camera, "expose", "simulator: its noise, blur, holes", 5.0),
    (Frontend, "process", "estimator: front-end", None),
    (State, "propagate", "estimator: propagation", None),
    (SlidingWindow, "correct", "estimator: correction, all of it", None),
    (window, "update", "estimator: of that, the iterated update", None),
    (KeyframeMapper, "update", "map: one frame", 5.0),
)


def watch(owner: Any, name: str, times_ms: "array[float]") -> None:
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


class FrameTimes:
    """A sink that keeps nothing but the time of each frame, so that what grows is the estimator's."""

    def __init__(self) -> None:
        self.frame_ms: list[float] = []

    def on_target(self, target: JointTarget) -> None:
        """Forget it."""

    def on_packet(self, packet: Packet) -> None:
        """Forget it."""

    def on_truth(self, truth: Sequence[GroundTruth]) -> None:
        """Forget it."""

    def on_update(self, update: SlamUpdate, frame: CameraFrame, slam_ms: float) -> None:
        """Keep the time."""
        del update, frame
        self.frame_ms.append(slam_ms)


def resident_mb() -> float:
    """Return what this process holds."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def run(seconds: float, memory_mb: list[float]) -> tuple[list[float], float]:
    """Run the default simulation; return the frames' times in ms and its wall time, add what it held at each tenth."""
    config = load_config(None, [SETTING])
    times = FrameTimes()
    with closing(build_backend(config)) as backend:
        control = build_control(config, backend)
        assert control is not None
        loop = build_loop(config, backend, times, control=control)
        started = perf_counter()
        while backend.t_ns < seconds * 1e9:
            if backend.t_ns % round(THERE_S * 1e9) == 0:
                direction = -1.0 if backend.t_ns // round(THERE_S * 1e9) % 2 else 1.0
                control.command(GaitCommand(backend.t_ns, config.gait.name, drive=direction))
            if len(memory_mb) < SHARE and backend.t_ns >= len(memory_mb) * seconds * 1e9 / SHARE:
                memory_mb.append(resident_mb())
            loop.step()
        memory_mb.append(resident_mb())
        return times.frame_ms, perf_counter() - started


def ends(values: Float) -> tuple[Float, Float]:
    """Return the first and the last tenth."""
    tenth = max(len(values) // SHARE, 1)
    return values[:tenth], values[-tenth:]


def main() -> None:
    if sys.argv[1:2] == ["consistency"]:
        consistency.main()
        return
    if sys.argv[1:2] == ["live"]:
        live.main(*map(float, sys.argv[2:3]))
        return
    if sys.argv[1:2] == ["page"]:
        page.main(*map(float, sys.argv[2:3]))
        return
    if sys.argv[1:2] == ["estop"]:
        floods.main(*map(float, sys.argv[2:3]))
        return
    if sys.argv[1:2] == ["soak"]:
        soak.main(*map(int, sys.argv[2:5]))
        return
    if sys.argv[1:2] == ["turn"]:
        turn.main()
        return
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    # Arrays, for what grows is to be the estimator's.
    times: dict[str, array[float]] = defaultdict(lambda: array("d"))
    for owner, name, label, _ in STAGES:
        watch(owner, name, times[label])
    watch(Slam, "process", times["slam"])
    memory_mb: list[float] = []
    every_ms, wall_s = run(seconds, memory_mb)
    frame_ms = np.array(every_ms[int(WARM_UP_S * 20) :])
    table = Table("stage", "mean ms", "p95 ms", "budget ms", title=f"{seconds:g} s of configs/sim.yaml, {SETTING}")
    for _, _, label, budget in STAGES:
        ms = np.array(times[label]) if times[label] else np.array([np.nan])
        table.add_row(
            label, f"{ms.mean():.3f}", f"{np.percentile(ms, 95):.3f}", "" if budget is None else f"{budget:g}"
        )
    table.add_row(
        "estimator and map, one frame", f"{frame_ms.mean():.2f}", f"{np.percentile(frame_ms, 95):.2f}", "9 / 14"
    )
    # A step of the physics is the same work at all times: it tells how fast the machine was.
    for label, ms, step_ms in zip(("first", "last"), ends(frame_ms), ends(np.array(times[PHYSICS])), strict=True):
        name = f"of that, the {label} tenth, with physics at {step_ms.mean():.3f}"
        table.add_row(name, f"{ms.mean():.2f}", f"{np.percentile(ms, 95):.2f}", "")
    console = Console()
    console.print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}")
    console.print(table)
    memory_text = f"{memory_mb[1]:.0f} MB after a tenth, {memory_mb[-1]:.0f} at the end"
    console.print(f"memory: {memory_text}")
    console.print(f"real-time factor of the whole in one process: {seconds / wall_s:.2f}")


if __name__ == "__main__":
    main()
