"""The resistive map: against brute force, finite differences of the kinematics, and its symmetries."""

import numpy as np
import pytest
from scipy import optimize

from snakeslam.geometry import se3, so3
from snakeslam.robot.friction import resistive_map
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import PRESETS
from snakeslam.robot.support import posture_loads
from tests.head.plane import FLAT

MODEL = PRESETS["sim35"]
H = 1e-6
# Three points of Gauss's rule integrate a link's friction along its length exactly.
NODES, SHARES = np.polynomial.legendre.leggauss(3)


def winding(model, seed=0, bend=0.8):
    rng = np.random.default_rng(seed)
    q_rad = np.where(model.is_yaw, rng.uniform(-bend, bend, model.joint_count), model.rest_q_rad)
    return q_rad, np.where(model.is_yaw, rng.normal(size=model.joint_count), 0.0)


def pose(yaw=0.0, x=0.0, y=0.0):
    return se3.from_rt(so3.from_yaw(yaw), np.array([x, y, 0.0]))


def slipping(model, q_rad, dq_rad_s, T_WI, twist):
    """Velocities (links, 3 points, 2) m/s by differences, the points, and the directions of the links."""
    l0 = model.joint_length_m
    points_L = np.stack([(NODES + 1.0) / 2.0 * l0, 0.0 * NODES, 0.0 * NODES, 1.0 + 0.0 * NODES], axis=-1)

    def points(h):
        c, s = np.cos(h * twist[2]), np.sin(h * twist[2])
        R = np.eye(4)
        R[:2, :2] = [[c, -s], [s, c]]
        T = R @ T_WI
        T[:2, 3] = T_WI[:2, 3] + h * twist[:2]
        Ts = link_poses_from_imu(model, q_rad + h * dq_rad_s, T)
        return np.einsum("nij,pj->npi", Ts, points_L)[..., :2]

    Ts = link_poses_from_imu(model, q_rad, T_WI)
    along = Ts[:, :2, 0] / np.linalg.norm(Ts[:, :2, 0], axis=1)[:, None]
    return (points(H) - points(-H)) / (2.0 * H), points(0.0), along


def friction(model, q_rad, dq_rad_s, T_WI, twist, loads, ratio):
    """The dissipated power over two, and the net force and moment about the IMU."""
    v, points, along = slipping(model, q_rad, dq_rad_s, T_WI, twist)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    v_t, v_n = (np.einsum("npi,ni->np", v, axis) for axis in (along, across))
    w = loads[:, None] * SHARES / 2.0
    force = -(w * v_t)[..., None] * along[:, None] - ratio * (w * v_n)[..., None] * across[:, None]
    arm = points - T_WI[:2, 3]
    moment = np.sum(arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0])
    return 0.5 * np.sum(w * (v_t**2 + ratio * v_n**2)), np.r_[np.sum(force, axis=(0, 1)), moment]


@pytest.mark.parametrize("ratio", [1.0, 3.0, 30.0])
def test_the_motion_has_no_net_force_and_no_net_moment(ratio):
    loads = np.random.default_rng(1).uniform(0.2, 2.0, FLAT.link_count)
    T_WI = pose(0.7, 1.5, -0.8)
    q_rad, dq_rad_s = winding(FLAT)
    twist = resistive_map(FLAT, q_rad, T_WI, loads, ratio) @ dq_rad_s
    _, net = friction(FLAT, q_rad, dq_rad_s, T_WI, twist, loads, ratio)
    _, held = friction(FLAT, q_rad, dq_rad_s, T_WI, np.zeros(3), loads, ratio)
    assert np.max(np.abs(net)) < 1e-7 * np.max(np.abs(held))


def test_the_motion_is_the_one_of_least_dissipation():
    loads = np.random.default_rng(2).uniform(0.2, 2.0, FLAT.link_count)
    q_rad, dq_rad_s = winding(FLAT, 3)
    T_WI = pose(-0.4)
    twist = resistive_map(FLAT, q_rad, T_WI, loads, 5.0) @ dq_rad_s
    found = optimize.minimize(
        lambda x: friction(FLAT, q_rad, dq_rad_s, T_WI, x, loads, 5.0)[0], np.zeros(3), method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-14, "maxiter": 2000},
    )  # fmt: skip
    assert found.success
    np.testing.assert_allclose(twist, found.x, atol=1e-4 * np.linalg.norm(twist))


def test_the_map_is_the_least_squares_of_the_links_own_rows_in_three_dimensions():
    """With pitch joints bent and moving, and the head tilted: rows A x + B dq of each link by differences."""
    rng = np.random.default_rng(4)
    q_rad, ratio = rng.uniform(-0.5, 0.5, MODEL.joint_count), 4.0
    T_WI = se3.from_rt(so3.exp(0.3 * rng.normal(size=3)), rng.normal(size=3))
    loads = rng.uniform(0.2, 2.0, MODEL.link_count)
    Ts = link_poses_from_imu(MODEL, q_rad, T_WI)
    along = Ts[:, :2, 0] / np.linalg.norm(Ts[:, :2, 0], axis=1)[:, None]
    axes = np.stack([along, np.sqrt(ratio) * np.stack([-along[:, 1], along[:, 0]], axis=1)], axis=1)
    axes = axes * np.sqrt(loads)[:, None, None]
    spin = np.sqrt(loads * ratio / 12.0) * MODEL.joint_length_m

    def rows(velocity, turn_z):
        return np.concatenate([np.einsum("nij,nj->ni", axes, velocity).ravel(), spin * turn_z])

    def moved(dq):
        ahead, behind = (link_poses_from_imu(MODEL, q_rad + h * dq, T_WI) for h in (H, -H))
        velocity = (se3.act(ahead, MODEL.com_L) - se3.act(behind, MODEL.com_L)) / (2.0 * H)
        turn = so3.log(ahead[:, :3, :3] @ np.swapaxes(behind[:, :3, :3], 1, 2)) / (2.0 * H)
        return rows(velocity[:, :2], turn[:, 2])

    arms = se3.act(Ts, MODEL.com_L)[:, :2] - T_WI[:2, 3]
    ones, zeros = np.ones(len(arms)), np.zeros(len(arms))
    rigid = [np.stack([ones, zeros], 1), np.stack([zeros, ones], 1), np.stack([-arms[:, 1], arms[:, 0]], 1)]
    A = np.stack([rows(v, turn) for v, turn in zip(rigid, (zeros, zeros, ones), strict=True)], axis=1)
    B = np.stack([moved(dq) for dq in np.eye(MODEL.joint_count)], axis=1)
    expected = -np.linalg.lstsq(A, B, rcond=None)[0]
    np.testing.assert_allclose(resistive_map(MODEL, q_rad, T_WI, loads, ratio), expected, atol=1e-6)


@pytest.mark.parametrize("model", [FLAT, MODEL], ids=["flat", "raised"])
def test_world_yaw_and_place_change_nothing_but_the_axes(model):
    q_rad, _ = winding(model, 5)
    loads = posture_loads(model)
    J = resistive_map(model, q_rad, pose(), loads, 4.0)
    for yaw, x, y in ((0.9, 0.0, 0.0), (-2.5, 3.0, 1.0)):
        turned = resistive_map(model, q_rad, pose(yaw, x, y), loads, 4.0)
        np.testing.assert_allclose(turned, so3.from_yaw(yaw) @ J, atol=1e-12)


def test_a_mirrored_body_moves_as_the_mirror_image():
    q_rad, dq_rad_s = winding(FLAT, 6)
    loads = posture_loads(FLAT)
    ours, mirrored = (resistive_map(FLAT, sign * q_rad, pose(), loads, 4.0) @ (sign * dq_rad_s) for sign in (1, -1))
    np.testing.assert_allclose(mirrored, ours * [1.0, -1.0, -1.0], atol=1e-12)


def test_a_wave_towards_the_tail_drives_the_body_forward_only_where_friction_has_a_direction():
    n = np.arange(1, 36)
    loads = np.ones(FLAT.link_count)

    def forward(ratio, omega):
        travelled = 0.0
        for sigma in np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False):
            wave = 2.0 * np.pi / 20.0 * n + sigma
            q_rad, dq = (np.where(FLAT.is_yaw, 0.58 * f, 0.0) for f in (np.sin(wave), omega * np.cos(wave)))
            T_WI = pose(0.3 * np.pi * -np.cos(2.0 * np.pi / 20.0 * 36 + sigma))
            travelled += (resistive_map(FLAT, q_rad, T_WI, loads, ratio) @ dq)[0]
        return travelled / 24.0

    assert forward(10.0, np.pi / 2.0) > 0.15
    assert forward(10.0, -np.pi / 2.0) == pytest.approx(-forward(10.0, np.pi / 2.0))
    assert abs(forward(1.0, np.pi / 2.0)) < 0.2 * forward(10.0, np.pi / 2.0)
