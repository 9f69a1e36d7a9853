"""The simulator as a backend: physics, IMU, servos and camera on one integer clock."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from snakeslam.backends.base import Backend, RemoteCamera
from snakeslam.backends.kind import CameraUse
from snakeslam.backends.sim.camera import Camera, camera_calibration
from snakeslam.backends.sim.imu import Imu, imu_calibration, interval_means
from snakeslam.backends.sim.physics import SnakePhysics, pose_with_head_at
from snakeslam.backends.sim.placing import add_obstacles
from snakeslam.backends.sim.renderer import Render, Renderer
from snakeslam.backends.sim.servos import ServoSensors
from snakeslam.backends.sim.settings import IMU_RATE_HZ, SimSettings
from snakeslam.backends.sim.worlds import world
from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.geometry import so3
from snakeslam.messages import CameraExposure, CameraFrame, Float, GroundTruth, JointTarget, Packet
from snakeslam.robot.model import SnakeModel

CONTROL_RATE_HZ = 100
IMU_DT_NS = 1_000_000_000 // IMU_RATE_HZ
IMU_DT_S = 1.0 / IMU_RATE_HZ
SETTLE_S = 0.3
"""The snake sinks into its contacts for so long before time 0."""
WORLD_STREAM, CAMERA_STREAM, IMU_STREAM = 1, 2, 3


class SimBackend(Backend):
    """A snake in a world made from ``seed``; W is the world's frame, the head starts over its origin, looking along x.

    Everything is determined by the arguments and the targets. A frame's middle of exposure is the time of an IMU
    sample; the frame is handed out once the next sample, to which the exposure reaches, is there. With ``camera``
    "none" no frame comes and nothing is drawn; with "elsewhere" ``read_exposures`` has what a ``scene.SceneCamera`` in
    another process draws. The motion is the same.
    """

    def __init__(self, model: SnakeModel, settings: SimSettings, seed: int, camera: CameraUse = "here") -> None:
        if settings.physics.rate_hz % (2 * IMU_RATE_HZ):
            raise InputError("sim.physics.rate_hz", f"{settings.physics.rate_hz} is not possible", "multiples of 400")
        self._model = model
        self._settings = settings
        cam0 = camera_calibration(settings.camera, model)
        self._rig = SensorRig(cam0=cam0, imu0=imu_calibration(settings.imu))
        self._has_camera = camera != "none"
        self._draws_elsewhere = camera == "elsewhere"
        self._physics = SnakePhysics(
            model, settings.physics, settings.friction_ratio, pose_with_head_at(model, 0.0, 0.0)
        )
        surroundings = world(settings.world, np.random.default_rng([seed, WORLD_STREAM]))
        add_obstacles(surroundings.obstacles, self._physics.client_id)
        self._renderer = Renderer(surroundings, model, cam0.intrinsics[0]) if camera == "here" else None
        self._camera = Camera(settings.camera, cam0.intrinsics, np.random.default_rng([seed, CAMERA_STREAM]))
        self._imu = Imu.switched_on(settings.imu, np.random.default_rng([seed, IMU_STREAM]))
        self._servos = ServoSensors(model.joint_count, 1.0 / CONTROL_RATE_HZ)
        self._imu_count = 0
        self._run(SETTLE_S)
        self._pose_WI, self._v_W, _ = self._physics.head_state()
        self._run(IMU_DT_S / 2.0)
        self._midpoint_W = self._physics.head_pose()[:3, 3]
        self._frame_count = 0
        self._exposing: tuple[CameraExposure, Render | None, Float] | None = None
        self._exposures: list[CameraExposure] = []
        self._joints = self._physics.joint_state()
        self._truth: list[GroundTruth] = []

    @property
    def simulated(self) -> bool:
        """True: time is computed."""
        return True

    @property
    def remote_camera(self) -> RemoteCamera | None:
        """The backend itself where its frames are drawn elsewhere, else None."""
        return self if self._draws_elsewhere else None

    @property
    def rig(self) -> SensorRig:
        """The exact calibration of the simulated sensors."""
        return self._rig

    @property
    def model(self) -> SnakeModel:
        """The robot."""
        return self._model

    @property
    def settings(self) -> SimSettings:
        """The settings it was made with."""
        return self._settings

    @property
    def t_ns(self) -> int:
        """Simulated time reached, from 0."""
        return self._imu_count * IMU_DT_NS

    def step(self, target: JointTarget | None) -> Sequence[Packet]:
        """Advance 10 ms towards ``target`` (None keeps the last) and return the packets in time order."""
        if target is not None:
            self._physics.set_target(target.q_rad)
        packets: list[Packet] = []
        for _ in range(IMU_RATE_HZ // CONTROL_RATE_HZ):
            self._advance_imu_interval(packets)
        packets.append(self._servos.measure(self.t_ns, *self._joints))
        return packets

    def read_ground_truth(self) -> Sequence[GroundTruth]:
        """Return the true motion and biases since the last call, at the stamps of the IMU samples."""
        taken, self._truth = self._truth, []
        return taken

    def read_exposures(self) -> Sequence[CameraExposure]:
        """Return what is to be drawn elsewhere since the last call, oldest first."""
        taken, self._exposures = self._exposures, []
        return taken

    def close(self) -> None:
        """Release the renderer and the physics; safe to call twice."""
        if self._renderer is not None:
            self._renderer.close()
        self._physics.close()

    def _run(self, duration_s: float) -> None:
        for _ in range(round(duration_s * self._settings.physics.rate_hz)):
            self._physics.step()

    def _advance_imu_interval(self, packets: list[Packet]) -> None:
        """Go on by one IMU interval and append what the sensors give at its end.

        The physics is half an interval ahead: the velocity at t is the mean over the interval's length around t, which
        adds up to the true displacement, as PyBullet's own for the end of a chain does not (3 to 7 mm/s).
        """
        before_W, T0_WI, v0_W = self._midpoint_W, self._pose_WI, self._v_W
        self._run(IMU_DT_S / 2.0)
        self._imu_count += 1
        self._pose_WI = self._physics.head_pose()
        self._joints = self._physics.joint_state()
        beginning = self._begin_exposure(T0_WI)
        self._run(IMU_DT_S / 2.0)
        self._midpoint_W = self._physics.head_pose()[:3, 3]
        self._v_W = (self._midpoint_W - before_W) / IMU_DT_S
        if self._exposing is not None:
            packets.extend(self._end_exposure(*self._exposing))
        self._exposing = beginning
        gyro_I, accel_I = interval_means(T0_WI[:3, :3], v0_W, self._pose_WI[:3, :3], self._v_W, IMU_DT_S)
        packets.append(self._imu.measure(self.t_ns, gyro_I, accel_I))
        self._truth.append(
            GroundTruth(self.t_ns, self._pose_WI, self._v_W, self._imu.gyro_bias_I, self._imu.accel_bias_I)
        )

    def _begin_exposure(self, T0_WI: Float) -> tuple[CameraExposure, Render | None, Float] | None:
        """Render where a frame is due; ``T0_WI`` is the pose one IMU interval ago."""
        if not self._has_camera or (self._imu_count - 1) % (IMU_RATE_HZ // self._settings.camera.rate_hz):
            return None
        exposure = CameraExposure(self.t_ns, self._frame_count, self._physics.Ts_WL, self._pose_WI, np.zeros(3))
        self._frame_count += 1
        T_WC = exposure.T_WI @ self._rig.cam0.T_IC
        render = None if self._renderer is None else self._renderer.render(T_WC, exposure.Ts_WL)
        return exposure, render, T0_WI

    def _end_exposure(self, exposure: CameraExposure, render: Render | None, T0_WI: Float) -> Sequence[CameraFrame]:
        """Return the frame, if it is drawn here, blurred by the rotation from one IMU sample before to one after."""
        rotation_I = so3.log(T0_WI[:3, :3].T @ self._pose_WI[:3, :3])
        w_C = self._rig.cam0.T_CI[:3, :3] @ rotation_I / (2.0 * IMU_DT_S)
        if render is not None:
            return (self._camera.expose(exposure.t_ns, exposure.seq, render, w_C),)
        self._exposures.append(replace(exposure, w_C=w_C))
        return ()
