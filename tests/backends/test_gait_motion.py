"""Every gait moves the simulated robot the way its name says, the same at every world yaw, within every limit.

Physics only. At the default amplitudes and a period of 2 s, which moves as far per period as 4 s do (to 20 %), the
robot starts from rest; from 3 s on, one period is measured.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from snakeslam.backends.sim.physics import PhysicsSettings, SnakePhysics, lying_pose
from snakeslam.control import Control
from snakeslam.gaits.catalogue import GaitSettings
from snakeslam.geometry import so3
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import Float, GaitCommand
from snakeslam.robot.model import PRESETS

CONTROL_NS = 10_000_000
START_S, PERIOD_S = 3.0, 2.0
YAWS_DEG = (0.0, 45.0, 90.0, 200.0)

FORWARD, LEFT, RIGHT = np.array([1.0, 0.0]), np.array([0.0, 1.0]), np.array([0.0, -1.0])
BOUNDS = {
    "serpentine": (FORWARD, 0.25, 0.45),
    "sidewinding": (LEFT, 0.50, 0.90),
    "arc_rolling": (RIGHT, 0.19, 0.28),
    "helix_rolling": (RIGHT, 0.14, 0.28),
    "pedal": (FORWARD, 0.12, 0.28),
}
"""Direction in the body's frame, and the least and most displacement per period (m)."""


@dataclass(frozen=True)
class Motion:
    displacement_B: Float
    """Of the robot's middle over one period, in the mean body axis' frame (x forward, y left), (2,) m."""
    turned_deg: float
    heights_m: Float
    q_rad: Float
    dq_rad_s: Float
    targets_rad: Float


def _axis_rad(positions_W):
    """Direction of the line through the links, tail to head."""
    _, _, axes = np.linalg.svd((positions_W - positions_W.mean(axis=0))[:, :2])
    axis = axes[0] * np.sign(axes[0] @ (positions_W[-1] - positions_W[0])[:2])
    return np.arctan2(axis[1], axis[0])


@cache
def _move(name, yaw_deg=0.0, drive=1.0, model_name="sim35", turn=0.0):
    model = PRESETS[model_name]
    control = Control(model, GaitSettings(name=name, period_s=PERIOD_S), HeadSettings(controller="none"))
    control.command(GaitCommand(0, name, drive=drive, turn=turn))
    physics = SnakePhysics(model, PhysicsSettings(), T_W_base=lying_pose(model, yaw_rad=np.deg2rad(yaw_deg)))
    links_W, q_rad, dq_rad_s, targets_rad = [], [], [], []
    try:
        for tick in range(round((START_S + PERIOD_S) * 100) + 1):
            if tick >= START_S * 100:
                links_W.append(physics.Ts_WL[:, :3, 3])
            targets_rad.append(control.step(tick * CONTROL_NS, None, None, None).q_rad)
            physics.set_target(targets_rad[-1])
            for _ in range(physics.settings.rate_hz // 100):
                physics.step()
                q_rad.append(physics.joint_state()[0])
                dq_rad_s.append(physics.joint_state()[1])
    finally:
        physics.close()
    links_W = np.array(links_W)
    axes = np.unwrap([_axis_rad(positions) for positions in links_W])
    moved_W = (links_W[-1] - links_W[0]).mean(axis=0)
    displacement_B = (so3.from_yaw(axes.mean()).T @ moved_W)[:2]
    turned_deg = float(np.rad2deg(axes[-1] - axes[0]))
    return Motion(displacement_B, turned_deg, links_W[:, :, 2], *map(np.array, (q_rad, dq_rad_s, targets_rad)))


@pytest.mark.parametrize("name", list(BOUNDS))
def test_it_moves_the_way_its_name_says_and_keeps_its_heading(name):
    direction, least, most = BOUNDS[name]
    motion = _move(name)
    assert least < motion.displacement_B @ direction < most
    across = motion.displacement_B - (motion.displacement_B @ direction) * direction
    assert np.linalg.norm(across) < 0.4 * np.linalg.norm(motion.displacement_B)
    assert abs(motion.turned_deg) < 6.0
    assert np.max(motion.heights_m) < 0.3


@pytest.mark.parametrize("name", list(BOUNDS))
def test_the_world_yaw_makes_no_difference(name):
    reference = _move(name)
    size = np.linalg.norm(reference.displacement_B)
    for yaw_deg in YAWS_DEG[1:]:
        motion = _move(name, yaw_deg)
        assert np.linalg.norm(motion.displacement_B - reference.displacement_B) < 0.03 * size, yaw_deg
        assert abs(motion.turned_deg - reference.turned_deg) < 1.0


@pytest.mark.parametrize("name", list(BOUNDS))
def test_no_joint_or_rate_limit_is_broken(name):
    limits, motion = PRESETS["sim35"].limits, _move(name)
    rates = np.diff(motion.targets_rad, axis=0) / 0.01
    for angles in (motion.q_rad, motion.targets_rad):
        assert np.max(np.abs(angles)) <= limits.position_rad
    assert np.max(np.abs(rates)) <= limits.rate_rad_s
    assert np.max(np.abs(np.diff(rates, axis=0))) / 0.01 <= limits.acceleration_rad_s2
    assert np.max(np.abs(motion.dq_rad_s)) <= limits.rate_rad_s + 0.05
    # While a long arc is formed on the ground the servos are at their torque; afterwards they follow.
    lag = (motion.q_rad[3::4] - motion.targets_rad)[round(START_S * 100) :]
    assert np.max(np.abs(lag)) < 0.2


def test_the_prototype_winds_forward_too():
    motion = _move("serpentine", model_name="orthogonal24")
    assert 0.2 < motion.displacement_B[0] < 0.45
    assert abs(motion.turned_deg) < 3.0


@pytest.mark.parametrize("name", ["sidewinding", "arc_rolling"])
def test_backwards_is_the_other_way(name):
    direction, least, most = BOUNDS[name]
    assert 0.8 * least < -_move(name, drive=-1.0).displacement_B @ direction < most


def test_a_turn_to_the_left_bends_the_serpentine_path_to_the_left():
    assert _move("serpentine", turn=1.0).turned_deg > 3.0 + _move("serpentine").turned_deg
