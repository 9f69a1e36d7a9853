"""Eq. (1)-(2) and its slopes."""

import numpy as np

from snakeslam.gaits.parametric import ParametricGait, joint_angles, joint_slopes

GAIT = ParametricGait(0.5, 0.2, 0.4, 0.7, harmonic_e=2.0, delta=0.3, beta_o=0.1, beta_e=-0.05)


def test_eq_1_and_2_joint_by_joint():
    """Eq. (1): each family has its own offset, amplitude and phase; Eq. (2): theta = k n + omega t."""
    sigma = 0.9
    q_rad = joint_angles(GAIT, 7, sigma)
    for n in range(1, 8, 2):
        assert q_rad[n - 1] == 0.1 + 0.5 * np.sin(0.4 * n + sigma)
    for n in range(2, 8, 2):
        assert q_rad[n - 1] == -0.05 + 0.2 * np.sin(0.7 * n + 2.0 * sigma + 0.3)


def test_slopes_of_eq_1_are_its_derivative():
    h = 1e-6
    numeric = (joint_angles(GAIT, 24, 0.4 + h) - joint_angles(GAIT, 24, 0.4 - h)) / (2 * h)
    np.testing.assert_allclose(joint_slopes(GAIT, 24, 0.4), numeric, atol=1e-9)


def test_growing_phase_sends_the_wave_from_head_to_tail():
    """Eq. (2): what joint n does now, the joint two nearer the tail does 2 k later in phase."""
    now, later = joint_angles(GAIT, 24, 0.2), joint_angles(GAIT, 24, 0.2 + 2 * GAIT.k_o)
    np.testing.assert_allclose(later[0:-2:2], now[2::2], atol=1e-12)


def test_taper_falls_towards_the_head_about_the_middle():
    plain = joint_angles(ParametricGait(1.0, k_o=0.4), 35, 0.3)[::2]
    tapered = joint_angles(ParametricGait(1.0, k_o=0.4, taper=0.5), 35, 0.3)[::2]
    np.testing.assert_allclose((tapered / plain)[[0, -1]], [1.5, 0.5])
    np.testing.assert_allclose(np.mean(tapered / plain), 1.0)
