"""Head direction control, Eq. (3)-(12): the neck is an arc that turns the head into the direction of motion.

The body is a serpenoid curve that moves along itself at v = omega / b, so the heading at the neck's start changes at
k v, Eq. (3). The head has the heading phi_N = phi_M + int k ds, Eq. (4), and turns at phi_M' + int k' ds, Eq. (5). It
does not turn when int k' ds = -phi_M', Eq. (6), which with Eq. (3) is the law int k' ds = -k(s_M) v, Eq. (7); it faces
the direction of motion when it begins so, int k ds = -phi_M, Eq. (8). A neck of one curvature c_M that obeys this is
Eq. (9); the curvature and the heading of the whole body are then Eq. (10) and Eq. (11).
"""

import numpy as np

from snakeslam.messages import Float


def arc_curvature(phi_M_rad: float, length_m: float) -> float:
    """Return the neck's curvature, Eq. (9) integrated from Eq. (8): c_M = -phi_M / l_N, in 1/m."""
    return -phi_M_rad / length_m


def curvature(alpha_rad: float, b: float, sigma: float, s_m: Float, s_M_m: float, s_N_m: float) -> Float:
    """Return k(s, t) in 1/m, Eq. (10): -alpha b sin(b s + sigma) of the body, c_M of the neck, 0 of the head.

    ``b`` is the wave number in rad/m, ``sigma`` the phase in rad, ``s_m`` arc lengths from the tail.
    """
    s_m = np.asarray(s_m, dtype=np.float64)
    neck = arc_curvature(alpha_rad * np.cos(b * s_M_m + sigma), s_N_m - s_M_m)
    return np.where(s_m < s_M_m, -alpha_rad * b * np.sin(b * s_m + sigma), np.where(s_m < s_N_m, neck, 0.0))


def heading(alpha_rad: float, b: float, sigma: float, s_m: Float, s_M_m: float, s_N_m: float) -> Float:
    """Return phi(s, t) in rad, Eq. (11): the serpenoid's up to s_M, from there falling linearly to 0 at s_N."""
    s_m = np.asarray(s_m, dtype=np.float64)
    phi_M = alpha_rad * np.cos(b * s_M_m + sigma)
    return np.where(s_m < s_M_m, alpha_rad * np.cos(b * s_m + sigma), arc_heading(phi_M, s_m, s_M_m, s_N_m))


def arc_heading(phi_M_rad: float, s_m: Float, s_M_m: float, s_N_m: float) -> Float:
    """Return the heading along neck and head, (1 - xi) phi_M with xi = (s - s_M) / l_N, in rad."""
    xi = np.clip((s_m - s_M_m) / (s_N_m - s_M_m), 0.0, 1.0)
    return (1.0 - xi) * phi_M_rad


def joint_angles(headings_rad: Float) -> Float:
    """Return the yaw angles between straight sections of these headings, Eq. (12) and Eq. (21).

    angle_i = phi(2 i l0) - phi((2 i - 2) l0), for headings (n + 1,) at the middles of the sections, tail to head.
    """
    return np.diff(headings_rad)
