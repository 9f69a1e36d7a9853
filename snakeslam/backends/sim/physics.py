"""The snake's body in PyBullet: rigid links, servos and an external friction law, one step at a time."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pybullet

from snakeslam.backends.sim.friction import CoulombFriction
from snakeslam.backends.sim.settings import PhysicsSettings
from snakeslam.errors import BackendError
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float
from snakeslam.robot import kinematics
from snakeslam.robot.model import SnakeModel

GRAVITY_M_S2 = 9.81
FRICTION_MEMORY = 0.5
"""Share of the past in the velocity that friction sees, a lag of one step. An explicit force on the present velocity
makes the rolling of the whole body chatter once mu N dt / (eps m_eff) > 2 (2.2 at 400 Hz); with this, only beyond 6."""


class SnakePhysics:
    """A snake over a plane in its own PyBullet client; deterministic: it has no noise and no clock.

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
        self._friction = CoulombFriction(
            settings.friction_normal / friction_ratio, settings.friction_normal, settings.friction_slip_m_s
        )
        self._client: int | None = pybullet.connect(pybullet.DIRECT)
        q_rad = model.rest_q_rad if q_rad is None else np.asarray(q_rad, dtype=np.float64)
        self._configure()
        self._body_id = self._load_snake(lying_pose(model) if T_W_base is None else T_W_base, q_rad)
        self._joints = list(range(model.joint_count))
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
    def ground_id(self) -> int:
        """PyBullet's id of the plane z = 0."""
        return self._ground_id

    @property
    def Ts_WL(self) -> Float:
        """Poses of links 0..N, (N + 1, 4, 4)."""
        R_WL = so3.matrix_from_quat_wxyz(np.roll(self._quat_xyzw, 1, axis=-1))
        return se3.from_rt(R_WL, self._com_W - R_WL @ self.model.com_L)

    def head_state(self) -> tuple[Float, Float, Float]:
        """Return T_WI (4, 4), the IMU's velocity v_W (3,) m/s in W and its angular rate w_I (3,) rad/s in I."""
        R_WH = so3.matrix_from_quat_wxyz(np.roll(self._quat_xyzw[-1], 1))
        T_WH = se3.from_rt(R_WH, self._com_W[-1] - R_WH @ self.model.com_L)
        T_WI = T_WH @ self.model.T_HI
        v_com_W, w_W = self._twist_W[-1, :3], self._twist_W[-1, 3:]
        v_W = v_com_W + so3.hat(w_W) @ (T_WI[:3, 3] - self._com_W[-1])
        return T_WI, v_W, T_WI[:3, :3].T @ w_W

    def joint_state(self) -> tuple[Float, Float, Float]:
        """Return true angles (rad), rates (rad/s) and servo torques (N m), each (N,)."""
        return self._q_rad, self._dq_rad_s, self._torque_nm

    def set_target(self, q_rad: Float) -> None:
        """Command the servos, (N,) rad."""
        limit = self.model.limits.position_rad
        self._target_rad = np.clip(np.asarray(q_rad, dtype=np.float64), -limit, limit)

    def step(self) -> None:
        """Advance one physics step of ``dt_s``."""
        self._drive_servos()
        self._apply_friction()
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
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        self._ground_id: int = pybullet.createMultiBody(0.0, plane, physicsClientId=client)

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
                # A rigid chain on rigid ground bears its weight anywhere: the solver left it all on the front spheres.
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
        settings, limits = self.settings, self.model.limits
        blend = self.dt_s / (0.5 * settings.servo_lag_s + self.dt_s)
        largest_step = limits.rate_rad_s * self.dt_s
        self._smooth_rad = self._smooth_rad + blend * (self._target_rad - self._smooth_rad)
        step = np.clip(blend * (self._smooth_rad - self._servo_rad), -largest_step, largest_step)
        wanted = self._servo_rad + step
        reach = settings.servo_reach_rad
        self._servo_rad = np.clip(wanted, self._q_rad - reach, self._q_rad + reach)
        rate = step / self.dt_s
        goal_rad = self._within_rate(self._servo_rad, rate)
        count = self.model.joint_count
        pybullet.setJointMotorControlArray(
            self._body_id,
            self._joints,
            pybullet.POSITION_CONTROL,
            targetPositions=goal_rad.tolist(),
            targetVelocities=rate.tolist(),
            forces=[self.model.torque_nm] * count,
            positionGains=[settings.servo_position_gain] * count,
            velocityGains=[settings.servo_velocity_gain] * count,
            physicsClientId=self.client_id,
        )

    def _within_rate(self, goal_rad: Float, rate: Float) -> Float:
        """Return the goal nearest to ``goal_rad`` that PyBullet's motor does not approach faster than the servo can.

        The motor drives at kp (goal - q) / dt + kv rate + (1 - kv) dq.
        """
        gain = self.settings.servo_position_gain / self.dt_s
        kv, fastest = self.settings.servo_velocity_gain, self.model.limits.rate_rad_s
        without = kv * rate + (1.0 - kv) * self._dq_rad_s
        driven = np.clip(gain * (goal_rad - self._q_rad) + without, -fastest, fastest)
        return self._q_rad + (driven - without) / gain

    def _apply_friction(self) -> None:
        """Push each contact of the last step with the friction law, at the load it carried and its velocity."""
        client, body = self.client_id, self._body_id
        self._slow_twist_W = FRICTION_MEMORY * self._slow_twist_W + (1.0 - FRICTION_MEMORY) * self._twist_W
        contacts: list[Any] = [c for c in pybullet.getContactPoints(body, physicsClientId=client) if c[9] > 0.0]
        if not contacts:
            return
        link = np.array([c[3] for c in contacts]) + 1
        rows = np.array([(*c[5], *c[7], c[9]) for c in contacts])
        point_W, normal_W, load_n = rows[:, :3], rows[:, 3:6], rows[:, 6]
        twist_W = self._slow_twist_W[link]
        velocity_W = twist_W[:, :3] + so3.cross(twist_W[:, 3:], point_W - self._com_W[link])
        forces_W = self._friction.forces(load_n, velocity_W, normal_W, _x_axes(self._quat_xyzw)[link])
        for contact, force in zip(contacts, forces_W.tolist(), strict=True):
            pybullet.applyExternalForce(
                body, contact[3], force, contact[5], pybullet.WORLD_FRAME, physicsClientId=client
            )

    def _read(self) -> None:
        client, body = self.client_id, self._body_id
        com_W, quat_xyzw = pybullet.getBasePositionAndOrientation(body, physicsClientId=client)
        v_W, w_W = pybullet.getBaseVelocity(body, physicsClientId=client)
        links: Any = pybullet.getLinkStates(
            body, self._joints, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=client
        )
        joints: Any = pybullet.getJointStates(body, self._joints, physicsClientId=client)
        state = np.array([(*com_W, *quat_xyzw, *v_W, *w_W), *((*s[0], *s[1], *s[6], *s[7]) for s in links)])
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


def _x_axes(quat_xyzw: Float) -> Float:
    """Return the x axes of unit quaternions, (L, 4) -> (L, 3)."""
    x, y, z, w = quat_xyzw.T
    return np.stack([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)], axis=-1)
