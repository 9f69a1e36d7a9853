"""Camera rows: reprojection and depth of points seen from the window, batched, whitened, with their Jacobians.

A point in the camera of a clone is p_C = R_CI (R_WI^T (p_W - p_WI) - p_IC). A row triple is (x/z, y/z, z); without
depth the third row is masked out. The error of the point is projected out through the normal equations, which for the
information is the same as the null space of its Jacobian [Mourikis07]:
L = sum Hx^T Hx - (Hx^T Hf) (Hf^T Hf)^-1 (Hf^T Hx).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.settings import NoiseSettings
from snakeslam.estimation.state import State
from snakeslam.estimation.tracks import Track
from snakeslam.geometry import so3
from snakeslam.messages import Float

HUBER = 2.5
MIN_Z_M = 0.02
LM_ROUNDS = 6
CONVERGED = 1e-9
SETTLED = 1e-3


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

    def weights(self, xyz: Float) -> Float:
        """Return 1/sigma of each row of observations (..., 3); 0 for a depth that is not used."""
        z = xyz[..., 2]
        sigma_z = self.noise.depth_offset_m + self.noise.depth_square_per_m * z**2
        xy = np.full(z.shape, 1.0 / self.sigma_xy)
        return np.stack([xy, xy, np.where(self.usable_depth(z), 1.0 / sigma_z, 0.0)], axis=-1)


@dataclass(frozen=True, slots=True)
class Poses:
    """IMU poses of the window: ``R_WI`` (n, 3, 3), ``p_WI`` (n, 3)."""

    R_WI: Float
    p_WI: Float

    @staticmethod
    def of(state: State) -> "Poses":
        """Return the present estimates of the clones."""
        return Poses(np.stack([c.R_WI for c in state.clones]), np.stack([c.p_WI for c in state.clones]))

    @staticmethod
    def first_of(state: State) -> "Poses":
        """Return the first estimates of the clones."""
        return Poses(np.stack([c.R_fej for c in state.clones]), np.stack([c.p_fej for c in state.clones]))

    def pick(self, k: int) -> "Poses":
        """Return one of them, still as a batch."""
        return Poses(self.R_WI[k : k + 1], self.p_WI[k : k + 1])


@dataclass(frozen=True, slots=True)
class Observations:
    """Observations of M points from n poses: ``xyz`` (M, n, 3), 0 depth where unknown, ``seen`` (M, n).

    ``weight`` (M, n, 3) is 1/sigma of each row, 0 where there is none.
    """

    xyz: Float
    seen: NDArray[np.bool_]
    weight: Float

    @staticmethod
    def weighed(xyz: Float, seen: NDArray[np.bool_], rows: CameraRows) -> "Observations":
        """Return observations with the weights that ``rows`` gives them."""
        return Observations(xyz, seen, rows.weights(xyz) * seen[..., None])

    @staticmethod
    def of(tracks: Sequence[Track], times_ns: Sequence[int], rows: CameraRows) -> "Observations":
        """Arrange tracks by the times of the window."""
        column = {t_ns: k for k, t_ns in enumerate(times_ns)}
        xyz = np.zeros((len(tracks), len(times_ns), 3))
        seen = np.zeros((len(tracks), len(times_ns)), bool)
        for row, track in enumerate(tracks):
            for t_ns, values in zip(track.t_ns, track.xyz, strict=True):
                k = column.get(t_ns)
                if k is not None:
                    xyz[row, k], seen[row, k] = values, True
        return Observations.weighed(xyz, seen, rows)

    def pick(self, rows: NDArray[np.bool_]) -> "Observations":
        """Return those of some points."""
        return Observations(self.xyz[rows], self.seen[rows], self.weight[rows])


def points_in_camera(points_W: Float, poses: Poses, rows: CameraRows) -> tuple[Float, Float]:
    """Return points (M, 3) in every IMU frame and every camera, both (M, n, 3)."""
    p_I = np.einsum("nji,mnj->mni", poses.R_WI, points_W[:, None] - poses.p_WI[None])
    return p_I, (p_I - rows.p_IC) @ rows.R_IC


def predict(p_C: Float) -> Float:
    """Return (x/z, y/z, z) of points in a camera."""
    z = np.maximum(p_C[..., 2:], MIN_Z_M)
    return np.concatenate([p_C[..., :2] / z, p_C[..., 2:]], axis=-1)


def residuals(points_W: Float, poses: Poses, observed: Observations, rows: CameraRows) -> Float:
    """Return whitened z - h of every observation, (M, n, 3), 0 where a point is not seen."""
    _, p_C = points_in_camera(points_W, poses, rows)
    return (observed.xyz - predict(p_C)) * observed.weight


def jacobians(points_W: Float, poses: Poses, observed: Observations, rows: CameraRows) -> tuple[Float, Float]:
    """Return whitened dh/d(theta, p) (M, n, 3, 6) and dh/dp_W (M, n, 3, 3)."""
    p_I, p_C = points_in_camera(points_W, poses, rows)
    z = np.maximum(p_C[..., 2], MIN_Z_M)
    r_h_pC = np.zeros((*p_C.shape, 3))
    r_h_pC[..., 0, 0] = r_h_pC[..., 1, 1] = 1.0 / z
    r_h_pC[..., 0, 2], r_h_pC[..., 1, 2] = -p_C[..., 0] / z**2, -p_C[..., 1] / z**2
    r_h_pC[..., 2, 2] = 1.0
    r_h_pI = (r_h_pC @ rows.R_IC.T) * observed.weight[..., None]
    r_h_pW = r_h_pI @ np.swapaxes(poses.R_WI, -1, -2)[None]
    return np.concatenate([r_h_pI @ so3.hat(p_I), -r_h_pW], axis=-1), r_h_pW


def robust_scale(r: Float) -> Float:
    """Return the square root of Huber's weight of each observation, (M, n, 1)."""
    size = np.linalg.norm(r, axis=-1, keepdims=True)
    return np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, HUBER)))


def triangulate(poses: Poses, observed: Observations, rows: CameraRows) -> tuple[Float, NDArray[np.bool_]]:
    """Return points (M, 3) in W and which of them are well determined.

    Starts from the mean of the measured depths or, without any, from the point nearest to all rays; then
    Levenberg-Marquardt on the whitened residuals.
    """
    points = _start(poses, observed, rows)
    damping = np.full(len(points), 1e-3)
    r = residuals(points, poses, observed, rows)
    cost = np.sum((r * robust_scale(r)) ** 2, axis=(1, 2))
    for _ in range(LM_ROUNDS):
        A, g = _normal_equations(points, poses, observed, rows)
        diagonal = np.einsum("mii->mi", A)
        damped = A + np.einsum("m,mi,ij->mij", damping, diagonal + CONVERGED, np.eye(3))
        trial = points + np.linalg.solve(damped, g[..., None])[..., 0]
        r = residuals(trial, poses, observed, rows)
        trial_cost = np.sum((r * robust_scale(r)) ** 2, axis=(1, 2))
        better = trial_cost <= cost
        points = np.where(better[:, None], trial, points)
        settled = bool(np.all(np.abs(cost - trial_cost) <= SETTLED * (cost + SETTLED)))
        cost = np.where(better, trial_cost, cost)
        damping = np.where(better, damping * 0.1, damping * 10.0)
        if settled:
            break
    return points, _well_determined(points, poses, observed, rows)


def _start(poses: Poses, observed: Observations, rows: CameraRows) -> Float:
    R_WC = poses.R_WI @ rows.R_IC
    p_WC = poses.p_WI + poses.R_WI @ rows.p_IC
    rays = np.concatenate([observed.xyz[..., :2], np.ones((*observed.seen.shape, 1))], axis=-1)
    rays_W = np.einsum("nij,mnj->mni", R_WC, rays)
    weight = observed.weight[..., 2] ** 2
    total = weight.sum(axis=1)
    lifted = p_WC[None] + rays_W * observed.xyz[..., 2:]
    from_depth = np.einsum("mn,mni->mi", weight, lifted) / np.maximum(total, CONVERGED)[:, None]
    unit = rays_W / np.linalg.norm(rays_W, axis=-1, keepdims=True)
    off_ray = (np.eye(3) - unit[..., :, None] * unit[..., None, :]) * observed.seen[..., None, None]
    A = off_ray.sum(axis=1) + 1e-6 * np.eye(3)
    b = np.einsum("mnij,nj->mi", off_ray, p_WC)
    nearest = np.linalg.solve(A, b[..., None])[..., 0]
    return np.where(total[:, None] > 0.0, from_depth, nearest)


def _normal_equations(points: Float, poses: Poses, observed: Observations, rows: CameraRows) -> tuple[Float, Float]:
    r = residuals(points, poses, observed, rows)
    scale = robust_scale(r)
    _, r_h_f = jacobians(points, poses, observed, rows)
    r_h_f = r_h_f * scale[..., None]
    r = r * scale
    return np.einsum("mnki,mnkj->mij", r_h_f, r_h_f), np.einsum("mnki,mnk->mi", r_h_f, r)


MAX_RELATIVE_SIGMA = 0.15


def _well_determined(points: Float, poses: Poses, observed: Observations, rows: CameraRows) -> NDArray[np.bool_]:
    """Return which points are in front of all cameras and known to 15 % of their distance."""
    _, p_C = points_in_camera(points, poses, rows)
    in_front = np.all((p_C[..., 2] > 0.1) | ~observed.seen, axis=1) & np.all(np.isfinite(points), axis=1)
    A, _ = _normal_equations(points, poses, observed, rows)
    weakest = np.maximum(np.linalg.eigvalsh(A)[:, 0], CONVERGED)
    distance = np.linalg.norm(points - poses.p_WI[-1], axis=1)
    return np.asarray(in_front & (1.0 / np.sqrt(weakest) < MAX_RELATIVE_SIGMA * np.maximum(distance, 0.3)))
