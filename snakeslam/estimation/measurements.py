"""Camera rows: reprojection and depth of points seen from the window, batched, whitened, with their Jacobians.

A point in the camera of a clone is p_C = R_CI (R_WI^T (p_W - p_WI) - p_IC). A row triple is (x/z, y/z, z); without
depth the third row is masked out.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.self_calibration import PLACE, Mount
from snakeslam.estimation.settings import NoiseSettings
from snakeslam.estimation.state import State
from snakeslam.messages import Float

HUBER = 2.5
MIN_Z_M = 0.02


@dataclass(frozen=True, slots=True)
class CameraRows:
    """What turns normalised observations into whitened rows."""

    R_IC: Float
    p_IC: Float
    sigma_xy: float
    noise: NoiseSettings

    def usable_depth(self, z: Float) -> NDArray[np.bool_]:
        """Return where a measured depth is within the trusted range."""
        return np.asarray((z >= self.noise.depth_min_m) & (z <= self.noise.depth_max_m))

    def weights(self, xyz: Float, smear: Float | float = 0.0) -> Float:
        """Return 1/sigma of each row of observations (..., 3); 0 for a depth that is not used.

        ``smear`` (...), the normalised length over which a feature is smeared, adds ``blur_share`` of it in squares.
        """
        z = xyz[..., 2]
        sigma_z = self.noise.depth_offset_m + self.noise.depth_square_per_m * z**2
        weight = np.empty_like(xyz)
        weight[..., :2] = 1.0 / np.hypot(self.sigma_xy, self.noise.blur_share * np.asarray(smear))[..., None]
        weight[..., 2] = np.where(self.usable_depth(z), 1.0 / sigma_z, 0.0)
        return weight


@dataclass(slots=True)
class Poses:
    """IMU poses of the window: ``R_WI`` (n, 3, 3), ``p_WI`` (n, 3); they do not change once made."""

    R_WI: Float
    p_WI: Float
    mount: Mount | None = None
    """The camera on the IMU as the filter has it, None where it is as calibrated."""
    _cameras: tuple[Float, Float] | None = field(default=None, repr=False)

    def cameras(self, rows: CameraRows) -> tuple[Float, Float]:
        """Return R_CW (n, 3, 3) and the cameras' own R_CW p_WC (n, 3); made once, for the same ``rows`` each time."""
        if self._cameras is None:
            R_IC, p_IC = self.camera_place(rows)
            R_CW = R_IC.T @ np.swapaxes(self.R_WI, -1, -2)
            self._cameras = R_CW, (R_CW @ self.p_WI[..., None])[..., 0] + p_IC @ R_IC
        return self._cameras

    def camera_place(self, rows: CameraRows) -> tuple[Float, Float]:
        """Return R_IC (3, 3) and p_IC (3,)."""
        place = self.mount or rows
        return place.R_IC, place.p_IC

    @staticmethod
    def of(state: State) -> "Poses":
        """Return the present estimates of the clones."""
        return Poses(state.clones.R_WI, state.clones.p_WI, state.mount)

    @staticmethod
    def first_of(state: State) -> "Poses":
        """Return the first estimates of the clones and of the camera's place."""
        mount = state.mount.first or state.mount if state.mount is not None else None
        return Poses(state.clones.R_fej, state.clones.p_fej, mount)

    def pick(self, k: int) -> "Poses":
        """Return one of them, still as a batch; ``k`` counts from the start."""
        return Poses(self.R_WI[k : k + 1], self.p_WI[k : k + 1], self.mount)


@dataclass(frozen=True, slots=True)
class Observations:
    """Observations of M points from n poses: ``xyz`` (M, n, 3), 0 depth where unknown, ``seen`` (M, n).

    ``weight`` (M, n, 3) is 1/sigma of each row, 0 where there is none.
    """

    xyz: Float
    seen: NDArray[np.bool_]
    weight: Float

    @staticmethod
    def weighed(xyz: Float, seen: NDArray[np.bool_], rows: CameraRows, smear: Float | float = 0.0) -> "Observations":
        """Return observations with the weights that ``rows`` gives them; ``smear`` is that of each pose, (n,)."""
        return Observations(xyz, seen, rows.weights(xyz, smear) * seen[..., None])

    @property
    def row_counts(self) -> NDArray[np.int64]:
        """Number of rows of each point, (M,)."""
        return np.asarray(np.count_nonzero(self.weight > 0.0, axis=(1, 2)))

    def pick(self, chosen: NDArray[np.bool_]) -> "Observations":
        """Return those of some points."""
        return Observations(self.xyz[chosen], self.seen[chosen], self.weight[chosen])


def points_in_camera(points_W: Float, poses: Poses, rows: CameraRows) -> Float:
    """Return points (M, 3) in every camera, (M, n, 3)."""
    R_CW, origin_C = poses.cameras(rows)
    n = len(R_CW)
    return (points_W @ R_CW.reshape(3 * n, 3).T).reshape(-1, n, 3) - origin_C


def predict(p_C: Float) -> Float:
    """Return (x/z, y/z, z) of points in a camera."""
    h = p_C.copy()
    h[..., :2] /= np.maximum(p_C[..., 2:], MIN_Z_M)
    return h


def residuals(points_W: Float, poses: Poses, observed: Observations, rows: CameraRows) -> Float:
    """Return whitened z - h of every observation, (M, n, 3), 0 where a point is not seen."""
    return residuals_in_camera(points_in_camera(points_W, poses, rows), observed)


def residuals_in_camera(p_C: Float, observed: Observations) -> Float:
    """Return the same of points that are in the cameras already, (M, n, 3)."""
    return (observed.xyz - predict(p_C)) * observed.weight


def _rows_of_projection(xy: Float, inverse_z: Float, weight: Float, axes: Float) -> Float:
    """Return weighted rows of d(x/z, y/z, z) along ``axes`` (..., 3, 3), the camera's axes in some frame."""
    out = np.empty((*xy.shape[:-1], 3, 3))
    out[..., :2, :] = axes[..., :2, :] - xy[..., None] * axes[..., 2:, :]
    out[..., :2, :] *= (inverse_z[..., None] * weight[..., :2])[..., None]
    out[..., 2, :] = axes[..., 2, :] * weight[..., 2:]
    return out


def point_jacobians(p_C: Float, poses: Poses, observed: Observations, rows: CameraRows) -> Float:
    """Return whitened dh/dp_W (M, n, 3, 3) of points in the cameras, (M, n, 3)."""
    inverse_z = 1.0 / np.maximum(p_C[..., 2], MIN_Z_M)
    return _rows_of_projection(p_C[..., :2] * inverse_z[..., None], inverse_z, observed.weight, poses.cameras(rows)[0])


def jacobians(points_W: Float, poses: Poses, observed: Observations, rows: CameraRows) -> tuple[Float, Float]:
    """Return whitened dh/d(theta, p) (M, n, 3, 6) and dh/dp_W (M, n, 3, 3)."""
    return all_jacobians(points_W, poses, observed, rows)[:2]


def all_jacobians(
    points_W: Float, poses: Poses, observed: Observations, rows: CameraRows
) -> tuple[Float, Float, Float]:
    """Return the same and that by the camera's place on the IMU, (M, n, 3, 6), or (M, n, 3, 0) where it is held.

    p_C = R_CI (p_I - p_IC): by theta of R_IC it is [p_C]x, by p_IC it is -R_CI.
    """
    p_C = points_in_camera(points_W, poses, rows)
    inverse_z = 1.0 / np.maximum(p_C[..., 2], MIN_Z_M)
    xy = p_C[..., :2] * inverse_z[..., None]
    r_h_pW = _rows_of_projection(xy, inverse_z, observed.weight, poses.cameras(rows)[0])
    R_IC, p_IC = poses.camera_place(rows)
    r_h_pI = _rows_of_projection(xy, inverse_z, observed.weight, R_IC.T)
    Hx = np.empty((*xy.shape[:-1], 3, 6))
    _rows_times_hat(r_h_pI, p_C @ R_IC.T + p_IC, Hx)
    np.negative(r_h_pW, out=Hx[..., 3:])
    frees_place = poses.mount is not None and poses.mount.frees_place
    Hc = np.empty((*xy.shape[:-1], 3, PLACE if frees_place else 0))
    if frees_place:
        _rows_times_hat(r_h_pI @ R_IC, p_C, Hc)
        np.negative(r_h_pI, out=Hc[..., 3:])
    return Hx, r_h_pW, Hc


def _rows_times_hat(a: Float, p: Float, out: Float) -> None:
    """Write a^T [p]x = (a x p)^T of rows (..., 3, 3) and points (..., 3) into the first columns of ``out``."""
    p = p[..., None, :]
    out[..., 0] = a[..., 1] * p[..., 2] - a[..., 2] * p[..., 1]
    out[..., 1] = a[..., 2] * p[..., 0] - a[..., 0] * p[..., 2]
    out[..., 2] = a[..., 0] * p[..., 1] - a[..., 1] * p[..., 0]


def robust_scale(r: Float) -> Float:
    """Return the square root of Huber's weight of each observation, (M, n, 1)."""
    size = np.sqrt(np.sum(r * r, axis=-1, keepdims=True))
    return np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, HUBER)))
