"""The Coulomb law between skin and ground, applied outside PyBullet, whose own depends on the world's axes."""

from dataclasses import dataclass

import numpy as np

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
        t_W = along_W - _dot(along_W, normal_W) * normal_W
        t_W = t_W / np.maximum(np.sqrt(_dot(t_W, t_W)), 1e-9)
        slip_W = velocity_W - _dot(velocity_W, normal_W) * normal_W
        along = _dot(slip_W, t_W) * t_W
        scale = -load_n[:, None] / np.sqrt(_dot(slip_W, slip_W) + self.slip_m_s**2)
        return scale * (self.mu_normal * slip_W + (self.mu_tangential - self.mu_normal) * along)


def _dot(a: Float, b: Float) -> Float:
    """Return a . b of each row, (C, 1)."""
    return np.einsum("ci,ci->c", a, b)[:, None]
