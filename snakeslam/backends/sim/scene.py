"""The simulator's camera on its own: the world and a snake without physics, posed for each frame."""

import numpy as np

from snakeslam.backends.base import FrameSource
from snakeslam.backends.sim.backend import CAMERA_STREAM, WORLD_STREAM
from snakeslam.backends.sim.camera import Camera, camera_calibration
from snakeslam.backends.sim.renderer import Renderer
from snakeslam.backends.sim.settings import SimSettings
from snakeslam.backends.sim.worlds import world
from snakeslam.messages import CameraExposure, CameraFrame
from snakeslam.robot.model import SnakeModel


class SceneCamera(FrameSource):
    """Draws the frames of ``SimBackend``'s exposures; the same world and noise for the same ``seed``.

    With every exposure drawn in order the frames are those that the simulator makes itself.
    """

    def __init__(self, model: SnakeModel, settings: SimSettings, seed: int) -> None:
        cam0 = camera_calibration(settings.camera, model)
        self._T_IC = cam0.T_IC
        surroundings = world(settings.world, np.random.default_rng([seed, WORLD_STREAM]))
        self._renderer = Renderer(surroundings, model, cam0.intrinsics[0])
        self._camera = Camera(settings.camera, cam0.intrinsics, np.random.default_rng([seed, CAMERA_STREAM]))

    def expose(self, exposure: CameraExposure) -> CameraFrame:
        """Return the frame of ``exposure``."""
        render = self._renderer.render(exposure.T_WI @ self._T_IC, exposure.Ts_WL)
        return self._camera.expose(exposure.t_ns, exposure.seq, render, exposure.w_C)

    def close(self) -> None:
        """Release the renderer; safe to call twice."""
        self._renderer.close()
