"""A snake on a plane: quasi-static Coulomb friction, servos that lag, estimates that come late.

Its kinematics and its friction share nothing with ``snakeslam.robot.friction``, against which it stands.
"""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from snakeslam.control import Control
from snakeslam.gaits.catalogue import GaitSettings
from snakeslam.geometry import se3, so3
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import GaitCommand, Health, ImuSample, PoseEstimate, Verdict
from snakeslam.robot.model import IMU_BEHIND_CAMERA_M, PRESETS

FLAT = replace(PRESETS["sim35"], head_posture="flat")
DT_S = 0.02
PERIOD_S = 4.0
POSE_EVERY = 2
ROUNDS = 12
CREEP_M_S = 1e-4
HEALTH = Health(Verdict.GOOD)


def pose_estimate(t_ns, x=0.0, y=0.0, yaw=0.0, v=(0.0, 0.0)):
    return PoseEstimate(
        t_ns, se3.from_rt(so3.from_yaw(yaw), np.array([x, y, 0.0])), np.array([*v, 0.0]), np.eye(9), HEALTH
    )


def gyro(t_ns, rate_rad_s):
    return ImuSample(t_ns, np.array([0.0, 0.0, rate_rad_s]), np.array([0.0, 0.0, 9.81]))


class Plane:
    """``head`` is (x, y, yaw) of the IMU, ``twist`` its rate; two contacts for each link, as on the robot."""

    def __init__(self, ratio, lag_s, yaw=0.0):
        self.q_rad = FLAT.rest_q_rad
        self.head = np.array([0.0, 0.0, yaw])
        self.twist = np.zeros(3)
        self._ratio = ratio
        self._follow = 1.0 - np.exp(-DT_S / lag_s)

    def step(self, target_rad):
        q_rad = self.q_rad + self._follow * (target_rad - self.q_rad)
        before, _ = contacts(self.q_rad, self.head[2])
        after, _ = contacts(q_rad, self.head[2])
        arms, heading = contacts((self.q_rad + q_rad) / 2.0, self.head[2])
        self.twist = self._slide(arms, heading, (after - before) / DT_S)
        self.q_rad = q_rad
        turned = self.twist[2] * DT_S / 2.0
        c, s = np.cos(turned), np.sin(turned)
        self.head = self.head + DT_S * np.r_[np.array([[c, -s], [s, c]]) @ self.twist[:2], self.twist[2]]

    def _slide(self, arms, heading, moved):
        """Least dissipation: the twist that minimises the sum of |(v_t, ratio v_n)|, by reweighted least squares."""
        c, s = np.cos(heading), np.sin(heading)
        axes = np.stack([np.stack([c, s], -1), self._ratio * np.stack([-s, c], -1)], axis=1)
        rigid = np.zeros((len(arms), 2, 3))
        rigid[:, 0, 0] = rigid[:, 1, 1] = 1.0
        rigid[:, 0, 2], rigid[:, 1, 2] = -arms[:, 1], arms[:, 0]
        A, b = axes @ rigid, np.einsum("nij,nj->ni", axes, moved)
        twist = self.twist
        for _ in range(ROUNDS):
            w = 1.0 / np.hypot(CREEP_M_S, np.linalg.norm(A @ twist + b, axis=1))[:, None]
            Aw = (A * w[..., None]).reshape(-1, 3)
            twist = np.linalg.solve(Aw.T @ A.reshape(-1, 3) + 1e-9 * np.eye(3), -Aw.T @ b.ravel())
        return twist


def contacts(q_rad, yaw):
    """The contacts (2 links, 2) m seen from the IMU, axes of the world, and the headings of their links."""
    turn = np.where(FLAT.is_yaw, q_rad, 0.0)
    heading = yaw - np.append(np.cumsum(turn[::-1])[::-1], 0.0)
    link = FLAT.joint_length_m * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    front = IMU_BEHIND_CAMERA_M / FLAT.joint_length_m * link[-1]
    rear = front - np.cumsum(link[::-1], axis=0)[::-1]
    return np.concatenate([rear + 0.25 * link, rear + 0.75 * link]), np.tile(heading, 2)


@dataclass
class Ride:
    """What the head did, a row for each step: (x, y, yaw)."""

    head: np.ndarray
    targets: np.ndarray
    control: Control

    def settled(self, periods=2):
        return self.head[int(periods * PERIOD_S / DT_S) :]

    @property
    def yaw_rms_deg(self):
        return float(np.rad2deg(np.std(self.settled()[:, 2])))

    @property
    def sway_m(self):
        """Lateral p-p across the head's mean heading."""
        x, y = (self.settled()[:, :2] - self.settled()[0, :2]).T
        yaw = float(np.mean(self.settled()[:, 2]))
        across = -np.sin(yaw) * x + np.cos(yaw) * y
        return float(np.ptp(across))

    @property
    def peak_rate_deg_s(self):
        return float(np.rad2deg(np.max(np.abs(np.diff(self.settled()[:, 2])))) / DT_S)

    @property
    def speed_m_s(self):
        d = self.settled()[-1, :2] - self.settled()[0, :2]
        return float(np.hypot(*d) / (DT_S * (len(self.settled()) - 1)))


def ride(
    controller,
    *,
    alpha_pi=0.5,
    ratio=3.0,
    lag_s=0.03,
    delay_s=0.1,
    supposed=4.0,
    neck=6,
    periods=3,
    sensors="both",
    commands=(),
):
    """Drive the serpentine gait; ``sensors``: both, gyro or none; ``commands`` are (step, command) pairs."""
    head = HeadSettings(controller=controller, neck_joints=neck, friction_ratio=supposed)
    control = Control(FLAT, GaitSettings(alpha_pi=alpha_pi, period_s=PERIOD_S), head)
    control.command(GaitCommand(0, "serpentine", parameters={"alpha_pi": alpha_pi, "period_s": PERIOD_S}))
    plane = Plane(ratio, lag_s)
    late, pose = deque(), None
    heads, targets = [], []
    due = dict(commands)
    for k in range(round(periods * PERIOD_S / DT_S)):
        t_ns = round(k * DT_S * 1e9)
        if k % POSE_EVERY == 0:
            late.append(pose_estimate(t_ns, *plane.head, v=plane.twist[:2]))
        while late and t_ns - late[0].t_ns >= delay_s * 1e9:
            pose = late.popleft()
        if k in due:
            control.command_head(due[k])
        imu = None if sensors == "none" else gyro(t_ns, plane.twist[2])
        target = control.step(t_ns, None, pose if sensors == "both" else None, imu)
        plane.step(target.q_rad)
        heads.append(plane.head)
        targets.append(target.q_rad)
    return Ride(np.array(heads), np.array(targets), control)
