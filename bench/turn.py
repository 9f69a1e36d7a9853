"""A commanded change of heading, the running estimator fed back: when it is reached, and how fast the head turns."""

from contextlib import closing

import numpy as np
from rich.console import Console
from rich.table import Table

from snakeslam.config import Config, load_config
from snakeslam.gaits.catalogue import resolve
from snakeslam.geometry import so3
from snakeslam.messages import Float, GaitCommand, HeadCommand
from snakeslam.runtime.assembly.build import build_backend, build_control
from snakeslam.runtime.session.lockstep import Loop, build_loop
from snakeslam.studies.metrics import truth_trajectory
from snakeslam.studies.recorder import Recorder

CASES = (
    ("gait.alpha_pi=0.3", "sim.friction_ratio=3", "robot.head_posture=flat", 45.0),
    ("gait.alpha_pi=0.5", "sim.friction_ratio=3", "robot.head_posture=flat", -45.0),
    ("gait.alpha_pi=0.3", "sim.friction_ratio=10", "robot.head_posture=raised", 45.0),
    ("gait.alpha_pi=0.5", "sim.friction_ratio=3", "robot.head_posture=raised", -45.0),
)
TURN_AT_PERIODS = 2.0
WATCHED_PERIODS = 3.0
REACHED_DEG = 2.0


def main() -> None:
    table = Table("case", "turn deg", "reached after, periods", "heading after 3 periods, deg", "peak rate deg/s")
    for *settings, turn_by_deg in CASES:
        config = load_config(None, ["gait.name=serpentine", "head.controller=predictive", *settings])
        t_periods, heading_deg, rate_deg_s = turn(config, turn_by_deg)
        off = np.abs(heading_deg - turn_by_deg) > REACHED_DEG
        reached = t_periods[-1 if off[-1] else int(np.flatnonzero(off)[-1]) + 1]
        table.add_row(
            " ".join(s.partition("=")[2] for s in settings),
            f"{turn_by_deg:g}",
            "never" if off[-1] else f"{reached:.2f}",
            f"{heading_deg[-1]:.1f}",
            f"{np.abs(rate_deg_s).max():.1f}",
        )
    Console().print(table)


def turn(config: Config, turn_by_deg: float) -> tuple[Float, Float, Float]:
    """Return, each (n,), periods since the command, the true heading in deg since then, and its rate in deg/s."""
    recorder = Recorder()
    with closing(build_backend(config)) as backend:
        control = build_control(config, backend)
        assert control is not None
        assert backend.model is not None
        period_ns = round(2e9 * np.pi / resolve(config.gait, backend.model).omega)
        loop = build_loop(config, backend, recorder, control=control)
        turn_ns = round(config.run.rest_s * 1e9 + TURN_AT_PERIODS * period_ns)
        _advance(loop, round(config.run.rest_s * 1e9))
        control.command(GaitCommand(backend.t_ns, config.gait.name))
        _advance(loop, turn_ns)
        control.command_head(HeadCommand(backend.t_ns, turn_by_deg=turn_by_deg))
        _advance(loop, round(turn_ns + WATCHED_PERIODS * period_ns))
    truth = truth_trajectory(recorder.truth)
    heading_deg = np.rad2deg(np.unwrap(so3.yaw(truth.Ts_WI[:, :3, :3])))
    rate_deg_s = np.gradient(heading_deg, truth.t_ns / 1e9)
    after = truth.t_ns >= turn_ns
    return (truth.t_ns[after] - turn_ns) / period_ns, heading_deg[after] - heading_deg[after][0], rate_deg_s[after]


def _advance(loop: Loop, until_ns: int) -> None:
    while loop.backend.t_ns < until_ns:
        loop.step()
