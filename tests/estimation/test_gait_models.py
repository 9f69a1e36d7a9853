"""The paper's motion models, Eq. (28)-(36), against derivatives, balances and the figures of the derivation."""

import numpy as np
import pytest
from scipy.special import j0

from snakeslam.estimation.planar.models import (
    SLIP_M_S,
    Rods,
    centre_of_mass,
    fan_rolling_speed,
    lifting_speed,
    paper_rolling_speed,
    swing_radius,
    swing_velocity,
    wheel_speed,
)
from snakeslam.gaits import serpenoid
from snakeslam.geometry.numeric import jacobian

L0, N = 0.08995, 36
RODS = Rods(N, L0 / 2.0)
OMEGA = 2.0 * np.pi / 4.0


def bent(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Headings, their rates, a centre of mass."""
    return np.cumsum(rng.normal(0, 0.3, N)), rng.normal(0, 1.0, N), rng.normal(0, 1.0, 2)


def test_rods_are_joined_and_centred(rng: np.random.Generator) -> None:
    """Eq. (28), Eq. (29), Eq. (30): the rods from the centre of mass and the headings."""
    theta, _, p = bent(rng)
    X, Y = RODS.positions(theta, p)
    np.testing.assert_allclose(centre_of_mass(X, Y), p, atol=1e-12)
    np.testing.assert_allclose(RODS.gaps(X, Y, theta), np.zeros((2, N - 1)), atol=1e-12)
    ends = X[:-1] + L0 / 2 * np.cos(theta[:-1]), Y[:-1] + L0 / 2 * np.sin(theta[:-1])
    np.testing.assert_allclose(ends[0], X[1:] - L0 / 2 * np.cos(theta[1:]), atol=1e-12)
    np.testing.assert_allclose(ends[1], Y[1:] - L0 / 2 * np.sin(theta[1:]), atol=1e-12)
    T = np.vstack([RODS.D, np.full(N, 1.0 / N)])
    np.testing.assert_allclose(T @ X, [*(-L0 / 2 * RODS.A @ np.cos(theta)), p[0]], atol=1e-12)


def test_velocities_are_the_positions_derivatives(rng: np.random.Generator) -> None:
    """Eq. (31)."""
    theta, dtheta, p = bent(rng)
    dp = rng.normal(size=2)

    def at(t: np.ndarray) -> np.ndarray:
        return np.concatenate(RODS.positions(theta + dtheta * t[0], p + dp * t[0]))

    np.testing.assert_allclose(np.concatenate(RODS.velocities(theta, dtheta, dp)), jacobian(at, 1)[:, 0], atol=1e-7)


def wave(alpha_pi: float, sigma: float, wavelength: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    """Headings about their mean and their rates, of a serpenoid of period 4 s."""
    s = (np.arange(N) + 0.5) * L0

    def heading(t: float) -> np.ndarray:
        phi = serpenoid.heading(np.pi * alpha_pi, wavelength * L0, s, sigma + OMEGA * t)
        return phi - phi.mean()

    return heading(0.0), (heading(1e-5) - heading(-1e-5)) / 2e-5


def test_friction_is_in_balance_in_the_motion_found() -> None:
    """No net force and no net moment, by the law written out rod by rod."""
    load = np.linspace(0.5, 1.5, N)
    for sigma in (0.0, 1.0, 2.5):
        theta, dtheta = wave(0.3, sigma)
        twist = RODS.twist(theta, dtheta, load, 3.0)
        X, Y = RODS.positions(theta, np.zeros(2))
        vx, vy = RODS.velocities(theta, dtheta + twist.omega, twist.v)
        t, n = np.array([np.cos(theta), np.sin(theta)]), np.array([-np.sin(theta), np.cos(theta)])
        v = np.array([vx, vy])
        vt, vn = np.sum(v * t, axis=0), np.sum(v * n, axis=0)
        scale = load / np.sqrt(vt**2 + vn**2 + SLIP_M_S**2)
        force = -scale * (vt * t + 3.0 * vn * n)
        spin = -scale * 3.0 * (L0 / 2) ** 2 / 3.0 * (dtheta + twist.omega)
        size = np.abs(force).sum()
        assert np.linalg.norm(force.sum(axis=1)) < 0.01 * size
        assert abs(np.sum(X * force[1] - Y * force[0] + spin)) < 0.01 * size


def test_the_motion_rotates_with_the_body_and_is_zero_for_a_stationary_one(rng: np.random.Generator) -> None:
    theta, dtheta, _ = bent(rng)
    one = RODS.twist(theta, dtheta, np.ones(N), 3.0)
    rotated = RODS.twist(theta + 1.1, dtheta, np.ones(N), 3.0)
    c, s = np.cos(1.1), np.sin(1.1)
    np.testing.assert_allclose(rotated.v, [c * one.v[0] - s * one.v[1], s * one.v[0] + c * one.v[1]], atol=1e-9)
    assert rotated.omega == pytest.approx(one.omega, abs=1e-9)
    stationary = RODS.twist(theta, np.zeros(N), np.ones(N), 3.0)
    assert np.linalg.norm(stationary.v) + abs(stationary.omega) < 1e-12


def mean_speed(alpha_pi: float, ratio: float) -> float:
    sigmas = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    return float(np.mean([RODS.twist(*wave(alpha_pi, sigma), np.ones(N), ratio).v[0] for sigma in sigmas]))


def test_serpentine_goes_as_fast_as_friction_lets_it() -> None:
    """Without sideways slip J0(alpha) of a wavelength a period; none with isotropic friction but backwards."""
    ideal = 20 * L0 / 4.0 * j0(0.3 * np.pi)
    assert mean_speed(0.3, 1e4) == pytest.approx(ideal, rel=0.1)
    assert 0.05 < mean_speed(0.3, 3.0) < 0.5 * ideal
    assert mean_speed(0.3, 1.0) < 0.0


def test_a_wheel_rolls() -> None:
    """Eq. (32)."""
    assert wheel_speed(OMEGA, 0.032) == pytest.approx(0.0502655, abs=1e-7)


@pytest.mark.parametrize("phase", [0.0, 0.4, 1.9, 4.0])
def test_the_lifted_link_swings(phase: float) -> None:
    """Eq. (33), Eq. (34): the velocity is the derivative of the polar position."""
    amplitude = 0.5
    assert swing_radius(0.1, amplitude, 0.0) == pytest.approx(0.1 * np.sin(0.25))

    def at(t: np.ndarray) -> np.ndarray:
        r = swing_radius(0.1, amplitude, phase + OMEGA * t[0])
        return r * np.array([np.cos(phase + OMEGA * t[0]), np.sin(phase + OMEGA * t[0])])

    np.testing.assert_allclose(swing_velocity(OMEGA, 0.1, amplitude, phase), jacobian(at, 1)[:, 0], atol=1e-8)


@pytest.mark.parametrize("amplitude", [0.1, 0.2])
def test_the_papers_rolling_speed(amplitude: float) -> None:
    """Eq. (35) in its two parts, Eq. (36) as the sum of Eq. (32) and Eq. (34); the mean is that of the derivation."""
    r, length = 0.032, 0.096
    for phase in (0.2, 1.0, 0.2 + np.pi):
        swing = swing_velocity(OMEGA, length, amplitude, phase % np.pi)[0]
        expected = wheel_speed(OMEGA, r) + swing
        assert lifting_speed(OMEGA, r, length, amplitude, phase % np.pi) == pytest.approx(expected)
        assert paper_rolling_speed(OMEGA, r, length, amplitude, phase) == pytest.approx(expected)
    assert paper_rolling_speed(OMEGA, r, length, amplitude, 2.0) == wheel_speed(OMEGA, r)
    phases = np.linspace(0, np.pi, 4001)
    mean = np.mean([paper_rolling_speed(OMEGA, r, length, amplitude, phase) for phase in phases])
    assert 100 * mean == pytest.approx({0.1: 4.79, 0.2: 4.55}[amplitude], abs=0.01)


def test_the_corrected_rolling_speed() -> None:
    """The corrected form of Eq. (36), 24 joints: 4.91 and 4.46 cm/s, the least of the integral; backwards alike."""
    for amplitude, expected in ((0.1, 4.91), (0.2, 4.46)):
        V = fan_rolling_speed(OMEGA, 0.032, 24, amplitude)
        assert 100 * V == pytest.approx(expected, abs=0.01)
        angle = np.linspace(-6 * amplitude, 6 * amplitude, 2001)

        def slip(speed: float, angle: np.ndarray = angle) -> float:
            return float(np.sum(np.hypot(speed - OMEGA * 0.032 * np.cos(angle), OMEGA * 0.032 * np.sin(angle))))

        assert slip(V) < min(slip(0.99 * V), slip(1.01 * V))
        assert fan_rolling_speed(-OMEGA, 0.032, 24, amplitude) == -V
