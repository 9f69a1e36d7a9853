"""One parametric model of an orthogonal snake: the only source of its URDF, frames, masses and limits.

Joints n = 1..N run from tail to head (array index n - 1); odd n turn about z (yaw), even n about -y, so that a
positive pitch lifts the front. Joint n connects link n - 1 to link n. The frame of link k has its origin at the link's
rear end, x forward, y left, z up; link 0 is the tail, link N the head.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from snakeslam.errors import InputError
from snakeslam.geometry import se3
from snakeslam.messages import Float
from snakeslam.robot.limits import JointLimits
from snakeslam.robot.settings import HeadPosture, ModelName, RobotHeadSettings, RobotSettings

YAW_AXIS = (0.0, 0.0, 1.0)
PITCH_AXIS = (0.0, -1.0, 0.0)
IMU_BEHIND_CAMERA_M = 0.012
"""As in a RealSense D435i, whose IMU sits 11.7 mm behind the infrared imager's origin."""
HEAD_RAISE_RAD = float(np.deg2rad(22.0))


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
    camera_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Camera from the front end of the head link's axis: forward, left, up."""
    imu_m: tuple[float, float, float] = (-IMU_BEHIND_CAMERA_M, 0.0, 0.0)
    """IMU from the front end of the head link's axis: forward, left, up."""

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
        """IMU to head link, axes parallel, (4, 4)."""
        return se3.from_rt(np.eye(3), self._from_front(self.imu_m))

    @property
    def T_HC(self) -> Float:
        """Camera (optical frame: z forward, x right, y down) to head link, (4, 4)."""
        c, s = np.cos(self.camera_tilt_rad), np.sin(self.camera_tilt_rad)
        R_HC = np.array([[0.0, s, c], [-1.0, 0.0, 0.0], [0.0, -c, s]])
        return se3.from_rt(R_HC, self._from_front(self.camera_m))

    def _from_front(self, offset_m: tuple[float, float, float]) -> Float:
        """Return a position given from the front end of the head link's axis in the head link's frame, (3,) m."""
        forward, left, up = offset_m
        return np.array([self.joint_length_m + forward, left, up])

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
    """Return the preset that ``settings`` names, with the numbers that they give in place of its own.

    A robot that is not a preset is called by its number of joints. InputError where the numbers do not go together.
    """
    preset = replace(PRESETS[settings.model], head_posture=settings.head_posture)
    given = {
        "joint_count": settings.joint_count,
        "joint_length_m": settings.link_length_m,
        "radius_m": settings.radius_m,
        "link_mass_kg": settings.link_mass_kg,
        "torque_nm": settings.torque_nm,
        "camera_m": settings.head.camera_m,
        "camera_tilt_rad": _radians(settings.head.camera_tilt_deg),
        "imu_m": settings.head.imu_m,
    }
    limits = {
        "position_rad": _radians(settings.position_limit_deg),
        "rate_rad_s": settings.rate_limit_rad_s,
        "acceleration_rad_s2": settings.acceleration_limit_rad_s2,
    }
    model = replace(preset, limits=replace(preset.limits, **_known(limits)), **_known(given))
    if model == preset:
        return preset
    if model.radius_m >= model.joint_length_m:
        # The contact spheres of neighbouring links would reach beyond each other's link.
        raise InputError("robot.radius_m", f"{model.radius_m:g} is not possible", f"< {model.joint_length_m:g}")
    return replace(model, name=f"snake{model.joint_count}")


def robot_document(model: SnakeModel) -> RobotSettings:
    """Return the settings that describe ``model``: a preset by its name, another robot by all of its numbers."""
    for name, preset in PRESETS.items():
        if model == replace(preset, head_posture=model.head_posture):
            return RobotSettings(model=name, head_posture=model.head_posture)
    return RobotSettings(
        head_posture=model.head_posture,
        joint_count=model.joint_count,
        link_length_m=model.joint_length_m,
        radius_m=model.radius_m,
        link_mass_kg=model.link_mass_kg,
        position_limit_deg=float(np.rad2deg(model.limits.position_rad)),
        rate_limit_rad_s=model.limits.rate_rad_s,
        acceleration_limit_rad_s2=model.limits.acceleration_rad_s2,
        torque_nm=model.torque_nm,
        head=RobotHeadSettings(
            camera_m=model.camera_m, camera_tilt_deg=float(np.rad2deg(model.camera_tilt_rad)), imu_m=model.imu_m
        ),
    )


def _radians(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else float(np.deg2rad(angle_deg))


def _known(numbers: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in numbers.items() if value is not None}
