"""Head direction control, Eq. (3)-(12): the identities of the curve, and the joints that wind so."""

import numpy as np
import pytest
from scipy.integrate import quad

from snakeslam.gaits.catalogue import GaitSettings, resolve
from snakeslam.head import direction
from snakeslam.head.laws import HeadShape
from snakeslam.head.neck import neck_of
from snakeslam.robot.model import PRESETS
from tests.head.plane import FLAT

L0 = FLAT.joint_length_m
B = 2.0 * np.pi / (20.0 * L0)
OMEGA = 2.0 * np.pi / 4.0
V = OMEGA / B
S_M, S_N = 26.0 * L0, 36.0 * L0
L_N = S_N - S_M
ALPHAS = [pytest.param(a * np.pi, id=f"{a}pi") for a in (0.1, 0.3, 0.5, 0.7)]
TIMES = np.linspace(0.0, 4.0, 9)
H = 1e-4


def phi(alpha, t, s):
    return float(direction.heading(alpha, B, OMEGA * t, s, S_M, S_N))


def k(alpha, t, s):
    return float(direction.curvature(alpha, B, OMEGA * t, s, S_M, S_N))


def bend(alpha, t):
    """The integral of the neck's curvature."""
    return quad(lambda s: k(alpha, t, s), S_M, S_N)[0]


def rate(function, t):
    return (function(t + H) - function(t - H)) / (2.0 * H)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_curve_obeys_the_laws(alpha):
    """Eq. (3)-(8), each from quadrature along the curve and differences in time."""
    for t in TIMES:
        k_M = k(alpha, t, S_M - 1e-12)
        turning = rate(lambda t: phi(alpha, t, S_M), t)
        bending = rate(lambda t: bend(alpha, t), t)
        assert turning == pytest.approx(k_M * V, abs=1e-5)
        assert phi(alpha, t, S_N) - phi(alpha, t, S_M) == pytest.approx(bend(alpha, t), abs=1e-9)
        assert rate(lambda t: phi(alpha, t, S_N), t) == pytest.approx(turning + bending, abs=1e-5)
        assert turning == pytest.approx(-bending, abs=1e-5)
        assert bending == pytest.approx(-k_M * V, abs=1e-5)
        assert bend(alpha, t) == pytest.approx(-phi(alpha, t, S_M), abs=1e-9)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_arc_bends_at_the_rate_that_the_neck_is_turned(alpha):
    """Eq. (9)."""
    for t in TIMES:
        bending = rate(lambda t: direction.arc_curvature(phi(alpha, t, S_M), L_N), t)
        assert bending == pytest.approx(-k(alpha, t, S_M - 1e-12) * V / L_N, abs=1e-5)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_curvature_is_the_slope_of_a_heading_without_a_step(alpha):
    """Eq. (10) and Eq. (11): the heading is continuous at s_M and s_N, and the head keeps 0."""
    for t in TIMES:
        for s in (0.0, 0.7, S_M - 0.01, S_M + 0.01, S_N - 0.01, S_N + 0.01):
            slope = rate(lambda s, t=t: phi(alpha, t, s), s)
            assert slope == pytest.approx(k(alpha, t, s), abs=1e-5)
        for s in (S_M, S_N):
            assert phi(alpha, t, s - 1e-9) == pytest.approx(phi(alpha, t, s + 1e-9), abs=1e-7)
        assert phi(alpha, t, S_M - 1e-12) == pytest.approx(alpha * np.cos(B * S_M + OMEGA * t))
        assert phi(alpha, t, S_N) == phi(alpha, t, S_N + 0.1) == 0.0


def test_joint_angles_are_what_the_heading_turns_between_sections():
    """Eq. (12) of the whole serpenoid is the gait of Eq. (1), mirrored."""
    i = np.arange(19)
    headings = 1.1 * np.cos(B * 2.0 * i * L0 + 0.4)
    expected = -2.0 * 1.1 * np.sin(B * L0) * np.sin(B * (2.0 * i[1:] - 1.0) * L0 + 0.4)
    np.testing.assert_allclose(direction.joint_angles(headings), expected, atol=1e-12)


@pytest.mark.parametrize("model", [FLAT, PRESETS["sim35"], PRESETS["orthogonal24"]], ids=["flat", "raised", "24"])
@pytest.mark.parametrize("controller", ["direction", "position"])
@pytest.mark.parametrize("alpha_pi", [0.1, 0.3, 0.5, 0.7])
def test_the_head_faces_the_direction_of_motion_at_every_phase(model, controller, alpha_pi):
    """The body's angles up to the neck and the neck's own add up to -phi of the tail; all within the limits."""
    gait = resolve(GaitSettings(alpha_pi=alpha_pi, wavelength_joints=20), model)
    shape = HeadShape(controller, model, neck_of(model, 6))
    for sigma in np.linspace(0.0, 2.0 * np.pi, 37):
        q_rad, slope = shape(gait, float(sigma))
        tail = -alpha_pi * np.pi * np.cos(sigma)
        assert tail + np.sum(q_rad[model.is_yaw]) == pytest.approx(0.0, abs=1e-7)
        assert np.max(np.abs(q_rad)) <= model.limits.position_rad
        ahead, behind = shape(gait, float(sigma) + 1e-3)[0], shape(gait, float(sigma) - 1e-3)[0]
        np.testing.assert_allclose((ahead - behind) / 2e-3, slope, atol=1e-4)


def test_direction_control_bends_every_joint_of_the_neck_by_a_share():
    """An arc: all angles are alike, but for the neck's ends, which lie half outside."""
    gait = resolve(GaitSettings(alpha_pi=0.5), FLAT)
    neck = neck_of(FLAT, 5)
    for sigma in (0.3, 2.0):
        angles = HeadShape("direction", FLAT, neck)(gait, sigma)[0][neck.joints]
        np.testing.assert_allclose(angles, angles[0], atol=1e-9)
