"""The external Coulomb law: F = -N (mu_t v_t, mu_n v_n) / sqrt(|v|^2 + eps^2)."""

import numpy as np
import pytest

from snakeslam.backends.sim.friction import CoulombFriction
from snakeslam.geometry import so3

LAW = CoulombFriction(mu_tangential=0.2, mu_normal=0.6, slip_m_s=0.02)
UP, AHEAD = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])


def _force(velocity, normal=UP, along=AHEAD, load=2.0):
    return LAW.forces(np.array([load]), np.atleast_2d(velocity), normal, along)[0]


@pytest.mark.parametrize(("axis", "mu"), [(0, 0.2), (1, 0.6)])
def test_fast_sliding_is_opposed_by_mu_times_the_load(axis, mu):
    for sign in (1.0, -1.0):
        expected = np.zeros(3)
        expected[axis] = -sign * mu * 2.0
        np.testing.assert_allclose(_force(sign * np.eye(3)[axis]), expected, atol=1e-3)


def test_slow_sliding_is_viscous_and_motion_off_the_ground_is_free():
    np.testing.assert_allclose(_force([0.0, 1e-5, 0.0]), [0, -0.6 * 2.0 * 1e-5 / 0.02, 0], rtol=1e-3)
    np.testing.assert_allclose(_force([0.0, 0.0, 0.5]), 0.0, atol=1e-15)


def test_it_does_not_depend_on_the_worlds_axes():
    velocity = np.array([[0.03, -0.02, 0.01]])
    R = so3.exp(np.array([0.4, -1.2, 2.0]))
    turned = _force(velocity @ R.T, UP @ R.T, AHEAD @ R.T)
    np.testing.assert_allclose(turned, R @ _force(velocity), atol=1e-12)


def test_it_always_takes_energy_and_stays_in_the_plane():
    rng = np.random.default_rng(1)
    normal, along = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in rng.normal(size=(2, 200, 3)))
    velocity, load = rng.normal(scale=0.1, size=(200, 3)), rng.uniform(0, 5, 200)
    forces = LAW.forces(load, velocity, normal, along)
    assert np.all(np.sum(forces * velocity, axis=1) <= 1e-12)
    np.testing.assert_allclose(np.sum(forces * normal, axis=1), 0.0, atol=1e-9)
    assert np.all(np.linalg.norm(forces, axis=1) <= 0.6 * load + 1e-12)


def test_a_link_that_stands_on_end_gives_finite_forces():
    assert np.all(np.isfinite(_force([0.1, 0.2, 0.0], along=UP)))
