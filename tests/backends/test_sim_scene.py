"""The simulator's camera in a process of its own sees what the simulator's own camera does."""

from multiprocessing import get_context
from typing import Any

import numpy as np

from snakeslam.backends.sim.backend import SimBackend
from snakeslam.backends.sim.scene import SceneCamera
from snakeslam.backends.sim.settings import SimSettings
from snakeslam.messages import CameraExposure, CameraFrame, JointTarget
from snakeslam.robot.model import PRESETS

MODEL, SETTINGS, SEED = PRESETS["orthogonal24"], SimSettings(world="blank"), 3


def expose(exposures: list[CameraExposure], pipe: Any) -> None:
    """Make the frames; two renderers in one process get into each other's way."""
    scene = SceneCamera(MODEL, SETTINGS, SEED)
    pipe.send([scene.expose(exposure) for exposure in exposures])
    scene.close()


def run(camera: Any) -> tuple[list[CameraFrame], list[Any], list[CameraExposure]]:
    backend, frames, others, exposures = SimBackend(MODEL, SETTINGS, SEED, camera), [], [], []
    swing = 0.3 * MODEL.is_yaw
    for k in range(16):
        target = JointTarget(backend.t_ns, MODEL.rest_q_rad + swing * np.sin(0.5 * k) * (k > 2))
        for packet in backend.step(target):
            (frames if isinstance(packet, CameraFrame) else others).append(packet)
        exposures += backend.read_exposures()
    backend.close()
    return frames, others, exposures


def test_its_frames_are_those_of_the_simulator() -> None:
    frames, sensed, none = run("here")
    no_frames, sensed_too, exposures = run("elsewhere")
    assert none == []
    assert no_frames == []
    assert len(exposures) == len(frames) == 4
    assert [packet.t_ns for packet in sensed] == [packet.t_ns for packet in sensed_too]
    gyro, gyro_too = ([packet.gyro_I for packet in all_ if hasattr(packet, "gyro_I")] for all_ in (sensed, sensed_too))
    assert np.array_equal(gyro, gyro_too)
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=expose, args=(exposures, theirs))
    process.start()
    made = ours.recv()
    process.join()
    for ours_, theirs_ in zip(frames, made, strict=True):
        assert (ours_.t_ns, ours_.seq, ours_.exposure_ns) == (theirs_.t_ns, theirs_.seq, theirs_.exposure_ns)
        # The snake's links are posed through other roundings: its outline may differ by a pixel's share.
        assert np.mean(ours_.gray != theirs_.gray) < 0.01
        assert np.mean(np.abs(ours_.depth_m - theirs_.depth_m) > 0.005) < 0.001
