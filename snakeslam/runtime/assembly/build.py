"""Puts a session together from its settings; the same for scripted runs and the live view."""

from pathlib import Path
from typing import TYPE_CHECKING

from snakeslam.backends.base import Backend, FrameSource
from snakeslam.backends.kind import BackendRequest, CameraUse
from snakeslam.backends.registry import BACKENDS, RECORDINGS
from snakeslam.config import Config
from snakeslam.control import Control
from snakeslam.errors import InputError
from snakeslam.estimation.settings import Mode
from snakeslam.robot.model import snake_model
from snakeslam.settings import Settings

if TYPE_CHECKING:
    from snakeslam.slam import Slam


def with_recording(config: Config, recording: Path | None) -> Config:
    """Return the settings of a session over ``recording``; ``config`` itself where there is none."""
    if recording is None:
        return config
    replay = config.replay.model_copy(update={"recording": recording})
    return config.model_copy(update={"backend": RECORDINGS, "replay": replay})


def recording_of(config: Config) -> Path | None:
    """Return the recording that ``config`` plays, None for a simulator or a robot; InputError where it names none."""
    if not BACKENDS[config.backend].recorded:
        return None
    if config.replay.recording is None:
        raise InputError("replay.recording", f"is not set, but backend is {config.backend}", "a recording's folder")
    return config.replay.recording


def build_backend(config: Config, camera: CameraUse = "here") -> Backend:
    """Return the backend that ``backend:`` names; InputError when it cannot be opened.

    ``camera`` "none" leaves a simulator's camera out, and with it most of its time.
    """
    return BACKENDS[config.backend].open(_request(config, camera))


def has_camera_node(config: Config) -> bool:
    """Return whether the backend can leave its frames to a process of their own."""
    return BACKENDS[config.backend].open_camera is not None


def build_camera(config: Config) -> FrameSource:
    """Return what draws the frames of a backend that was built with its camera "elsewhere"."""
    open_camera = BACKENDS[config.backend].open_camera
    if open_camera is None:
        raise InputError("backend", f"{config.backend} has no camera in a process of its own")
    return open_camera(_request(config, "elsewhere"))


def _request(config: Config, camera: CameraUse) -> BackendRequest[Settings]:
    settings: Settings = getattr(config, BACKENDS[config.backend].settings)
    return BackendRequest(settings, snake_model(config.robot), config.run.seed, camera)


def mode_for(backend: Backend) -> Mode:
    """Return the estimator's mode that the sensors of a recording allow."""
    if backend.rig.imu0 is None:
        return "visual"
    return "vio" if backend.model is None else "fused"


def fit_to_recording(config: Config, backend: Backend) -> Config:
    """Return the settings, what was left out of them as the recording says: the estimator's mode and its seed."""
    if backend.recorded is None:
        return config
    estimator, run, seed = config.estimator, config.run, backend.recorded.seed
    if "mode" not in estimator.model_fields_set:
        estimator = estimator.model_copy(update={"mode": mode_for(backend)})
    if "seed" not in run.model_fields_set and seed is not None:
        run = run.model_copy(update={"seed": seed})
    return config.model_copy(update={"estimator": estimator, "run": run})


def build_control(config: Config, backend: Backend) -> Control | None:
    """Return the control of the backend's robot; None where nothing can be moved, as for a recording."""
    if backend.model is None or not backend.moves:
        return None
    return Control(backend.model, config.gait, config.head)


def build_slam(config: Config, backend: Backend) -> "Slam":
    """Return slam for the backend's sensors and robot; InputError when the mode needs one that is not there."""
    # The robot and camera nodes never build one, and start sooner without.
    from snakeslam.slam import Slam

    return Slam(config.estimator, config.mapping, backend.rig, config.run.seed, backend.model)
