"""The parameterised gait of an orthogonal snake, Eq. (1)-(2)."""

from dataclasses import dataclass

import numpy as np

from snakeslam.messages import Float


@dataclass(frozen=True, slots=True)
class ParametricGait:
    """The constants of Eq. (1)-(2); amplitudes and offsets in rad, wave numbers k in rad per joint.

    The temporal phases are multiples of one phase ``sigma`` (rad), which grows by 2 pi a period:
    omega_o t = harmonic_o sigma, omega_e t = harmonic_e sigma. Growing phase sends the wave from head to tail and moves
    the robot forward. Odd joints yaw, even joints pitch.
    """

    amplitude_o: float
    amplitude_e: float = 0.0
    k_o: float = 0.0
    k_e: float = 0.0
    harmonic_o: float = 1.0
    harmonic_e: float = 1.0
    delta: float = 0.0
    beta_o: float = 0.0
    beta_e: float = 0.0
    taper: float = 0.0
    """Share by which the amplitudes fall towards the head and rise towards the tail; not in the paper (0 there)."""


def joint_angles(gait: ParametricGait, joint_count: int, sigma: float) -> Float:
    """Return the angles at phase ``sigma``, (N,) rad, tail to head.

    Eq. (1): alpha(n) = beta_o + A_o sin(theta_o) for odd n, beta_e + A_e sin(theta_e + delta) for even n.
    Eq. (2): theta_o = k_o n + omega_o t, theta_e = k_e n + omega_e t, for each family separately.
    """
    n, taper = _joints_and_taper(gait, joint_count)
    yaw = gait.beta_o + taper * gait.amplitude_o * np.sin(gait.k_o * n + gait.harmonic_o * sigma)
    pitch = gait.beta_e + taper * gait.amplitude_e * np.sin(gait.k_e * n + gait.harmonic_e * sigma + gait.delta)
    return np.where(n % 2 == 1, yaw, pitch)


def joint_slopes(gait: ParametricGait, joint_count: int, sigma: float) -> Float:
    """Return d(angles)/d(sigma) of Eq. (1)-(2), (N,)."""
    n, taper = _joints_and_taper(gait, joint_count)
    yaw = taper * gait.amplitude_o * gait.harmonic_o * np.cos(gait.k_o * n + gait.harmonic_o * sigma)
    pitch = taper * gait.amplitude_e * gait.harmonic_e * np.cos(gait.k_e * n + gait.harmonic_e * sigma + gait.delta)
    return np.where(n % 2 == 1, yaw, pitch)


def _joints_and_taper(gait: ParametricGait, joint_count: int) -> tuple[Float, Float]:
    n = np.arange(1.0, joint_count + 1)
    return n, 1.0 - gait.taper * (2.0 * n - joint_count - 1) / (joint_count - 1)
