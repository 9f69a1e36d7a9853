"""The simulator's camera on its own: the world and a snake without physics, posed for each picture."""

import numpy as np

from snakeslam.backends.sim.backend import CAMERA_STREAM, WORLD_STREAM
from snakeslam.backends.sim.camera import Camera, camera_calibration
from snakeslam.backends.sim.renderer import Renderer
from snakeslam.backends.sim.settings import SimSettings
from snakeslam.backends.sim.shot import Shot
from snakeslam.backends.sim.worlds import world
from snakeslam.messages import CameraFrame
from snakeslam.robot.model import SnakeModel


class SceneCamera:
    """Makes the frames of ``SimBackend``'s shots; the same world and noise for the same ``seed``.

    With every shot exposed in turn the frames are those that the simulator makes itself.
    """

    def __init__(self, model: SnakeModel, settings: SimSettings, seed: int) -> None:
        cam0 = camera_calibration(settings.camera, model)
        self._T_IC = cam0.T_IC
        place = world(settings.world, np.random.default_rng([seed, WORLD_STREAM]))
        self._renderer = Renderer(place, model, cam0.intrinsics[0])
        self._camera = Camera(settings.camera, cam0.intrinsics, np.random.default_rng([seed, CAMERA_STREAM]))

    def expose(self, shot: Shot) -> CameraFrame:
        """Return the frame of ``shot``."""
        render = self._renderer.render(shot.T_WI @ self._T_IC, shot.Ts_WL)
        return self._camera.expose(shot.t_ns, shot.seq, render, shot.w_C)

    def close(self) -> None:
        """Release the renderer; safe to call twice."""
        self._renderer.close()
