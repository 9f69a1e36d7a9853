"""One parametric model of an orthogonal snake: the only source of its URDF, frames, masses and limits.

Joints n = 1..N run from tail to head (array index n - 1); odd n turn about z (yaw), even n about -y, so that a
positive pitch lifts the front. Joint n connects link n - 1 to link n. The frame of link k has its origin at the link's
rear end, x forward, y left, z up; link 0 is the tail, link N the head.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from snakeslam.geometry import se3
from snakeslam.messages import Float
from snakeslam.robot.limits import JointLimits
from snakeslam.settings import Settings

ModelName = Literal["sim35", "orthogonal24"]
HeadPosture = Literal["flat", "raised"]

YAW_AXIS = (0.0, 0.0, 1.0)
PITCH_AXIS = (0.0, -1.0, 0.0)
IMU_BEHIND_CAMERA_M = 0.012
"""As in a RealSense D435i, whose IMU sits 11.7 mm behind the infrared imager's origin."""
HEAD_RAISE_RAD = float(np.deg2rad(22.0))


class RobotSettings(Settings):
    """Which robot, and how it carries its head."""

    model: ModelName = "sim35"
    """sim35: the paper's simulated robot, 35 joints of 89.95 mm; orthogonal24: its prototype, 24 joints of 96 mm."""
    head_posture: HeadPosture = "raised"
    """raised lifts the head by two pitch joints (+-22 deg) and freezes the yaw joint between them; flat."""


@dataclass(frozen=True, slots=True)
class SnakeModel:
    """An orthogonal snake of equal links; lengths in m, masses in kg, angles in rad."""

    name: str
    joint_count: int
    joint_length_m: float
    radius_m: float
    link_mass_kg: float
    limits: JointLimits
    torque_nm: float = 8.0
    head_posture: HeadPosture = "raised"
    camera_tilt_rad: float = 0.0
    """Upward tilt of the camera in the head; 0 serves rolling gaits too, where up is every direction in turn."""

    @property
    def link_count(self) -> int:
        """Links, one more than joints."""
        return self.joint_count + 1

    @property
    def length_m(self) -> float:
        """Length of the straight body."""
        return self.link_count * self.joint_length_m

    @property
    def axes_L(self) -> Float:
        """Axis of each joint in its link's frame, (N, 3)."""
        return np.array([YAW_AXIS if n % 2 else PITCH_AXIS for n in range(1, self.joint_count + 1)])

    @property
    def is_yaw(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Which joints are yaw joints, (N,) bool."""
        return np.arange(1, self.joint_count + 1) % 2 == 1

    @property
    def link_masses_kg(self) -> Float:
        """Mass of each link, (N + 1,)."""
        return np.full(self.link_count, self.link_mass_kg)

    @property
    def com_L(self) -> Float:
        """Centre of mass of a link in its frame, (3,) m."""
        return np.array([self.joint_length_m / 2.0, 0.0, 0.0])

    @property
    def inertia_L(self) -> Float:
        """Inertia of a link about its centre of mass (a solid cylinder along x), (3, 3) kg m^2."""
        m, r, length = self.link_mass_kg, self.radius_m, self.joint_length_m
        along, across = m * r**2 / 2.0, m * (3.0 * r**2 + length**2) / 12.0
        return np.diag([along, across, across])

    @property
    def sphere_centres_L(self) -> Float:
        """Centres of the contact spheres (radius ``radius_m``) of a link in its frame, (2, 3) m."""
        return np.array([[0.25, 0.0, 0.0], [0.75, 0.0, 0.0]]) * self.joint_length_m

    @property
    def T_HI(self) -> Float:
        """IMU to head link: in the camera's housing at the link's front, axes parallel, (4, 4)."""
        return se3.from_rt(np.eye(3), np.array([self.joint_length_m - IMU_BEHIND_CAMERA_M, 0.0, 0.0]))

    @property
    def T_HC(self) -> Float:
        """Camera (optical frame: z forward, x right, y down) to head link: on the front end of its axis, (4, 4)."""
        c, s = np.cos(self.camera_tilt_rad), np.sin(self.camera_tilt_rad)
        R_HC = np.array([[0.0, s, c], [-1.0, 0.0, 0.0], [0.0, -c, s]])
        return se3.from_rt(R_HC, np.array([self.joint_length_m, 0.0, 0.0]))

    @property
    def T_CI(self) -> Float:
        """IMU to camera, (4, 4)."""
        return se3.inv(self.T_HC) @ self.T_HI

    @property
    def head_raise_joints(self) -> tuple[int, int, int]:
        """Array indices of the joints that raise the head: lower pitch, the yaw between, upper pitch."""
        upper = self.joint_count - 1 - self.joint_count % 2
        return upper - 2, upper - 1, upper

    @property
    def rest_q_rad(self) -> Float:
        """Joint angles at rest: straight, with the head raised where the posture says so, (N,)."""
        q_rad = np.zeros(self.joint_count)
        if self.head_posture == "raised":
            lower, _, upper = self.head_raise_joints
            q_rad[lower], q_rad[upper] = HEAD_RAISE_RAD, -HEAD_RAISE_RAD
        return q_rad

    def urdf(self) -> str:
        """Return the URDF: links ``link_0`` .. ``link_N``, joints ``joint_1`` .. ``joint_N``."""
        joints = "".join(self._urdf_joint(n) for n in range(1, self.joint_count + 1))
        links = "".join(self._urdf_link(k) for k in range(self.link_count))
        return f'<?xml version="1.0"?>\n<robot name="{self.name}">\n{links}{joints}</robot>\n'

    def _urdf_link(self, k: int) -> str:
        x = f"{self.joint_length_m / 2.0!r} 0 0"
        i = np.diag(self.inertia_L).tolist()
        cylinder = f'<cylinder radius="{self.radius_m!r}" length="{0.9 * self.joint_length_m!r}"/>'
        spheres = "".join(
            f'<collision><origin xyz="{c[0]!r} 0 0"/>'
            f'<geometry><sphere radius="{self.radius_m!r}"/></geometry></collision>\n'
            for c in self.sphere_centres_L.tolist()
        )
        return (
            f'<link name="link_{k}">\n'
            f'<inertial><origin xyz="{x}"/><mass value="{self.link_mass_kg!r}"/>'
            f'<inertia ixx="{i[0]!r}" iyy="{i[1]!r}" izz="{i[2]!r}" ixy="0" ixz="0" iyz="0"/></inertial>\n'
            f'<visual><origin xyz="{x}" rpy="0 {np.pi / 2!r} 0"/>'
            f"<geometry>{cylinder}</geometry></visual>\n"
            f"{spheres}</link>\n"
        )

    def _urdf_joint(self, n: int) -> str:
        axis = " ".join(repr(c) for c in (YAW_AXIS if n % 2 else PITCH_AXIS))
        limit = self.limits
        return (
            f'<joint name="joint_{n}" type="revolute"><parent link="link_{n - 1}"/><child link="link_{n}"/>'
            f'<origin xyz="{self.joint_length_m!r} 0 0"/><axis xyz="{axis}"/>'
            f'<limit lower="{-limit.position_rad!r}" upper="{limit.position_rad!r}" '
            f'effort="{self.torque_nm!r}" velocity="{limit.rate_rad_s!r}"/></joint>\n'
        )


_LIMITS = JointLimits(position_rad=float(np.deg2rad(95.0)), rate_rad_s=6.0, acceleration_rad_s2=40.0)
PRESETS: dict[ModelName, SnakeModel] = {
    "sim35": SnakeModel("sim35", 35, 0.08995, 0.032, 0.2, _LIMITS),
    "orthogonal24": SnakeModel("orthogonal24", 24, 0.096, 0.032, 0.22, _LIMITS),
}


def snake_model(settings: RobotSettings) -> SnakeModel:
    """Return the preset that ``settings`` names, with its head posture."""
    return replace(PRESETS[settings.model], head_posture=settings.head_posture)
