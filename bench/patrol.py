"""Five minutes of a stranger's robot, straight on and on patrol: ``python bench/patrol.py [SECONDS] [WORLD:SEED ...]``.

In lockstep, with camera, estimator and map as they are live. "at a wall": less than 0.3 m gone in the last 30 s.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

CHECKOUT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(CHECKOUT))

from snakeslam.config import Config, load_config  # noqa: E402
from snakeslam.mapping.clearance import clearance, patrol_steering  # noqa: E402
from snakeslam.messages import (  # noqa: E402
    CameraFrame,
    Float,
    GaitCommand,
    GroundTruth,
    JointTarget,
    MapChunk,
    Packet,
    SlamUpdate,
)
from snakeslam.runtime.assembly.build import build_backend, build_control  # noqa: E402
from snakeslam.runtime.session.lockstep import build_loop  # noqa: E402

SECONDS = 300.0
WORLDS = ("corridor:1", "office:1", "rubble:1")
STEPS_PER_S = 100
WALL_S, WALL_M = 30, 0.3
HEAD_HEIGHT_M = 0.1


class Drive:
    """Hears what a run gives, and steers once a second."""

    def __init__(self, config: Config, patrol: bool) -> None:
        backend = build_backend(config)
        control = build_control(config, backend)
        assert control is not None
        self.control, self.patrol = control, patrol
        self.loop = build_loop(config, backend, self, control=control)
        self.chunks: dict[int, MapChunk] = {}
        self.truth: list[Float] = []
        self.turning = 0
        self.blocked = False
        self.now_W = np.zeros(3)

    def on_target(self, target: JointTarget) -> None:
        pass

    def on_packet(self, packet: Packet) -> None:
        pass

    def on_update(self, update: SlamUpdate, frame: CameraFrame, slam_ms: float) -> None:  # noqa: ARG002
        self.chunks |= {chunk.key: chunk for chunk in update.chunks}

    def on_truth(self, truth: Sequence[GroundTruth]) -> None:
        self.now_W = truth[-1].T_WI[:3, 3]

    def run(self, seconds: float) -> None:
        for second in range(round(seconds)):
            if second == 1:
                self.control.command(GaitCommand(0, "serpentine", drive=1.0))
            if self.patrol and second > 2 and not self.blocked:
                self.steer()
            for _ in range(STEPS_PER_S):
                self.loop.step()
            self.truth.append(self.now_W)
        self.loop.backend.close()

    def steer(self) -> None:
        pose = self.loop.pose
        if pose is None:
            return
        p_W = pose.T_WI[:3, 3]
        # With the head held on a line its own yaw is the heading.
        heading = float(np.arctan2(pose.T_WI[1, 0], pose.T_WI[0, 0]))
        turn = patrol_steering(
            clearance(self.chunks.values(), p_W, heading, float(p_W[2]) - HEAD_HEIGHT_M), self.turning
        )
        self.blocked = turn is None
        self.turning = turn or 0
        drive = 0.0 if turn is None else 1.0
        self.control.command(GaitCommand(0, "serpentine", drive=drive, turn=float(self.turning)))

    def words(self) -> str:
        truth = np.array(self.truth)
        # Over periods of the gait, so that a swing is no displacement.
        path_m = float(np.sum(np.linalg.norm(np.diff(truth[::4, :2], axis=0), axis=1)))
        last_m = float(np.linalg.norm(truth[-1, :2] - truth[-min(WALL_S, len(truth)), :2]))
        wall = "blocked, stopped" if self.blocked else "at a wall" if last_m < WALL_M else "free"
        points = sum(len(chunk.points_K) for chunk in self.chunks.values())
        where = np.round(truth[-1, :2], 1)
        return f"{points} points, {path_m:.1f} m, ends {wall}, {last_m:.2f} m in its last {WALL_S} s, at {where}"


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    for name in sys.argv[2:] or WORLDS:
        world, seed = name.split(":")
        for patrol in (False, True):
            config = load_config(None, [f"sim.world={world}", f"run.seed={seed}", "sim.camera.rate_hz=10"])
            drive = Drive(config, patrol)
            drive.run(seconds)
            print(f"{name}, {'patrol' if patrol else 'straight'}, {seconds:g} s: {drive.words()}", flush=True)


if __name__ == "__main__":
    main()
