"""Reprojection and depth of points observed from the window's clones: residuals, weights and Jacobians, batched.

A point p_W in the camera of a clone is p_C = R_CI (R_WI^T (p_W - p_WI) - p_IC), its measurement h = (X/Z, Y/Z, Z) of
p_C. A feature without depth has two rows, the weight of its third is 0. All rows are whitened: divided by their sigma.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.filter.extrinsics import Extrinsics
from snakeslam.estimation.filter.state import State
from snakeslam.estimation.measurements.projection import (
    MIN_Z_M,
    cameras_from_imu,
    huber,
    points_in_cameras,
    pose_jacobian,
    project_jacobian,
    weighted_residuals,
)
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.messages import Float

HUBER = 2.5
"""Residuals beyond this many sigmas are weighed down as 1/|r|: Huber's robust cost."""


@dataclass(frozen=True, slots=True)
class ReprojectionModel:
    """The camera's measurement model: extrinsics, sigma of a feature in normalised coordinates, noise settings."""

    R_IC: Float
    p_IC: Float
    sigma_xy: float
    noise: NoiseSettings

    def usable_depth(self, z: Float) -> NDArray[np.bool_]:
        """Return where a measured depth is within the trusted range."""
        return np.asarray((z >= self.noise.depth_min_m) & (z <= self.noise.depth_max_m))

    def weights(self, xyz: Float, motion_blur_rad: Float | float = 0.0) -> Float:
        """Return 1/sigma of each row of observations (..., 3); 0 for a depth that is not used.

        sigma_xy^2 = sigma_px^2 + (blur_share blur)^2, with the length of the motion blur ``motion_blur_rad`` (...),
        normalised; sigma_z = a + b z^2.
        """
        z = xyz[..., 2]
        sigma_z = self.noise.depth_offset_m + self.noise.depth_square_per_m * z**2
        weight = np.empty_like(xyz)
        weight[..., :2] = 1.0 / np.hypot(self.sigma_xy, self.noise.blur_share * np.asarray(motion_blur_rad))[..., None]
        weight[..., 2] = np.where(self.usable_depth(z), 1.0 / sigma_z, 0.0)
        return weight


@dataclass(slots=True)
class Poses:
    """IMU poses of the window, ``R_WI`` (n, 3, 3) and ``p_WI`` (n, 3), with the camera's extrinsics; constant."""

    R_WI: Float
    p_WI: Float
    extrinsics: Extrinsics | None = None
    """The filter's estimate of the extrinsics; None where they are as calibrated."""
    _cameras: tuple[Float, Float] | None = field(default=None, repr=False)

    def cameras(self, camera: ReprojectionModel) -> tuple[Float, Float]:
        """Return R_CW (n, 3, 3) and R_CW p_WC (n, 3); computed once, as ``camera`` is the same in every call."""
        if self._cameras is None:
            R_IC, p_IC = self.extrinsics_of(camera)
            R_IC, p_IC = np.ascontiguousarray(R_IC), np.ascontiguousarray(p_IC)
            self._cameras = cameras_from_imu(self.R_WI, self.p_WI, R_IC, p_IC)
        return self._cameras

    def extrinsics_of(self, camera: ReprojectionModel) -> tuple[Float, Float]:
        """Return R_IC (3, 3) and p_IC (3,)."""
        extrinsics = self.extrinsics or camera
        return extrinsics.R_IC, extrinsics.p_IC

    @staticmethod
    def of(state: State) -> "Poses":
        """Return the present estimates of the clones."""
        return Poses(state.clones.R_WI, state.clones.p_WI, state.extrinsics)

    @staticmethod
    def first_estimates_of(state: State) -> "Poses":
        """Return the first estimates of the clones and of the extrinsics, where the Jacobians are taken."""
        extrinsics = state.extrinsics.first or state.extrinsics if state.extrinsics is not None else None
        return Poses(state.clones.R_fej, state.clones.p_fej, extrinsics)

    def pick(self, k: int) -> "Poses":
        """Return pose ``k`` (counted from the oldest) as a batch of one."""
        return Poses(self.R_WI[k : k + 1], self.p_WI[k : k + 1], self.extrinsics)


@dataclass(frozen=True, slots=True)
class Observations:
    """Observations of M points from n poses: ``xyz`` (M, n, 3), 0 depth where unknown, ``seen`` (M, n).

    ``weight`` (M, n, 3) is 1/sigma of each row, 0 where there is no measurement. ``flow`` (M, n, 2) is the motion of
    (x, y) per second of a rolling shutter's readout; None where it is not needed.
    """

    xyz: Float
    seen: NDArray[np.bool_]
    weight: Float
    flow: Float | None = None

    @staticmethod
    def weighted(
        xyz: Float,
        seen: NDArray[np.bool_],
        camera: ReprojectionModel,
        motion_blur_rad: Float | float = 0.0,
        flow: Float | None = None,
    ) -> "Observations":
        """Return observations with their weights; ``motion_blur_rad`` (n,) is the motion blur of each pose's image."""

        return Observations(xyz, seen, camera.weights(xyz, motion_blur_rad) * seen[..., None], flow)

    def without_readout(self, extrinsics: Extrinsics | None) -> "Observations":
        """Return the observations of a camera that exposes all rows at once: (x, y) - flow t_r."""
        if self.flow is None or extrinsics is None or not extrinsics.estimates_readout:
            return self
        xyz = self.xyz.copy()
        xyz[..., :2] -= self.flow * extrinsics.readout_s
        return replace(self, xyz=xyz)

    @property
    def row_counts(self) -> NDArray[np.int64]:
        """Number of rows of each point, (M,)."""
        return np.asarray(np.count_nonzero(self.weight > 0.0, axis=(1, 2)))

    def pick(self, chosen: NDArray[np.bool_]) -> "Observations":
        """Return the observations of the ``chosen`` points (M,)."""
        flow = None if self.flow is None else self.flow[chosen]
        return Observations(self.xyz[chosen], self.seen[chosen], self.weight[chosen], flow)


def points_in_camera(points_W: Float, poses: Poses, camera: ReprojectionModel) -> Float:
    """Return points (M, 3) in every camera, (M, n, 3)."""
    return points_in_cameras(np.ascontiguousarray(points_W), *poses.cameras(camera))


def predict(p_C: Float) -> Float:
    """Return h = (X/Z, Y/Z, Z) of points in a camera, (..., 3)."""
    h = p_C.copy()
    h[..., :2] /= np.maximum(p_C[..., 2:], MIN_Z_M)
    return h


def residuals(points_W: Float, poses: Poses, observed: Observations, camera: ReprojectionModel) -> Float:
    """Return the whitened residual z - h of every observation, (M, n, 3); 0 where a point is not observed."""
    return residuals_in_camera(points_in_camera(points_W, poses, camera), observed.without_readout(poses.extrinsics))


def residuals_in_camera(p_C: Float, observed: Observations) -> Float:
    """Return the same for points that are given in the cameras, (M, n, 3)."""
    return weighted_residuals(p_C, observed.xyz, observed.weight)


def point_jacobians(p_C: Float, poses: Poses, observed: Observations, camera: ReprojectionModel) -> Float:
    """Return whitened dh/dp_W = dh/dp_C R_CW, (M, n, 3, 3), of points in the cameras, (M, n, 3)."""
    return project_jacobian(poses.cameras(camera)[0], p_C, observed.weight)


def jacobians(points_W: Float, poses: Poses, observed: Observations, camera: ReprojectionModel) -> tuple[Float, Float]:
    """Return whitened dh/d(theta, p) (M, n, 3, 6) and dh/dp_W (M, n, 3, 3)."""
    return all_jacobians(points_W, poses, observed, camera)[:2]


def all_jacobians(
    points_W: Float, poses: Poses, observed: Observations, camera: ReprojectionModel
) -> tuple[Float, Float, Float]:
    """Return whitened Jacobians by the poses, the points and the estimated part of extrinsics and readout.

    Their shapes are (M, n, 3, 6), (M, n, 3, 3) and (M, n, 3, 0 to 7). With p_I = R_WI^T (p_W - p_WI):

        dh/d(theta, p)       = dh/dp_C (R_CI [p_I]x, -R_CW)
        dh/dp_W              = dh/dp_C R_CW
        dh/d(theta, p)_IC    = dh/dp_C ([p_C]x, -R_CI)
        dh/dt_r              = (flow, 0)
    """
    p_C = points_in_camera(points_W, poses, camera)
    r_h_pW = point_jacobians(p_C, poses, observed, camera)
    R_IC, p_IC = poses.extrinsics_of(camera)
    R_CI = np.ascontiguousarray(np.broadcast_to(R_IC.T, (p_C.shape[1], 3, 3)))
    r_h_pI = project_jacobian(R_CI, p_C, observed.weight)
    p_I = p_C @ R_IC.T + p_IC
    Hx = pose_jacobian(r_h_pI, p_I, r_h_pW)
    by_camera = [np.empty((*p_C.shape, 0))]
    if poses.extrinsics is not None and poses.extrinsics.estimates_pose:
        by_camera.append(pose_jacobian(r_h_pI @ R_IC, p_C, r_h_pI))
    if poses.extrinsics is not None and poses.extrinsics.estimates_readout:
        by_readout = np.zeros((*observed.xyz.shape, 1))
        if observed.flow is not None:
            by_readout[..., :2, 0] = observed.flow * observed.weight[..., :2]
        by_camera.append(by_readout)
    return Hx, r_h_pW, np.concatenate(by_camera, axis=-1)


def robust_scale(r: Float) -> Float:
    """Return the square root of Huber's weight of each observation, (..., 3) -> (..., 1); it scales r and H alike."""
    return huber(np.ascontiguousarray(r).reshape(-1, 3), HUBER).reshape(*r.shape[:-1], 1)
