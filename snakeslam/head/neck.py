"""The neck: the foremost yaw joints, and where they are along the body.

Arc length s runs from tail to head, in m, with joint n at n l0. The neck begins at s_M, half-way between its first yaw
joint and the yaw joint before it, and ends at s_N, one joint length before the last one, where the head's own heading
begins. Between two yaw joints the body is straight and has the heading phi at its middle.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.errors import InputError
from snakeslam.head.settings import LEAST_NECK_JOINTS, MOST_NECK_JOINTS, HeadSettings
from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel


@dataclass(frozen=True, slots=True)
class Neck:
    """``joints`` (n,) are array indices from tail to head, ``sections_m`` (n + 1,) where the headings are taken: s_M,
    the middles between the joints, and s_N.
    """

    joints: NDArray[np.int64]
    sections_m: Float

    @property
    def s_M_m(self) -> float:
        """Where the neck begins."""
        return float(self.sections_m[0])

    @property
    def s_N_m(self) -> float:
        """Where the neck ends."""
        return float(self.sections_m[-1])

    @property
    def length_m(self) -> float:
        """l_N = s_N - s_M."""
        return self.s_N_m - self.s_M_m


def neck_of(model: SnakeModel, count: int) -> Neck:
    """Return the neck of the ``count`` foremost yaw joints that are free; InputError where the body has too few."""
    free, most = free_yaw_joints(model), most_neck_joints(model)
    if not 1 <= count <= most:
        problem = f"{count} is not possible with {len(free)} free yaw joints"
        raise InputError("head.neck_joints", problem, f"1 to {most}")
    joints = np.array(free[-count:])
    s = (joints + 1) * model.joint_length_m
    middles = (s[1:] + s[:-1]) / 2.0
    ends = s[0] - model.joint_length_m, s[-1] + model.joint_length_m
    return Neck(joints, np.array([ends[0], *middles, ends[1]]))


def neck_joints_of(settings: HeadSettings, model: SnakeModel) -> int:
    """Return the neck's number of yaw joints; a third of the free ones where the settings leave it open."""
    usual = max(LEAST_NECK_JOINTS, min(most_neck_joints(model), round(len(free_yaw_joints(model)) / 3)))
    return usual if settings.neck_joints is None else settings.neck_joints


def free_yaw_joints(model: SnakeModel) -> list[int]:
    """Return the yaw joints that may steer; a raised head freezes the one between its two pitch joints."""
    frozen = model.head_raise_joints[1] if model.head_posture == "raised" else None
    return [k for k in np.flatnonzero(model.is_yaw).tolist() if k != frozen]


def most_neck_joints(model: SnakeModel) -> int:
    """Return the largest neck that leaves the body a third of its yaw joints to move with."""
    return min(MOST_NECK_JOINTS, 2 * len(free_yaw_joints(model)) // 3)
