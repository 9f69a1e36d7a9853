"""The simulator's camera on its own: the world and a snake without physics, posed for each picture."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pybullet

from snakeslam.backends.sim.backend import CAMERA_STREAM, WORLD_STREAM, Shot
from snakeslam.backends.sim.camera import Camera, Renderer, camera_calibration
from snakeslam.backends.sim.placing import place_world
from snakeslam.backends.sim.settings import SimSettings
from snakeslam.backends.sim.worlds import world
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame
from snakeslam.robot.model import SnakeModel


class SceneCamera:
    """Makes the frames of ``SimBackend``'s shots; the same world and noise for the same ``seed``.

    With every shot exposed in turn the frames are those that the simulator makes itself.
    """

    def __init__(self, model: SnakeModel, settings: SimSettings, seed: int) -> None:
        self._model = model
        cam0 = camera_calibration(settings.camera, model)
        self._T_IC = cam0.T_IC
        self._client: int = pybullet.connect(pybullet.DIRECT)
        self._renderer = Renderer(self._client, cam0.intrinsics[0])
        self._snake = self._load_snake()
        place_world(world(settings.world, np.random.default_rng([seed, WORLD_STREAM])), self._client)
        self._renderer.warm_up()
        self._camera = Camera(settings.camera, cam0.intrinsics, np.random.default_rng([seed, CAMERA_STREAM]))
        self._open = True

    def expose(self, shot: Shot) -> CameraFrame:
        """Return the frame of ``shot``."""
        com_W = se3.act(shot.T_W_base, self._model.com_L)
        quat_xyzw = np.roll(so3.quat_wxyz_from_matrix(shot.T_W_base[:3, :3]), -1)
        pybullet.resetBasePositionAndOrientation(
            self._snake, com_W.tolist(), quat_xyzw.tolist(), physicsClientId=self._client
        )
        for joint, angle in enumerate(shot.q_rad.tolist()):
            pybullet.resetJointState(self._snake, joint, angle, physicsClientId=self._client)
        render = self._renderer.render(shot.T_WI @ self._T_IC)
        return self._camera.expose(shot.t_ns, shot.seq, render, shot.w_C)

    def close(self) -> None:
        """Release the renderer; safe to call twice."""
        if self._open:
            self._open = False
            self._renderer.close()
            pybullet.disconnect(physicsClientId=self._client)

    def _load_snake(self) -> int:
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"{self._model.name}.urdf"
            path.write_text(self._model.urdf())
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE
            snake: int = pybullet.loadURDF(str(path), flags=flags, physicsClientId=self._client)
        return snake
