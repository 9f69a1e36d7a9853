"""The Coulomb law between skin and ground, applied outside PyBullet, whose own depends on the world's axes."""

from dataclasses import dataclass

import numpy as np

from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float


@dataclass(frozen=True, slots=True)
class CoulombFriction:
    """F = -N (mu_t v_t t + mu_n v_n b) / sqrt(|v|^2 + eps^2), t along the link and b across it in the contact's plane.

    The regularisation ``slip_m_s`` (eps) lets a robot on a slope creep at up to eps tan(slope) / mu.
    """

    mu_tangential: float
    mu_normal: float
    slip_m_s: float

    def forces(self, load_n: Float, velocity_W: Float, normal_W: Float, along_W: Float) -> Float:
        """Return the friction force on each contact, (C, 3) N in W.

        ``load_n`` (C,) N is the normal load, ``velocity_W`` (C, 3) m/s of the skin over the ground, ``normal_W`` (C, 3)
        the unit normal out of the ground, ``along_W`` (C, 3) the link's axis; where that stands on the ground any pair
        of directions serves, with the same coefficients.
        """
        return _forces(load_n, velocity_W, normal_W, along_W, self.mu_tangential, self.mu_normal, self.slip_m_s)


@compiled
def _forces(
    load_n: Float, velocity_W: Float, normal_W: Float, along_W: Float, mu_t: float, mu_n: float, slip_m_s: float
) -> Float:
    forces_W = np.empty_like(velocity_W)
    for c in range(len(load_n)):
        n, v = normal_W[c], velocity_W[c]
        t = along_W[c] - np.sum(along_W[c] * n) * n
        t = t / max(np.sqrt(np.sum(t * t)), 1e-9)
        slip = v - np.sum(v * n) * n
        scale = -load_n[c] / np.sqrt(np.sum(slip * slip) + slip_m_s**2)
        forces_W[c] = scale * (mu_n * slip + (mu_t - mu_n) * np.sum(slip * t) * t)
    return forces_W
