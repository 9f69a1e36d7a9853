"""Alignment of trajectories and their errors; stamps are integer ns, poses (N, 4, 4) of the IMU in a world.

Definitions: [Sturm12] for ATE and RPE, [Zhang18] "A tutorial on quantitative trajectory evaluation" for the yaw-only
alignment.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry import se3, so3
from snakeslam.messages import Float

Stamps = NDArray[np.int64]
MAX_GAP_NS = 100_000_000
NEAREST_NS = 5_000_000
MIN_POSES_TO_ALIGN = 3


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses ``Ts_WI`` (N, 4, 4) at increasing stamps ``t_ns`` (N,)."""

    t_ns: Stamps
    Ts_WI: Float

    def __len__(self) -> int:
        return len(self.t_ns)

    def at(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> "Trajectory":
        """Return the chosen poses."""
        return Trajectory(self.t_ns[index], self.Ts_WI[index])

    @property
    def path_m(self) -> float:
        """Length of the polyline through the positions."""
        return float(np.sum(np.linalg.norm(np.diff(self.Ts_WI[:, :3, 3], axis=0), axis=1)))


class RelativeError(NamedTuple):
    """Root mean squares of the relative pose error."""

    trans_m: float
    rot_deg: float


def interpolate(truth: Trajectory, t_ns: Stamps) -> tuple[Float, NDArray[np.bool_]]:
    """Return the truth at ``t_ns`` (M,) as poses (M, 4, 4), and where it is known.

    Between two samples at most 100 ms apart: positions linearly, rotations along the geodesic. Elsewhere the nearest
    sample where it is within 5 ms.
    """
    known = np.zeros(len(t_ns), dtype=np.bool_)
    poses = np.tile(np.eye(4), (len(t_ns), 1, 1))
    if not len(truth) or not len(t_ns):
        return poses, known
    after = np.clip(np.searchsorted(truth.t_ns, t_ns), 1, max(1, len(truth) - 1))
    before = after - 1
    after = np.minimum(after, len(truth) - 1)
    gap = truth.t_ns[after] - truth.t_ns[before]
    u = (t_ns - truth.t_ns[before]) / np.maximum(gap, 1)
    inside = (u >= 0) & (u <= 1) & (gap > 0) & (gap <= MAX_GAP_NS)
    nearest = np.where(u > 0.5, after, before)
    known = inside | (np.abs(truth.t_ns[nearest] - t_ns) <= NEAREST_NS)
    a, b = truth.Ts_WI[before], truth.Ts_WI[after]
    R = a[:, :3, :3] @ so3.exp(u[:, None] * so3.log(np.swapaxes(a[:, :3, :3], 1, 2) @ b[:, :3, :3]))
    between = se3.from_rt(R, a[:, :3, 3] + u[:, None] * (b[:, :3, 3] - a[:, :3, 3]))
    poses = np.where(inside[:, None, None], between, truth.Ts_WI[nearest])
    return poses, known


def align_posyaw(p_from: Float, p_to: Float) -> Float:
    """Return the T (4, 4), a yaw and a translation, that minimises sum |p_to - T p_from|^2, points (N, 3).

    The yaw is atan2(sum x y' - y x', sum x x' + y y') of the centred points: the 4-DoF case of [Umeyama91], as gravity
    is observed [Zhang18].
    """
    a, b = p_from - p_from.mean(axis=0), p_to - p_to.mean(axis=0)
    yaw = np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]))
    R = so3.from_yaw(yaw)
    return se3.from_rt(R, p_to.mean(axis=0) - R @ p_from.mean(axis=0))


def align_se3(p_from: Float, p_to: Float) -> Float:
    """Return the rigid T (4, 4) that minimises sum |p_to - T p_from|^2, points (N, 3) [Umeyama91] without scale."""
    a, b = p_from - p_from.mean(axis=0), p_to - p_to.mean(axis=0)
    U, _, Vt = np.linalg.svd(b.T @ a)
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return se3.from_rt(R, p_to.mean(axis=0) - R @ p_from.mean(axis=0))


def ate_m(p_estimate: Float, p_truth: Float, T: Float) -> float:
    """Return the root mean square of |p_truth - T p_estimate|, points (N, 3)."""
    residuals = p_truth - se3.act(T, p_estimate)
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))


def relative_error(estimate: Trajectory, Ts_truth: Float, delta_ns: int, tolerance_ns: int) -> RelativeError | None:
    """Return the RPE over ``delta_ns``, of all pairs within ``tolerance_ns`` of it; None without a pair.

    E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j), Q the truth ``Ts_truth`` (N, 4, 4) at the estimate's stamps [Sturm12].
    """
    wanted = estimate.t_ns + delta_ns
    right = np.clip(np.searchsorted(estimate.t_ns, wanted), 1, max(1, len(estimate) - 1))
    left = right - 1
    right = np.minimum(right, len(estimate) - 1)
    j = np.where(wanted - estimate.t_ns[left] <= estimate.t_ns[right] - wanted, left, right)
    i = np.flatnonzero(np.abs(estimate.t_ns[j] - wanted) <= tolerance_ns)
    if not i.size:
        return None
    j = j[i]
    P = se3.inv(estimate.Ts_WI[i]) @ estimate.Ts_WI[j]
    Q = se3.inv(Ts_truth[i]) @ Ts_truth[j]
    E = se3.inv(Q) @ P
    angles_deg = np.rad2deg(np.linalg.norm(so3.log(E[:, :3, :3]), axis=1))
    trans_m = float(np.sqrt(np.mean(np.sum(E[:, :3, 3] ** 2, axis=1))))
    return RelativeError(trans_m, float(np.sqrt(np.mean(angles_deg**2))))
