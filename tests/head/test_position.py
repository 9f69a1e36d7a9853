"""Head direction and position control, Eq. (13)-(21): the curve, the drift of the paper's law, and the chain."""

import numpy as np
import pytest
from scipy.integrate import quad

from snakeslam.gaits.catalogue import GaitSettings, resolve
from snakeslam.geometry import se3, so3
from snakeslam.head import position
from snakeslam.head.laws import HeadShape
from snakeslam.head.neck import neck_of
from snakeslam.robot.kinematics import link_poses
from tests.head.plane import FLAT

L0 = FLAT.joint_length_m
B = 2.0 * np.pi / (20.0 * L0)
OMEGA = 2.0 * np.pi / 4.0
V = OMEGA / B
S_N = 36.0 * L0
ALPHAS = [pytest.param(a * np.pi, id=f"{a}pi") for a in (0.1, 0.3, 0.5, 0.7)]
PHASES = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
H = 1e-4


def at(alpha, u, length):
    """phi_M, y_M and the f_M that solves y_N = 0."""
    phi_M, y_M = float(alpha * np.cos(u)), position.lateral_position_m(alpha, B, u)
    return phi_M, y_M, position.difference(y_M, phi_M, length)


def offset_by_quadrature(alpha, u, f_M, length):
    """y_N of Eq. (14), the heading being the integral of the curvature of Eq. (16) and (19), in small steps."""
    s_M = S_N - length
    s = np.linspace(s_M, S_N, 2001)
    middles = (s[1:] + s[:-1]) / 2.0
    ds = np.diff(s)
    k = position.curvature(alpha, B, u - B * s_M, f_M, middles, s_M, S_N)
    phi = alpha * np.cos(u) + np.cumsum(k * ds) - k * ds / 2.0
    return position.lateral_position_m(alpha, B, u) + float(np.sum(np.sin(phi) * ds))


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_necks_start_moves_sideways_with_the_heading_there(alpha):
    """Eq. (13), and the series of y_M: its rate, its quadrature, its mean of 0."""
    start = position.lateral_position_m(alpha, B, 0.0)
    for u in PHASES[::7]:
        integral = quad(lambda x: np.sin(alpha * np.cos(x)), 0.0, u)[0] / B
        assert position.lateral_position_m(alpha, B, u) == pytest.approx(start + integral, abs=1e-9)
        ahead, behind = (position.lateral_position_m(alpha, B, u + OMEGA * h) for h in (H, -H))
        speed = position.lateral_speed(V, float(alpha * np.cos(u)))
        assert (ahead - behind) / (2.0 * H) == pytest.approx(speed, abs=1e-6)
    assert abs(np.mean([position.lateral_position_m(alpha, B, u) for u in PHASES])) < 1e-12


@pytest.mark.parametrize("joints", [4, 5, 6, 8])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_head_stays_on_the_centre_line(alpha, joints):
    """Eq. (14)-(16): y_N by quadrature along the two arcs is 0 at every phase, to a tenth of a millimetre."""
    length = 2.0 * joints * L0
    for u in PHASES:
        phi_M, y_M, f_M = at(alpha, u, length)
        assert abs(position.head_offset_m(y_M, phi_M, f_M, length)) < 1e-4
    for u in PHASES[::6]:
        assert abs(offset_by_quadrature(alpha, u, at(alpha, u, length)[2], length)) < 1e-4


@pytest.mark.parametrize("f_M", [-2.0, 0.0, 0.7])
def test_the_offset_of_any_neck_agrees_with_quadrature(f_M):
    for u in PHASES[::8]:
        expected = offset_by_quadrature(1.2, u, f_M, 0.9)
        phi_M, y_M, _ = at(1.2, u, 0.9)
        assert position.head_offset_m(y_M, phi_M, f_M, 0.9) == pytest.approx(expected, abs=2e-6)


def test_the_condition_of_no_sway():
    """Eq. (15): d/dt int sin(int_s^sN k) ds = -v sin(int k ds), with the closed form's f_M."""
    alpha, length = 0.5 * np.pi, 12.0 * L0
    s_M = S_N - length

    def integral(u):
        phi_M, _, f_M = at(alpha, u, length)
        s = np.linspace(s_M, S_N, 4001)
        return -float(np.trapezoid(np.sin(position.heading(phi_M, f_M, s, s_M, S_N)), s))

    for u in PHASES[::6]:
        change = (integral(u + OMEGA * H) - integral(u - OMEGA * H)) / (2.0 * H)
        assert change == pytest.approx(-V * np.sin(-alpha * np.cos(u)), abs=1e-4)


@pytest.mark.parametrize(("joints", "alpha_pi", "left_mm"), [(6, 0.5, 44.8), (5, 0.7, 89.0), (5, 0.5, 38.7)])
def test_the_linear_difference_alone_leaves_centimetres(joints, alpha_pi, left_mm):
    """It is the start of Newton's method; the figures are those of 360 phases."""
    alpha, length = alpha_pi * np.pi, 2.0 * joints * L0
    worst = 0.0
    for u in np.linspace(0.0, 2.0 * np.pi, 360):
        phi_M, y_M, _ = at(alpha, u, length)
        linear = -2.0 * phi_M / length - 4.0 * y_M / length**2
        worst = max(worst, abs(position.head_offset_m(y_M, phi_M, linear, length)))
    assert worst * 1e3 == pytest.approx(left_mm, abs=0.5)


def test_the_rate_of_the_difference_is_the_linear_laws():
    """Eq. (17) is the derivative of the linear f_M: c_M = -phi_M / l, y_M' = v phi_M to first order."""
    alpha, length = 1e-3, 1.0
    for u in PHASES[::5]:
        k_M = -alpha * B * np.sin(u)
        ahead, behind = (at(alpha, u + OMEGA * h, length)[2] for h in (H, -H))
        rate = position.difference_rate(V, -alpha * np.cos(u) / length, k_M, length)
        assert rate == pytest.approx((ahead - behind) / (2.0 * H), rel=1e-3, abs=1e-6)


def march(alpha_of, f_M, length, seconds=8.0, dt_s=0.01):
    """The head's offsets (m) while the difference is integrated as the paper does, Eq. (17) and (18)."""
    offsets = []
    for t in np.arange(0.0, seconds, dt_s):
        alpha, u = alpha_of(t), OMEGA * t
        phi_M, y_M, _ = at(alpha, u, length)
        offsets.append(position.head_offset_m(y_M, phi_M, f_M, length))
        rate = position.difference_rate(V, -phi_M / length, float(-alpha * B * np.sin(u)), length)
        f_M = position.step_difference(f_M, rate, dt_s)
    return np.array(offsets)


def test_forward_integration_drifts_and_the_closed_form_does_not():
    """Eq. (18) keeps a wrong start for ever, and does not learn of a new amplitude."""
    length, alpha = 12.0 * L0, 0.5 * np.pi
    right = at(alpha, 0.0, length)[2]
    wrong = march(lambda _: alpha, 0.0, length)
    assert np.min(np.abs(wrong)) > 0.3
    assert np.max(np.abs(wrong)) == pytest.approx(0.71, abs=0.02)
    assert np.max(np.abs(march(lambda _: alpha, right, length))) < 0.2
    steps = march(lambda t: 0.3 * np.pi if t < 4.0 else alpha, at(0.3 * np.pi, 0.0, length)[2], length)
    assert abs(np.mean(steps[:400])) < 0.02
    assert abs(np.mean(steps[400:])) > 0.2
    assert np.max(np.abs(steps[400:])) == pytest.approx(0.38, abs=0.02)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_curvature_and_heading_belong_together_and_the_heading_has_no_step(alpha):
    """Eq. (19) is the slope of Eq. (20), which is continuous at s_M, in the middle and at s_N, where it is 0."""
    s_M = S_N - 10.0 * L0
    middle = (s_M + S_N) / 2.0
    for u in PHASES[::8]:
        phi_M, _, f_M = at(alpha, u, S_N - s_M)

        def phi(s, phi_M=phi_M, f_M=f_M):
            return float(position.heading(phi_M, f_M, s, s_M, S_N))

        assert phi(s_M) == pytest.approx(alpha * np.cos(u))
        assert phi(middle - 1e-9) == pytest.approx(phi(middle + 1e-9), abs=1e-7)
        assert abs(phi(S_N - 1e-9)) < 1e-7
        assert phi(S_N) == pytest.approx(0.0, abs=1e-12)
        for s in (s_M + 0.01, middle - 0.01, middle + 0.01, S_N - 0.01, S_N + 0.01):
            slope = (phi(s + H) - phi(s - H)) / (2.0 * H)
            k = float(position.curvature(alpha, B, u - B * s_M, f_M, s, s_M, S_N))
            assert slope == pytest.approx(k, abs=1e-8)


def head_of_the_chain(controller, alpha_pi, sigma, joints=6):
    """(y, yaw) of s_N on the chain of straight sections whose tail lies on the serpenoid, from Eq. (21)."""
    gait = resolve(GaitSettings(alpha_pi=alpha_pi), FLAT)
    q_rad, _ = HeadShape(controller, FLAT, neck_of(FLAT, joints))(gait, sigma)
    alpha = -alpha_pi * np.pi
    tail = se3.from_rt(so3.from_yaw(alpha * np.cos(sigma)), np.zeros(3))
    tail[1, 3] = position.lateral_position_m(alpha, B, sigma)
    T_WH = link_poses(FLAT, q_rad, tail)[-1]
    return T_WH[1, 3] + L0 * T_WH[1, 0], float(so3.yaw(T_WH[:3, :3]))


@pytest.mark.parametrize(("alpha_pi", "most_m"), [(0.1, 0.01), (0.3, 0.03), (0.5, 0.06), (0.7, 0.1)])
def test_the_chain_itself_holds_its_head_nearly_on_the_line(alpha_pi, most_m):
    """Eq. (21): straight sections cut the corners of the curve; the heading is exact, the place to centimetres."""
    offsets = {}
    for controller in ("none", "direction", "position"):
        heads = np.array([head_of_the_chain(controller, alpha_pi, sigma) for sigma in PHASES])
        offsets[controller] = np.ptp(heads[:, 0])
        if controller != "none":
            assert np.max(np.abs(heads[:, 1])) < 1e-7
    assert offsets["position"] < most_m < offsets["direction"]
    assert offsets["position"] < 0.25 * offsets["none"]
