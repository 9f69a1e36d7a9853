"""The snake's body in PyBullet: rigid links, servos and an external friction law, one step at a time."""

import tempfile
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pybullet

from snakeslam.backends.sim.contacts import Contacts, Floor, obstacle_contacts, on_links
from snakeslam.backends.sim.friction import CoulombFriction
from snakeslam.backends.sim.settings import PhysicsSettings
from snakeslam.errors import BackendError
from snakeslam.geometry import se3, so3
from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float
from snakeslam.robot import kinematics
from snakeslam.robot.model import SnakeModel

GRAVITY_M_S2 = 9.81
FRICTION_MEMORY = 0.5
"""Share of the past in the velocity that friction sees, a lag of one step. An explicit force on the present velocity
makes the rolling of the whole body chatter once mu N dt / (eps m_eff) > 2 (2.2 at 400 Hz); with this, only beyond 6."""


class SnakePhysics:
    """A snake on the plane z = 0 in its own PyBullet client; deterministic: it has no noise and no clock.

    ``T_W_base`` (4, 4) is the tail link's pose at the start, ``q_rad`` (N,) the joint angles (default: at rest).
    Other static bodies may be added to the client at any time.
    """

    def __init__(
        self,
        model: SnakeModel,
        settings: PhysicsSettings,
        friction_ratio: float = 3.0,
        T_W_base: Float | None = None,
        q_rad: Float | None = None,
    ) -> None:
        self.model = model
        self.settings = settings
        self.dt_s = 1.0 / settings.rate_hz
        self.step_count = 0
        self._floor = Floor(model, settings)
        self._friction = CoulombFriction(
            settings.friction_normal / friction_ratio, settings.friction_normal, settings.friction_slip_m_s
        )
        self._client: int | None = pybullet.connect(pybullet.DIRECT)
        q_rad = model.rest_q_rad if q_rad is None else np.asarray(q_rad, dtype=np.float64)
        self._configure()
        self._body_id = self._load_snake(lying_pose(model) if T_W_base is None else T_W_base, q_rad)
        count = model.joint_count
        self._joints = list(range(count))
        self._servo_blend = self.dt_s / (0.5 * settings.servo_lag_s + self.dt_s)
        self._strengths = [model.torque_nm] * count
        self._position_gains = [settings.servo_position_gain] * count
        self._velocity_gains = [settings.servo_velocity_gain] * count
        # The IMU's axes are those of its link.
        self._IMU_from_com_L = model.T_HI[:3, 3] - model.com_L
        self._servo_rad = self._smooth_rad = self._target_rad = q_rad.copy()
        self._slow_twist_W = np.zeros((model.link_count, 6))
        self._read()

    @property
    def client_id(self) -> int:
        """PyBullet's client, for bodies; BackendError after ``close``."""
        if self._client is None:
            raise BackendError("the simulator is closed")
        return self._client

    @property
    def body_id(self) -> int:
        """PyBullet's id of the snake."""
        return self._body_id

    @property
    def Ts_WL(self) -> Float:
        """Poses of links 0..N, (N + 1, 4, 4)."""
        R_WL = so3.matrix_from_quat_wxyz(np.roll(self._quat_xyzw, 1, axis=-1))
        return se3.from_rt(R_WL, self._com_W - R_WL @ self.model.com_L)

    def head_pose(self) -> Float:
        """Return T_WI, (4, 4)."""
        return _pose_on_link(self._quat_xyzw[-1], self._com_W[-1], self._IMU_from_com_L)

    def head_state(self) -> tuple[Float, Float, Float]:
        """Return T_WI (4, 4), the IMU's velocity v_W (3,) m/s in W and its angular rate w_I (3,) rad/s in I."""
        T_WI = self.head_pose()
        v_com_W, w_W = self._twist_W[-1, :3], self._twist_W[-1, 3:]
        v_W = v_com_W + so3.hat(w_W) @ (T_WI[:3, 3] - self._com_W[-1])
        return T_WI, v_W, T_WI[:3, :3].T @ w_W

    def joint_state(self) -> tuple[Float, Float, Float]:
        """Return true angles (rad), rates (rad/s) and servo torques (N m), each (N,)."""
        return self._q_rad, self._dq_rad_s, self._torque_nm

    def floor_contacts(self) -> Contacts:
        """Return where the floor bears the snake now."""
        return self._floor.contacts(self._com_W, self._quat_xyzw, self._twist_W)

    def set_target(self, q_rad: Float) -> None:
        """Command the servos, (N,) rad."""
        limit = self.model.limits.position_rad
        self._target_rad = np.clip(np.asarray(q_rad, dtype=np.float64), -limit, limit)

    def step(self) -> None:
        """Advance one physics step of ``dt_s``."""
        self._drive_servos()
        self._push_contacts()
        pybullet.stepSimulation(physicsClientId=self.client_id)
        self.step_count += 1
        self._read()

    def close(self) -> None:
        """Disconnect the client; safe to call twice."""
        if self._client is not None:
            pybullet.disconnect(physicsClientId=self._client)
            self._client = None

    def _configure(self) -> None:
        client = self.client_id
        pybullet.setGravity(0.0, 0.0, -GRAVITY_M_S2, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=self.dt_s,
            numSubSteps=0,
            numSolverIterations=self.settings.solver_iterations,
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )

    def _load_snake(self, T_W_base: Float, q_rad: Float) -> int:
        client = self.client_id
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{self.model.name}.urdf"
            path.write_text(self.model.urdf())
            body: int = pybullet.loadURDF(str(path), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
        com_W = se3.act(T_W_base, self.model.com_L)
        quat_xyzw = np.roll(so3.quat_wxyz_from_matrix(T_W_base[:3, :3]), -1)
        pybullet.resetBasePositionAndOrientation(body, com_W.tolist(), quat_xyzw.tolist(), physicsClientId=client)
        for link in range(-1, self.model.joint_count):
            pybullet.changeDynamics(
                body,
                link,
                lateralFriction=0,
                linearDamping=0,
                angularDamping=0,
                jointDamping=0,
                # As on the floor: a rigid chain on rigid ground would bear its weight anywhere.
                contactStiffness=self.settings.contact_stiffness_n_m,
                contactDamping=self.settings.contact_damping_n_s_m,
                physicsClientId=client,
            )
        for joint, angle in enumerate(q_rad.tolist()):
            pybullet.resetJointState(body, joint, angle, physicsClientId=client)
        return body

    def _drive_servos(self) -> None:
        """Follow the command with a lag at a limited rate, in reach of the measured angle.

        The second filter keeps the steps of a command that comes at 100 Hz out of the rate, and so out of the IMU.
        """
        self._smooth_rad, self._servo_rad, rate_rad_s = _follow(
            self._target_rad,
            self._smooth_rad,
            self._servo_rad,
            self._q_rad,
            self._servo_blend,
            self.model.limits.rate_rad_s * self.dt_s,
            self.settings.servo_reach_rad,
            self.dt_s,
        )
        goal_rad = _within_rate(
            self._servo_rad,
            rate_rad_s,
            self._q_rad,
            self._dq_rad_s,
            self.settings.servo_position_gain / self.dt_s,
            self.settings.servo_velocity_gain,
            self.model.limits.rate_rad_s,
        )
        pybullet.setJointMotorControlArray(
            self._body_id,
            self._joints,
            pybullet.POSITION_CONTROL,
            targetPositions=goal_rad.tolist(),
            targetVelocities=rate_rad_s.tolist(),
            forces=self._strengths,
            positionGains=self._position_gains,
            velocityGains=self._velocity_gains,
            physicsClientId=self.client_id,
        )

    def _push_contacts(self) -> None:
        """Bear the snake on the floor, and oppose its sliding there and on obstacles."""
        self._slow_twist_W = FRICTION_MEMORY * self._slow_twist_W + (1.0 - FRICTION_MEMORY) * self._twist_W
        on_floor = self.floor_contacts()
        bearing_W = on_floor.load_n[:, None] * on_floor.normal_W
        self._push(on_floor, bearing_W + self._friction_W(on_floor))
        on_obstacles = obstacle_contacts(self._body_id, self.client_id)
        self._push(on_obstacles, self._friction_W(on_obstacles))

    def _friction_W(self, contacts: Contacts) -> Float:
        velocity_W, along_W = on_links(
            contacts.link, contacts.point_W, self._slow_twist_W, self._com_W, self._quat_xyzw
        )
        return self._friction.forces(contacts.load_n, velocity_W, contacts.normal_W, along_W)

    def _push(self, contacts: Contacts, forces_W: Float) -> None:
        client, body, frame, push = self.client_id, self._body_id, pybullet.WORLD_FRAME, pybullet.applyExternalForce
        links, points_W = (contacts.link - 1).tolist(), contacts.point_W.tolist()
        for link, force, point in zip(links, forces_W.tolist(), points_W, strict=True):
            push(body, link, force, point, frame, physicsClientId=client)

    def _read(self) -> None:
        client, body = self.client_id, self._body_id
        com_W, quat_xyzw = pybullet.getBasePositionAndOrientation(body, physicsClientId=client)
        v_W, w_W = pybullet.getBaseVelocity(body, physicsClientId=client)
        links: Any = pybullet.getLinkStates(
            body, self._joints, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=client
        )
        joints: Any = pybullet.getJointStates(body, self._joints, physicsClientId=client)
        rows = [com_W + quat_xyzw + v_W + w_W, *[s[0] + s[1] + s[6] + s[7] for s in links]]
        state = np.fromiter(chain.from_iterable(rows), np.float64).reshape(-1, 13)
        self._com_W, self._quat_xyzw, self._twist_W = state[:, :3], state[:, 3:7], state[:, 7:]
        self._q_rad, self._dq_rad_s, self._torque_nm = np.array([(s[0], s[1], s[3]) for s in joints]).T


def lying_pose(model: SnakeModel, x_m: float = 0.0, y_m: float = 0.0, yaw_rad: float = 0.0) -> Float:
    """Return T_W_base of a snake that lies on z = 0 with its tail's end at (x, y), (4, 4)."""
    return se3.from_rt(so3.from_yaw(yaw_rad), np.array([x_m, y_m, model.radius_m]))


def pose_with_head_at(model: SnakeModel, x_m: float, y_m: float, yaw_rad: float = 0.0) -> Float:
    """Return T_W_base of a snake at rest on z = 0 whose head's IMU is over (x, y), (4, 4)."""
    T_W_base = lying_pose(model, yaw_rad=yaw_rad)
    T_WI = kinematics.link_poses(model, model.rest_q_rad, T_W_base)[-1] @ model.T_HI
    T_W_base[:2, 3] += np.array([x_m, y_m]) - T_WI[:2, 3]
    return T_W_base


@compiled
def _pose_on_link(quat_xyzw: Float, com_W: Float, point_L: Float) -> Float:
    """Return the pose of a point of a link, given from the centre of mass, with the link's axes, (4, 4)."""
    x, y, z, w = quat_xyzw / np.sqrt(np.sum(quat_xyzw * quat_xyzw))
    T = np.eye(4)
    T[0, 0], T[0, 1], T[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    T[1, 0], T[1, 1], T[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    T[2, 0], T[2, 1], T[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    for i in range(3):
        T[i, 3] = com_W[i] + np.sum(T[i, :3] * point_L)
    return T


@compiled
def _follow(
    target_rad: Float,
    smooth_rad: Float,
    servo_rad: Float,
    q_rad: Float,
    blend: float,
    largest_step: float,
    reach_rad: float,
    dt_s: float,
) -> tuple[Float, Float, Float]:
    """Return the smoothed command, the servos' own goal and its rate, one step later."""
    smooth_rad = smooth_rad + blend * (target_rad - smooth_rad)
    step = np.clip(blend * (smooth_rad - servo_rad), -largest_step, largest_step)
    within_reach = np.minimum(np.maximum(servo_rad + step, q_rad - reach_rad), q_rad + reach_rad)
    return smooth_rad, within_reach, step / dt_s


@compiled
def _within_rate(
    goal_rad: Float, rate_rad_s: Float, q_rad: Float, dq_rad_s: Float, gain: float, kv: float, fastest: float
) -> Float:
    """Return the goal nearest to ``goal_rad`` that PyBullet's motor does not approach faster than the servo can.

    The motor drives at gain (goal - q) + kv rate + (1 - kv) dq.
    """
    without = kv * rate_rad_s + (1.0 - kv) * dq_rad_s
    driven = np.clip(gain * (goal_rad - q_rad) + without, -fastest, fastest)
    return q_rad + (driven - without) / gain
