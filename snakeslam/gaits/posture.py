"""The raised head in a gait: two bends of the neck, up and back, with the camera high and level.

For a body that does not roll, the upper three neck joints belong to the posture: pitch +22 deg, the yaw joint between
frozen (it would roll the head), pitch -22 deg. A rolling body rotates about its own axis by the gait's phase, so there
the bend rotates backwards in the body and stays upwards in the world, which needs two yaw joints as well. A rolling
helix would trip over a raised head and keeps its head low.
"""

import numpy as np

from snakeslam.gaits.gait import ResolvedGait
from snakeslam.gaits.parametric import joint_angles, joint_slopes
from snakeslam.messages import Float
from snakeslam.robot.model import HEAD_RAISE_RAD, SnakeModel


def posed_angles(gait: ResolvedGait, model: SnakeModel, sigma: float) -> tuple[Float, Float]:
    """Return the angles (N,) rad at phase ``sigma`` and their slope d/d(sigma), the head held as the model says."""
    q_rad = joint_angles(gait.shape, model.joint_count, sigma)
    slope = joint_slopes(gait.shape, model.joint_count, sigma)
    if model.head_posture == "flat" or not gait.raises_head:
        return q_rad, slope
    if gait.rolls:
        _raise_rolling(q_rad, slope, model, sigma - gait.start_sigma)
    else:
        neck = list(model.head_raise_joints)
        q_rad[neck] = HEAD_RAISE_RAD, 0.0, -HEAD_RAISE_RAD
        slope[neck] = 0.0
    return q_rad, slope


def _raise_rolling(q_rad: Float, slope: Float, model: SnakeModel, roll_rad: float) -> None:
    """Add the bend that is upwards in the world while the body has rolled by ``roll_rad`` about its x axis."""
    lower, yaw_between, upper = model.head_raise_joints
    yaw_lower = yaw_between if model.joint_count % 2 else yaw_between - 2
    up, side = np.cos(roll_rad), np.sin(roll_rad)
    for first, second, along, change in ((lower, upper, up, -side), (yaw_lower, yaw_lower + 2, side, up)):
        for joint, sign in ((first, 1.0), (second, -1.0)):
            q_rad[joint] += sign * HEAD_RAISE_RAD * along
            slope[joint] += sign * HEAD_RAISE_RAD * change
