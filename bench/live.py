"""The live nodes as they run beside the server: CPU and memory of each process, the control period, the E-stop.

``python -m bench live [SECONDS]``; the budgets are those of a machine that has nothing else to do.
"""

import os
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from snakeslam.config import load_config
from snakeslam.messages import GaitCommand
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.commands import EStop, ResetEStop, SetGait
from snakeslam.runtime.bus.topics import SENSORS, Started, Tick
from snakeslam.runtime.session.estop import EStopMemory
from snakeslam.runtime.session.host import NodesHost

SECONDS = 20.0
PRESSES, FLOOD = 40, 50
TICKS_PER_S = 100.0
Row = tuple[str, str, str]


def processes(pid: int) -> dict[int, str]:
    """Return the processes below ``pid`` by number, named by what runs in them."""
    found: dict[int, str] = {}
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            found |= {child: (Path(f"/proc/{child}/comm").read_text().strip())} | processes(child)
    return found


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def memory_mb(pid: int) -> float:
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4096 / 1e6


class Session:
    """A host with everything it reported, counted."""

    def __init__(self) -> None:
        self.newest: dict[type, Any] = {}
        self.counts: Counter[str] = Counter()
        self.host = NodesHost(SessionSpec(load_config(), autostart=True), EStopMemory())
        self.stamps_ns: list[int] = []
        self.host.start(self._on_report)

    def _on_report(self, report: Any) -> None:
        self.newest[type(report)] = report
        self.counts[type(report).__name__] += 1

    def pass_time(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.host.pulse()
            time.sleep(0.05)

    def wait_for(self, done: Any) -> None:
        while not done():
            self.host.pulse()
            time.sleep(0.001)

    def listen(self) -> Bus:
        """Note when the robot node took each of its steps."""
        bus = Bus(self.host.link)
        bus.subscribe(SENSORS, lambda sensors: self.stamps_ns.append(sensors.stamp_ns))
        return bus


def estop_ms(session: Session) -> list[float]:
    """Return the time from each press, amid other commands, until the robot node's own word that it is latched."""
    times_ms: list[float] = []
    for k in range(PRESSES):
        for _ in range(FLOOD):
            session.host.send(SetGait(GaitCommand(0, "serpentine")))
        pressed = time.perf_counter()
        session.host.send(EStop(f"press {k}"))
        session.wait_for(lambda k=k: session.newest[Tick].estop_reason == f"press {k}")
        times_ms.append((time.perf_counter() - pressed) * 1e3)
        session.host.send(ResetEStop())
        session.wait_for(lambda: session.newest[Tick].estop_reason is None)
    return times_ms


def spread(values: np.ndarray, percent: float) -> str:
    return f"{np.median(values):.1f}, {np.percentile(values, percent):.1f}"


def rows(seconds: float) -> list[Row]:
    """Run the default simulation live and return the rows of its report."""
    session = Session()
    try:
        session.wait_for(lambda: Started in session.newest and Tick in session.newest)
        session.wait_for(lambda: session.newest[Tick].moving)
        bus = session.listen()
        session.pass_time(3.0)
        names = processes(os.getpid())
        before, own = {pid: cpu_s(pid) for pid in names}, time.process_time()
        started, t_ns = time.monotonic(), session.newest[Tick].t_ns
        session.stamps_ns.clear()
        session.pass_time(seconds)
        simulated_s = (session.newest[Tick].t_ns - t_ns) * 1e-9
        factor = simulated_s / (time.monotonic() - started)
        table: list[Row] = [("pace against real time", f"{factor:.2f}", "1.0")]
        for pid, name in names.items():
            ms = (cpu_s(pid) - before[pid]) / simulated_s * 1e3
            table.append((f"{name}: CPU ms per simulated s, memory", f"{ms:.0f}, {memory_mb(pid):.0f} MB", ""))
        ms = (time.process_time() - own) / simulated_s * 1e3
        table.append(("this end of the bus: CPU ms per simulated s", f"{ms:.0f}", ""))
        periods_ms = np.diff(session.stamps_ns) * 1e-6
        table.append(("control period, p50 and p99, ms", spread(periods_ms, 99), "13.0"))
        table.append(("error of the estimate now, m", f"{session.newest[Tick].error_m or float('nan'):.4f}", ""))
        presses_ms = estop_ms(session)
        bus.close()
        table.append(
            ("E-stop under flood, latched and reported, p50 and p95, ms", spread(np.array(presses_ms), 95), "20")
        )
        return table
    finally:
        session.host.stop()


def main(seconds: float = SECONDS) -> None:
    table = Table("live", "measured", "budget")
    for row in rows(seconds):
        table.add_row(*row)
    Console(emoji=False).print(table)
