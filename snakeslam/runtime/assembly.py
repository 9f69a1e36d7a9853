"""Puts a session together from its settings; the same for scripted runs and the live view."""

from pathlib import Path

from snakeslam.backends.base import Backend
from snakeslam.backends.replay.backend import ReplayBackend
from snakeslam.calibration import SensorRig
from snakeslam.config import Config
from snakeslam.control import Control
from snakeslam.errors import InputError
from snakeslam.robot.model import SnakeModel, snake_model
from snakeslam.slam import Slam


def build_backend(config: Config, recording: Path | None = None, camera: bool = True) -> Backend:
    """Return the recording as a backend, or the simulator without one; InputError when it cannot be opened.

    ``camera`` False leaves the simulator's camera out, and with it most of the simulator's time.
    """
    if recording is not None:
        return ReplayBackend(recording, config.replay)
    try:
        from snakeslam.backends.sim.backend import SimBackend
    except ModuleNotFoundError as error:
        raise InputError(
            "the simulator", f"{error.name} is not installed", "Python 3.11 with the extra 'sim'"
        ) from error
    return SimBackend(snake_model(config.robot), config.sim, config.run.seed, camera)


def build_control(config: Config, model: SnakeModel | None) -> Control | None:
    """Return the control of ``model``, None for a recording without a robot."""
    return None if model is None else Control(model, config.gait, config.head)


def build_slam(config: Config, rig: SensorRig) -> Slam:
    """Return slam for the sensors of ``rig``; InputError when the mode needs a sensor that is not there."""
    return Slam(config.estimator, config.mapping, rig, config.run.seed)
