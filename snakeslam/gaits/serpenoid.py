"""The serpenoid curve and its exact map to and from the gait of the yaw joints.

Arc length s runs from tail to head; the heading is phi(s) = alpha cos(b s + sigma) with b = 2 pi / L. Yaw joints are
2 l0 apart, so phi(s + l0) - phi(s - l0) = -2 alpha sin(b l0) sin(b s + sigma).
"""

import numpy as np
from scipy import special

from snakeslam.messages import Float


def heading(alpha_rad: float, wavelength_m: float, s_m: Float, sigma: float) -> Float:
    """Return phi(s) = alpha cos(b s + sigma) in rad."""
    return alpha_rad * np.cos(2.0 * np.pi / wavelength_m * np.asarray(s_m) + sigma)


def wave_number(wavelength_joints: float) -> float:
    """Return k_o = b l0 in rad per joint."""
    return 2.0 * np.pi / wavelength_joints


def amplitude_from_alpha(alpha_rad: float, wavelength_joints: float) -> float:
    """Return A_o = 2 alpha sin(b l0) in rad; L = 20 l0 gives .618 alpha."""
    return float(2.0 * alpha_rad * np.sin(wave_number(wavelength_joints)))


def alpha_from_amplitude(amplitude_rad: float, wavelength_joints: float) -> float:
    """Return alpha = A_o / (2 sin(b l0)) in rad."""
    return float(amplitude_rad / (2.0 * np.sin(wave_number(wavelength_joints))))


def swing_m(alpha_rad: float, wavelength_m: float) -> float:
    """Return the continuous curve's swing from peak to peak, (L / 2) H0(alpha), H0 the Struve function."""
    return float(wavelength_m / 2.0 * special.struve(0, alpha_rad))


def advance_ratio(alpha_rad: float) -> float:
    """Return J0(alpha): the length of one wave along the path over its arc length, the advance of a snake that never
    slips; .11 at .7 pi, so that even the ideal snake hardly advances there.
    """
    return float(special.j0(alpha_rad))
