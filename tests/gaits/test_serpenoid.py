"""The curve's exact map to the gait, and its closed forms."""

import numpy as np
import pytest
from scipy import integrate

from snakeslam.gaits import serpenoid
from snakeslam.gaits.parametric import ParametricGait, joint_angles


@pytest.mark.parametrize(("alpha_pi", "degrees"), [(0.1, 11.1), (0.3, 33.4), (0.5, 55.6), (0.7, 77.9)])
def test_amplitudes_at_twenty_joint_lengths(alpha_pi, degrees):
    amplitude = serpenoid.amplitude_from_alpha(alpha_pi * np.pi, 20)
    assert np.rad2deg(amplitude) == pytest.approx(degrees, abs=0.06)
    assert serpenoid.alpha_from_amplitude(amplitude, 20) == pytest.approx(alpha_pi * np.pi)


def test_the_gait_of_eq_1_is_the_curves_change_of_heading():
    """Joint n of Eq. (1) bends by phi(s + l0) - phi(s - l0) at s = n l0, but for the sign of the phase's origin."""
    l0, alpha, joints = 0.08995, 0.8, 20.0
    k = serpenoid.wave_number(joints)
    gait = ParametricGait(-serpenoid.amplitude_from_alpha(alpha, joints), k_o=k)
    s_m = np.arange(1, 36, 2) * l0
    bends = serpenoid.heading(alpha, joints * l0, s_m + l0, 0.7) - serpenoid.heading(alpha, joints * l0, s_m - l0, 0.7)
    np.testing.assert_allclose(joint_angles(gait, 35, 0.7)[::2], bends, atol=1e-12)


@pytest.mark.parametrize(("alpha_pi", "swing"), [(0.1, 0.178), (0.3, 0.488), (0.4, 0.601), (0.5, 0.676)])
def test_swing_and_advance_of_the_curve(alpha_pi, swing):
    length, alpha = 20 * 0.08995, alpha_pi * np.pi
    assert serpenoid.swing_m(alpha, length) == pytest.approx(swing, abs=6e-4)
    s_m = np.linspace(0.0, length, 4001)
    phi = serpenoid.heading(alpha, length, s_m, 0.2)
    assert serpenoid.swing_m(alpha, length) == pytest.approx(
        np.ptp(integrate.cumulative_simpson(np.sin(phi), x=s_m, initial=0)), rel=1e-4
    )
    assert serpenoid.advance_ratio(alpha) == pytest.approx(integrate.simpson(np.cos(phi), x=s_m) / length, rel=1e-6)


def test_at_seven_tenths_pi_the_snake_hardly_advances():
    assert serpenoid.advance_ratio(0.7 * np.pi) == pytest.approx(0.11, abs=0.005)
