"""Head direction and position control, Eq. (13)-(21): a neck of two arcs that also keeps the head on the centre line.

The neck's start moves sideways at Eq. (13), the head is off the centre line by Eq. (14), and does not sway where the
neck's curvature obeys Eq. (15). A neck of the curvature c_M + f_M in its first half and c_M - f_M in its second,
Eq. (16), keeps phi_N = 0 for every f_M, which is free to do that.

The paper integrates f_M forward, which drifts: ``difference_rate`` and ``step_difference`` keep that law. The default
is ``difference``, which solves y_N = 0 at every moment.
"""

import math
from functools import lru_cache

import numpy as np
from scipy import special

from snakeslam.head.direction import arc_curvature
from snakeslam.messages import Float

SERIES = 8
"""Terms of the series of y_M; the ninth is below 1e-12 for alpha < .75 pi."""
NEWTON_STEPS = 3


def lateral_speed(v_m_s: float, phi_M_rad: float) -> float:
    """Return y_M' = + v sin(phi_M), Eq. (13), in m/s."""
    return v_m_s * float(np.sin(phi_M_rad))


def lateral_position_m(alpha_rad: float, b: float, u_rad: float) -> float:
    """Return y_M of a serpenoid with the heading alpha cos(u) at u = b s_M + sigma, in m.

    y_M = (2 / b) sum_m (-1)^m J_{2m+1}(alpha) sin((2m + 1) u) / (2m + 1), the integral of Eq. (13) about the centre
    line. Source: Jacobi-Anger expansion of sin(alpha cos u).
    """
    return 2.0 / b * sum(weight * math.sin((2 * m + 1) * u_rad) for m, weight in enumerate(_series(alpha_rad)))


@lru_cache(maxsize=64)
def _series(alpha_rad: float) -> tuple[float, ...]:
    """Return (-1)^m J_{2m+1}(alpha) / (2m + 1)."""
    m = np.arange(SERIES)
    return tuple(((-1.0) ** m * special.jv(2 * m + 1, alpha_rad) / (2 * m + 1)).tolist())


def head_offset_m(y_M_m: float, phi_M_rad: float, f_M: float, length_m: float) -> float:
    """Return y_N, Eq. (14), of a neck with the curvatures of Eq. (16), in m: the condition Eq. (15) keeps it constant.

    Each half is an arc from one heading to the next, whose chord is along their mean and shortened by sinc.
    """
    middle = phi_M_rad / 2.0 + f_M * length_m / 2.0
    return y_M_m + length_m / 2.0 * (_arc_offset(phi_M_rad, middle) + _arc_offset(middle, 0.0))


def _arc_offset(phi_from: float, phi_to: float) -> float:
    """Return how far sideways an arc of length 1 ends."""
    return math.sin((phi_from + phi_to) / 2.0) * _sinc((phi_to - phi_from) / 2.0)


def _sinc(x: float) -> float:
    """Return sin(x) / x."""
    return math.sin(x) / x if abs(x) > 1e-8 else 1.0


def _arc_offset_slope(phi_from: float, phi_to: float) -> float:
    """Return d(_arc_offset) / d(phi_to)."""
    mean, half = (phi_from + phi_to) / 2.0, (phi_to - phi_from) / 2.0
    sinc = _sinc(half)
    slope = (math.cos(half) - sinc) / half if abs(half) > 1e-4 else -half / 3.0
    return 0.5 * (math.cos(mean) * sinc + math.sin(mean) * slope)


def difference(y_M_m: float, phi_M_rad: float, length_m: float) -> float:
    """Return f_M that puts the head on the centre line, y_N = 0 in Eq. (14), in 1/m; drift-free.

    Newton from the linear f = -2 phi_M / l - 4 y_M / l^2 on the heading at the middle, phi_M / 2 + f l / 2.
    """
    middle = -phi_M_rad / 2.0 - 2.0 * y_M_m / length_m
    for _ in range(NEWTON_STEPS):
        middle = min(max(middle, -math.pi / 2.0), math.pi / 2.0)
        offset = 2.0 * y_M_m / length_m + _arc_offset(phi_M_rad, middle) + _arc_offset(middle, 0.0)
        slope = _arc_offset_slope(phi_M_rad, middle) + _arc_offset_slope(0.0, middle)
        middle -= offset / slope if abs(slope) > 1e-3 else 0.0
    return (2.0 * middle - phi_M_rad) / length_m


def difference_rate(v_m_s: float, c_M: float, k_M: float, length_m: float) -> float:
    """Return f_M' = v (4 c_M - 2 k_M) / l_N, Eq. (17), in 1/(m s)."""
    return v_m_s * (4.0 * c_M - 2.0 * k_M) / length_m


def step_difference(f_M: float, rate: float, dt_s: float) -> float:
    """Return f_M one step on, Eq. (18): f_M(t_{k+1}) = f_M(t_k) + f_M' dt."""
    return f_M + rate * dt_s


def curvature(alpha_rad: float, b: float, sigma: float, f_M: float, s_m: Float, s_M_m: float, s_N_m: float) -> Float:
    """Return k(s, t) in 1/m, Eq. (19): the serpenoid's, c_M + f_M in the neck's first half, c_M - f_M in its second."""
    s_m = np.asarray(s_m, dtype=np.float64)
    c_M = arc_curvature(alpha_rad * np.cos(b * s_M_m + sigma), s_N_m - s_M_m)
    neck = np.where(s_m < (s_M_m + s_N_m) / 2.0, c_M + f_M, np.where(s_m < s_N_m, c_M - f_M, 0.0))
    return np.where(s_m < s_M_m, -alpha_rad * b * np.sin(b * s_m + sigma), neck)


def heading(phi_M_rad: float, f_M: float, s_m: Float, s_M_m: float, s_N_m: float) -> Float:
    """Return phi(s, t) of neck and head in rad, Eq. (20).

    (1 - xi) phi_M + f_M (s - s_M) in the first half, (1 - xi) phi_M + f_M (s_N - s) in the second, 0 beyond.
    """
    s_m = np.clip(np.asarray(s_m, dtype=np.float64), s_M_m, s_N_m)
    xi = (s_m - s_M_m) / (s_N_m - s_M_m)
    return (1.0 - xi) * phi_M_rad + f_M * np.minimum(s_m - s_M_m, s_N_m - s_m)
