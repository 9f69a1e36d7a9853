"""One scripted run, in the simulator or over a recording, and what it leaves: a run directory."""

import json
import math
import platform
import subprocess
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter
from typing import Any

from snakeslam.backends.base import Backend, Recorded
from snakeslam.config import Config
from snakeslam.control import Control
from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import resolve
from snakeslam.garbage import collect_seldom
from snakeslam.mapping.export import write_ply
from snakeslam.recording.datasets import SENSORS
from snakeslam.recording.trajectory import write_trajectory
from snakeslam.recording.tum_writer import TumWriter
from snakeslam.robot.model import SnakeModel, snake_model
from snakeslam.runtime.assembly.build import build_backend, fit_to_recording, recording_of, with_recording
from snakeslam.runtime.session.lockstep import Loop, build_loop
from snakeslam.studies.metrics import HeadWindow, Metrics, evaluate, notes_on, tracked_poses
from snakeslam.studies.recorder import Recorder
from snakeslam.studies.run_directory import new_directory

Progress = Callable[[float], None]
START_UP_PERIODS = 2
"""The head is judged once the gait has formed."""
LEAST_CONTRAST = 5.0
"""Standard deviation of an image's grey values, of 255, below which there is nothing to follow."""
PACKAGES = ("snakeslam", "numpy", "scipy", "opencv-python-headless", "pybullet")


@dataclass(frozen=True, slots=True)
class RunResult:
    """Where a run was written, what was measured, and what is odd about it (a line each)."""

    out: Path
    metrics: Metrics
    notes: tuple[str, ...] = ()


def run_experiment(
    config: Config,
    recording: Path | None = None,
    duration_s: float | None = None,
    out: Path | None = None,
    progress: Progress | None = None,
    began: Callable[[Path], None] | None = None,
) -> RunResult:
    """Run ``config`` in the simulator, or over ``recording``, and write the run directory ``out``.

    The simulator runs for ``duration_s`` (else the config's), a recording for as long or to its end. ``began`` is
    called with the run directory's name as soon as nothing can be wrong with the settings any more. What is wrong is
    said before that (InputError); a run that fails leaves nothing behind.
    """
    config = with_recording(config, recording)
    recording = recording_of(config)
    if recording is None:
        # What the joints cannot do is said before a simulator starts.
        Control(snake_model(config.robot), config.gait, config.head)
    name = recording.resolve().name if recording else f"{config.gait.name}-s{config.run.seed}"
    with new_directory(out, name) as new, closing(build_backend(config)) as backend:
        part = new.part
        config = fit_to_recording(config, backend)
        recorder = Recorder(_sensor_writer(config, recording, part, backend))
        loop = build_loop(config, backend, recorder, autostart=True)
        collect_seldom()
        if began is not None:
            began(new.out)
        wall_s = run_loop(loop, _end_ns(config, backend, duration_s), progress or (lambda _: None))
        metrics = _evaluate(config, backend, recorder, wall_s)
        notes = (*_head_notes(config, backend, metrics), *_notes(backend, recorder))
        _write(part, config, recording, recorder, metrics, notes)
    return RunResult(new.out, metrics, notes)


def _sensor_writer(config: Config, recording: Path | None, part: Path, backend: Backend) -> TumWriter | None:
    if not config.recording.enabled:
        return None
    if recording is not None:
        raise InputError("recording.enabled", "a replay has its sensors already", "false")
    return TumWriter(part / SENSORS, backend.rig, backend.model, config.run.seed)


def _end_ns(config: Config, backend: Backend, duration_s: float | None) -> int:
    if backend.recorded is None:
        return backend.t_ns + round((duration_s or config.run.duration_s) * 1e9)
    end_ns = backend.recorded.end_ns
    return end_ns if duration_s is None else min(end_ns, backend.t_ns + round(duration_s * 1e9))


def run_loop(loop: Loop, end_ns: int, progress: Progress) -> float:
    """Run the loop until the backend's time is ``end_ns``; return the wall time it took, in s."""
    start_ns = loop.backend.t_ns
    started = perf_counter()
    while (replays := loop.backend.recorded is not None) or loop.backend.t_ns < end_ns:
        if not loop.step() or (replays and loop.backend.t_ns > end_ns):
            break
        progress(min(1.0, (loop.backend.t_ns - start_ns) / max(1, end_ns - start_ns)))
    return perf_counter() - started


def _evaluate(config: Config, backend: Backend, recorder: Recorder, wall_s: float) -> Metrics:
    head = None
    if backend.moves and backend.model is not None and recorder.first_ns is not None:
        period_s, start_up_s = _start_up(config, backend.model)
        head = HeadWindow(recorder.first_ns + round(start_up_s * 1e9), period_s)
    return evaluate(
        recorder.updates,
        recorder.truth,
        recorder.frame_ms,
        duration_s=recorder.duration_s,
        wall_s=wall_s,
        gravity_known=backend.rig.imu0 is not None,
        head=head,
    )


def _start_up(config: Config, model: SnakeModel) -> tuple[float, float]:
    """Return the gait's period, and from when on the head is judged, both in s."""
    period_s = 2.0 * math.pi / resolve(config.gait, model).omega
    return period_s, config.run.rest_s + START_UP_PERIODS * period_s


def _head_notes(config: Config, backend: Backend, metrics: Metrics) -> list[str]:
    """Return why the head's motion is not known, where it is not."""
    if metrics.head.yaw_rms_deg is not None:
        return []
    if not backend.moves or backend.model is None:
        return ["head is null: its motion is judged in simulated runs only"]
    period_s, start_up_s = _start_up(config, backend.model)
    needed_s, ended_s = start_up_s + period_s, metrics.duration_s
    return [
        f"head is null: it is judged from {start_up_s:g} s on (rest and {START_UP_PERIODS} gait periods of "
        f"{period_s:g} s), and the run ends at {ended_s:g} s; --duration {needed_s:g} measures one"
    ]


def _notes(backend: Backend, recorder: Recorder) -> tuple[str, ...]:
    """Return what is odd about the recording's files, then what the metrics leave open."""
    recorded = backend.recorded
    if recorded is None:
        return tuple(notes_on(recorder.updates, recorder.truth, truth_recorded=False))
    notes = (*recorded.notes, *notes_on(recorder.updates, recorder.truth, truth_recorded=recorded.has_truth))
    tracked = any(update.health.verdict.tracked for update in recorder.updates)
    return notes if tracked else (*notes, *_contrast_note(recorded))


def _contrast_note(recorded: Recorded) -> tuple[str, ...]:
    """Return a note where the image in the middle of a recording has nothing to see."""
    middle = len(recorded.frame_stamps_ns) // 2
    gray = recorded.read_frame(middle).gray
    spread, mean = float(gray.std()), float(gray.mean())
    if spread >= LEAST_CONTRAST:
        return ()
    return (
        f"{recorded.frame_name(middle)}: the image has almost no contrast "
        f"(grey {mean:.0f} of 255, standard deviation {spread:.1f})",
    )


def _write(
    part: Path,
    config: Config,
    recording: Path | None,
    recorder: Recorder,
    metrics: Metrics,
    notes: Sequence[str],
) -> None:
    write_trajectory(part / "estimate.tum", ((pose.t_ns, pose.T_WI) for pose in tracked_poses(recorder.updates)))
    if recorder.truth:
        write_trajectory(part / "ground_truth.tum", ((sample.t_ns, sample.T_WI) for sample in recorder.truth))
    write_ply(part / "map.ply", [recorder.chunks[key] for key in sorted(recorder.chunks)])
    recorder.write_joints(part / "joints.csv")
    if recorder.sensors is not None:
        recorder.sensors.finish(recorder.truth)
    facts: dict[str, Any] = {
        "written": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}",
        "recording": str(recording.resolve()) if recording else None,
        "seed": config.run.seed,
        "config": config.model_dump(mode="json"),
        "versions": versions(),
        "commit": commit(),
        "metrics": metrics.as_dict(),
        "notes": list(notes),
    }
    (part / "run.json").write_text(json.dumps(facts, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def versions() -> dict[str, str | None]:
    """Return the versions a result may depend on; None for what is not installed."""
    found: dict[str, str | None] = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    return found


def commit() -> str | None:
    """Return the commit of the source tree, with a mark when it has changes; None outside of one."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return None
    try:
        said = subprocess.run(
            ["git", "-C", str(root), "describe", "--always", "--abbrev=40", "--dirty", "--exclude=*"],
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return said.stdout.strip() or None
