"""Camera rows: reprojection and depth of points seen from the window, batched, whitened, with their Jacobians.

A point in the camera of a clone is p_C = R_CI (R_WI^T (p_W - p_WI) - p_IC). A row triple is (x/z, y/z, z); without
depth the third row is masked out.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.filter.extrinsics import Mount
from snakeslam.estimation.filter.state import State
from snakeslam.estimation.measurements.projection import (
    MIN_Z_M,
    cameras_from_imu,
    huber,
    rows_along,
    rows_by_turn_and_shift,
    seen_from,
    weighed_residuals,
)
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.messages import Float

HUBER = 2.5


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
            R_IC, p_IC = np.ascontiguousarray(R_IC), np.ascontiguousarray(p_IC)
            self._cameras = cameras_from_imu(self.R_WI, self.p_WI, R_IC, p_IC)
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

    ``weight`` (M, n, 3) is 1/sigma of each row, 0 where there is none. ``flow`` (M, n, 2) is how a rolling shutter
    moves (x, y), per second of readout; None where nobody asks.
    """

    xyz: Float
    seen: NDArray[np.bool_]
    weight: Float
    flow: Float | None = None

    @staticmethod
    def weighed(
        xyz: Float, seen: NDArray[np.bool_], rows: CameraRows, smear: Float | float = 0.0, flow: Float | None = None
    ) -> "Observations":
        """Return observations with the weights that ``rows`` gives them; ``smear`` is that of each pose, (n,)."""
        return Observations(xyz, seen, rows.weights(xyz, smear) * seen[..., None], flow)

    def at_middle(self, mount: Mount | None) -> "Observations":
        """Return what a camera that exposes all rows at the middle of the picture would have seen."""
        if self.flow is None or mount is None or not mount.frees_readout:
            return self
        xyz = self.xyz.copy()
        xyz[..., :2] -= self.flow * mount.readout_s
        return replace(self, xyz=xyz)

    @property
    def row_counts(self) -> NDArray[np.int64]:
        """Number of rows of each point, (M,)."""
        return np.asarray(np.count_nonzero(self.weight > 0.0, axis=(1, 2)))

    def pick(self, chosen: NDArray[np.bool_]) -> "Observations":
        """Return those of some points."""
        flow = None if self.flow is None else self.flow[chosen]
        return Observations(self.xyz[chosen], self.seen[chosen], self.weight[chosen], flow)


def points_in_camera(points_W: Float, poses: Poses, rows: CameraRows) -> Float:
    """Return points (M, 3) in every camera, (M, n, 3)."""
    return seen_from(np.ascontiguousarray(points_W), *poses.cameras(rows))


def predict(p_C: Float) -> Float:
    """Return (x/z, y/z, z) of points in a camera."""
    h = p_C.copy()
    h[..., :2] /= np.maximum(p_C[..., 2:], MIN_Z_M)
    return h


def residuals(points_W: Float, poses: Poses, observed: Observations, rows: CameraRows) -> Float:
    """Return whitened z - h of every observation, (M, n, 3), 0 where a point is not seen."""
    return residuals_in_camera(points_in_camera(points_W, poses, rows), observed.at_middle(poses.mount))


def residuals_in_camera(p_C: Float, observed: Observations) -> Float:
    """Return the same of points that are in the cameras already, (M, n, 3)."""
    return weighed_residuals(p_C, observed.xyz, observed.weight)


def point_jacobians(p_C: Float, poses: Poses, observed: Observations, rows: CameraRows) -> Float:
    """Return whitened dh/dp_W (M, n, 3, 3) of points in the cameras, (M, n, 3)."""
    return rows_along(poses.cameras(rows)[0], p_C, observed.weight)


def jacobians(points_W: Float, poses: Poses, observed: Observations, rows: CameraRows) -> tuple[Float, Float]:
    """Return whitened dh/d(theta, p) (M, n, 3, 6) and dh/dp_W (M, n, 3, 3)."""
    return all_jacobians(points_W, poses, observed, rows)[:2]


def all_jacobians(
    points_W: Float, poses: Poses, observed: Observations, rows: CameraRows
) -> tuple[Float, Float, Float]:
    """Return the same and that by what is free of the camera's place on the IMU and its readout, (M, n, 3, 0 to 7).

    p_C = R_CI (p_I - p_IC): by theta of R_IC it is [p_C]x, by p_IC it is -R_CI.
    """
    p_C = points_in_camera(points_W, poses, rows)
    r_h_pW = point_jacobians(p_C, poses, observed, rows)
    R_IC, p_IC = poses.camera_place(rows)
    axes_I = np.ascontiguousarray(np.broadcast_to(R_IC.T, (p_C.shape[1], 3, 3)))
    r_h_pI = rows_along(axes_I, p_C, observed.weight)
    Hx = rows_by_turn_and_shift(r_h_pI, p_C @ R_IC.T + p_IC, r_h_pW)
    by_camera = [np.empty((*p_C.shape, 0))]
    if poses.mount is not None and poses.mount.frees_place:
        by_camera.append(rows_by_turn_and_shift(r_h_pI @ R_IC, p_C, r_h_pI))
    if poses.mount is not None and poses.mount.frees_readout:
        by_camera.append(_by_readout(observed))
    return Hx, r_h_pW, np.concatenate(by_camera, axis=-1)


def _by_readout(observed: Observations) -> Float:
    """Return whitened dh/dt_r, (M, n, 3, 1): what is seen moves with the rows, (x, y) alone."""
    out = np.zeros((*observed.xyz.shape, 1))
    if observed.flow is not None:
        out[..., :2, 0] = observed.flow * observed.weight[..., :2]
    return out


def robust_scale(r: Float) -> Float:
    """Return the square root of Huber's weight of each observation, (..., 3) -> (..., 1)."""
    return huber(np.ascontiguousarray(r).reshape(-1, 3), HUBER).reshape(*r.shape[:-1], 1)
