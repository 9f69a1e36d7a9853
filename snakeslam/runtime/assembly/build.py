"""Puts a session together from its settings; the same for scripted runs and the live view."""

from pathlib import Path
from typing import TYPE_CHECKING

from snakeslam.backends.base import Backend
from snakeslam.backends.replay.backend import ReplayBackend
from snakeslam.config import Config
from snakeslam.control import Control
from snakeslam.errors import InputError
from snakeslam.estimation.settings import Mode
from snakeslam.robot.model import snake_model

if TYPE_CHECKING:
    from snakeslam.backends.sim.backend import CameraPlace, SimBackend
    from snakeslam.backends.sim.scene import SceneCamera
    from snakeslam.slam import Slam


def build_backend(config: Config, recording: Path | None = None, camera: bool = True) -> Backend:
    """Return the recording as a backend, or the simulator without one; InputError when it cannot be opened.

    ``camera`` False leaves the simulator's camera out, and with it most of the simulator's time.
    """
    if recording is not None:
        return ReplayBackend(recording, config.replay)
    return build_simulator(config, "here" if camera else "none")


def build_simulator(config: Config, camera: "CameraPlace") -> "SimBackend":
    """Return the simulator, its pictures drawn here, elsewhere or not at all; InputError where it is not installed."""
    try:
        from snakeslam.backends.sim.backend import SimBackend
    except ModuleNotFoundError as error:
        raise _no_simulator(error) from error
    return SimBackend(snake_model(config.robot), config.sim, config.run.seed, camera)


def build_scene(config: Config) -> "SceneCamera":
    """Return the camera that draws the pictures of a simulator which leaves them to others."""
    try:
        from snakeslam.backends.sim.scene import SceneCamera
    except ModuleNotFoundError as error:
        raise _no_simulator(error) from error
    return SceneCamera(snake_model(config.robot), config.sim, config.run.seed)


def _no_simulator(error: ModuleNotFoundError) -> InputError:
    return InputError("the simulator", f"{error.name} is not installed", "Python 3.11 with the extra 'sim'")


def mode_for(backend: Backend) -> Mode:
    """Return the estimator's mode that the sensors of a recording allow."""
    if backend.rig.imu0 is None:
        return "visual"
    return "vio" if backend.model is None else "fused"


def fit_to_recording(config: Config, backend: Backend) -> Config:
    """Return the settings, what was left out of them as the recording says: the estimator's mode and its seed."""
    if not isinstance(backend, ReplayBackend):
        return config
    estimator, run, seed = config.estimator, config.run, backend.recording.seed
    if "mode" not in estimator.model_fields_set:
        estimator = estimator.model_copy(update={"mode": mode_for(backend)})
    if "seed" not in run.model_fields_set and seed is not None:
        run = run.model_copy(update={"seed": seed})
    return config.model_copy(update={"estimator": estimator, "run": run})


def build_control(config: Config, backend: Backend) -> Control | None:
    """Return the control of the backend's robot; None for a recording, which nothing can move."""
    if backend.model is None or isinstance(backend, ReplayBackend):
        return None
    return Control(backend.model, config.gait, config.head)


def build_slam(config: Config, backend: Backend) -> "Slam":
    """Return slam for the backend's sensors and robot; InputError when the mode needs one that is not there."""
    # The robot and camera nodes never build one, and start sooner without.
    from snakeslam.slam import Slam

    return Slam(config.estimator, config.mapping, backend.rig, config.run.seed, backend.model)
