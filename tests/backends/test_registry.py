"""Backends are chosen by ``backend:``, say themselves what they can do, and are asked for nothing else."""

import ast
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from snakeslam.backends.registry import BACKENDS
from snakeslam.config import load_config
from snakeslam.errors import BackendError, InputError
from snakeslam.messages import check_packet
from snakeslam.recording.tum_writer import TumWriter
from snakeslam.runtime.assembly.build import build_backend, build_control, build_slam, recording_of, with_recording
from snakeslam.studies.experiment import run_experiment
from tests.server.still_robot import StillRobot
from tests.small_recordings import write_euroc


def test_a_backend_that_does_not_exist_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match=r"backend: 'lab' is not possible \(allowed: sim, replay\)"):
        load_config(None, ["backend=lab"])
    assert list(BACKENDS) == ["sim", "replay"]
    assert load_config().backend == "sim"


def test_the_simulator_says_what_it_can_do() -> None:
    config = load_config(None, ["robot.model=orthogonal24"])
    backend = build_backend(config, "elsewhere")
    assert backend.simulated
    assert backend.moves
    assert backend.recorded is None
    assert build_control(config, backend) is not None
    camera = backend.remote_camera
    assert camera is not None
    for _ in range(11):
        backend.step(None)
    assert [exposure.seq for exposure in camera.read_exposures()] == [0, 1, 2]
    backend.close()
    without = build_backend(config, "none")
    assert without.remote_camera is None
    without.close()


def test_a_recording_is_chosen_by_the_settings_alone(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    config = load_config(None, ["backend=replay", f"replay.recording={folder}"])
    assert recording_of(config) == folder
    assert config == with_recording(load_config(), folder)
    backend = build_backend(config)
    assert not backend.simulated
    assert not backend.moves
    assert backend.remote_camera is None
    recorded = backend.recorded
    assert recorded is not None
    assert recorded.read_frame(0).t_ns == recorded.frame_stamps_ns[0]
    assert recorded.has_truth
    assert build_control(config, backend) is None
    result = run_experiment(config, out=tmp_path / "run")
    assert result.metrics.frames == len(recorded.frame_stamps_ns)


def test_a_replay_without_a_recording_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"replay\.recording: is not set"):
        run_experiment(load_config(None, ["backend=replay"]), out=tmp_path / "run")


def test_a_real_robot_need_not_say_what_it_cannot_do() -> None:
    robot = StillRobot()
    assert (robot.simulated, robot.moves, robot.remote_camera, robot.recorded) == (False, True, None, None)


@dataclass(frozen=True)
class Sonar:
    t_ns: int


def test_an_unknown_packet_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(BackendError, match="a packet of the unknown type Sonar"):
        check_packet(Sonar(1))
    robot = StillRobot()
    with pytest.raises(BackendError, match="Sonar"):
        build_slam(load_config(None, ["robot.model=orthogonal24"]), robot).process(Sonar(1))  # type: ignore[arg-type]
    with pytest.raises(BackendError, match="Sonar"):
        TumWriter(tmp_path / "sensors", robot.rig, robot.model, 1).add(Sonar(1))  # type: ignore[arg-type]
    assert np.isfinite(robot.t_ns)


def test_nobody_asks_for_the_type_of_a_backend(checkout: Path) -> None:
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "--", "snakeslam/*.py", "server/*.py"],
        cwd=checkout,
        capture_output=True,
        text=True,
        check=True,
    )
    for name in listed.stdout.split():
        path = checkout / name
        if not path.exists() or name.startswith("snakeslam/backends/"):
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            match node:
                case ast.Call(func=ast.Name(id="hasattr" | "isinstance" | "getattr"), args=[subject, *_]):
                    assert not ast.unparse(subject).lower().endswith("backend"), f"{name}: {ast.unparse(node)}"
                case _:
                    pass
