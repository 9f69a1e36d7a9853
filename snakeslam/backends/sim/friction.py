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
        return sliding_forces(load_n, velocity_W, normal_W, along_W, self.mu_tangential, self.mu_normal, self.slip_m_s)


@compiled
def sliding_forces(
    load_n: Float, velocity_W: Float, normal_W: Float, along_W: Float, mu_t: float, mu_n: float, slip_m_s: float
) -> Float:
    """Return what ``CoulombFriction.forces`` does."""
    forces_W = np.empty_like(velocity_W)
    for c in range(len(load_n)):
        nx, ny, nz = normal_W[c]
        tx, ty, tz = _in_plane(along_W[c], nx, ny, nz)
        size = max(np.sqrt(tx * tx + ty * ty + tz * tz), 1e-9)
        tx, ty, tz = tx / size, ty / size, tz / size
        sx, sy, sz = _in_plane(velocity_W[c], nx, ny, nz)
        scale = -load_n[c] / np.sqrt(sx * sx + sy * sy + sz * sz + slip_m_s**2)
        along = (mu_t - mu_n) * (sx * tx + sy * ty + sz * tz)
        forces_W[c, 0] = scale * (mu_n * sx + along * tx)
        forces_W[c, 1] = scale * (mu_n * sy + along * ty)
        forces_W[c, 2] = scale * (mu_n * sz + along * tz)
    return forces_W


@compiled
def _in_plane(vector: Float, nx: float, ny: float, nz: float) -> tuple[float, float, float]:
    x, y, z = vector
    out = x * nx + y * ny + z * nz
    return x - out * nx, y - out * ny, z - out * nz
