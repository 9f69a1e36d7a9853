"""Group axioms and Jacobians of SO(3) and SE(3), over batch shapes."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from snakeslam.geometry import numeric, se3, so3


@dataclass(frozen=True)
class Group:
    """A Lie group by its functions."""

    name: str
    module: Any
    tangent: int
    size: int

    def inv(self, X: np.ndarray) -> np.ndarray:
        return np.swapaxes(X, -1, -2) if self.name == "so3" else se3.inv(X)


GROUPS = [Group("so3", so3, 3, 3), Group("se3", se3, 6, 4)]
SHAPES = st.sampled_from([(), (1,), (4,), (2, 3), (0,)])
groups = pytest.mark.parametrize("group", GROUPS, ids=lambda g: g.name)


def tangents(size: int, shape: tuple[int, ...], reach: float) -> st.SearchStrategy[np.ndarray]:
    return hnp.arrays(np.float64, (*shape, size), elements=st.floats(-reach, reach, allow_subnormal=False))


def draw_elements(data: st.DataObject, group: Group, count: int) -> list[np.ndarray]:
    shape = data.draw(SHAPES)
    return [group.module.exp(data.draw(tangents(group.tangent, shape, 3.0))) for _ in range(count)]


@groups
@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_group_axioms(group: Group, data: st.DataObject) -> None:
    a, b, c = draw_elements(data, group, 3)
    identity = np.broadcast_to(np.eye(group.size), a.shape)
    np.testing.assert_allclose((a @ b) @ c, a @ (b @ c), atol=1e-10)
    np.testing.assert_allclose(a @ identity, a)
    np.testing.assert_allclose(a @ group.inv(a), identity, atol=1e-10)
    np.testing.assert_allclose(group.inv(a @ b), group.inv(b) @ group.inv(a), atol=1e-10)


@groups
@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_elements_stay_in_the_group(group: Group, data: st.DataObject) -> None:
    (a,) = draw_elements(data, group, 1)
    R = a[..., :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(R), np.ones(R.shape[:-2]), atol=1e-12)


@groups
@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_log_inverts_exp_below_pi(group: Group, data: st.DataObject) -> None:
    xi = data.draw(tangents(group.tangent, data.draw(SHAPES), 1.8))
    np.testing.assert_allclose(group.module.log(group.module.exp(xi)), xi, atol=1e-8)


@groups
@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_exp_inverts_log_everywhere(group: Group, data: st.DataObject) -> None:
    (a,) = draw_elements(data, group, 1)
    np.testing.assert_allclose(group.module.exp(group.module.log(a)), a, atol=1e-7)


@groups
@pytest.mark.parametrize("scale", [0.0, 1e-12, 1e-8, 0.99e-4, 1.01e-4, 1e-3])
def test_small_angles_are_exact(group: Group, scale: float) -> None:
    xi = scale * np.linspace(1.0, -0.7, group.tangent)
    np.testing.assert_allclose(group.module.log(group.module.exp(xi)), xi, atol=1e-16, rtol=1e-9)


@pytest.mark.parametrize("short", [0.0, 1e-9, 1e-6, 1e-3])
def test_log_near_pi(short: float) -> None:
    axis = np.array([0.48, -0.6, 0.64])
    w = so3.log(so3.exp((np.pi - short) * axis))
    np.testing.assert_allclose(np.abs(w @ axis), np.pi - short, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(w), np.pi - short, atol=1e-7)


@settings(deadline=None, max_examples=60)
@given(w=tangents(3, (5,), 3.0))
def test_so3_agrees_with_scipy(w: np.ndarray) -> None:
    R = so3.exp(w)
    np.testing.assert_allclose(R, Rotation.from_rotvec(w).as_matrix(), atol=1e-12)
    q = so3.quat_wxyz_from_matrix(R)
    np.testing.assert_allclose(so3.matrix_from_quat_wxyz(q), R, atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(q[:, [1, 2, 3, 0]] * Rotation.from_matrix(R).as_quat(), axis=1)), 1.0)
    np.testing.assert_allclose(so3.vee(so3.hat(w)), w)
    np.testing.assert_allclose((so3.hat(w) @ w[..., None])[..., 0], 0.0, atol=1e-12)


@settings(deadline=None, max_examples=40)
@given(w=tangents(3, (), 2.5))
def test_right_jacobian_is_the_derivative(w: np.ndarray) -> None:
    J = numeric.jacobian(lambda d: so3.log(so3.exp(w).T @ so3.exp(w + d)), 3)
    np.testing.assert_allclose(so3.right_jacobian(w), J, atol=1e-7)
    np.testing.assert_allclose(so3.right_jacobian_inv(w) @ so3.right_jacobian(w), np.eye(3), atol=1e-9)


@settings(deadline=None, max_examples=40)
@given(xi=tangents(6, (), 1.5), d=tangents(6, (), 0.3))
def test_adjoint_moves_a_perturbation_across(xi: np.ndarray, d: np.ndarray) -> None:
    T = se3.exp(xi)
    np.testing.assert_allclose(T @ se3.exp(d) @ se3.inv(T), se3.exp(se3.adjoint(T) @ d), atol=1e-10)


@settings(deadline=None, max_examples=40)
@given(xi=tangents(6, (4,), 2.0), p=tangents(3, (4,), 5.0))
def test_act_agrees_with_homogeneous_points(xi: np.ndarray, p: np.ndarray) -> None:
    T = se3.exp(xi)
    homogeneous = np.concatenate([p, np.ones((4, 1))], axis=1)
    np.testing.assert_allclose(se3.act(T, p), (T @ homogeneous[..., None])[:, :3, 0], atol=1e-12)
    np.testing.assert_allclose(se3.act(se3.inv(T), se3.act(T, p)), p, atol=1e-10)


@settings(deadline=None, max_examples=40)
@given(yaw=st.floats(-3.1, 3.1), tilt=tangents(2, (), 1.0))
def test_yaw_is_that_of_zyx(yaw: float, tilt: np.ndarray) -> None:
    R = Rotation.from_euler("ZYX", [yaw, *tilt]).as_matrix()
    np.testing.assert_allclose(so3.yaw(R), yaw, atol=1e-12)
    np.testing.assert_allclose(so3.from_yaw(yaw), Rotation.from_euler("z", yaw).as_matrix(), atol=1e-12)


def test_cross_is_numpys() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 7, 3))
    np.testing.assert_allclose(so3.cross(a, b), np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose(so3.cross(a, b[0]), np.cross(a, b[0]), atol=1e-15)
