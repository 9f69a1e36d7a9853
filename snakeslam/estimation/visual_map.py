"""What the visual mode knows of the world: points, and the keyframes that they came from."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.point_map import PointMap
from snakeslam.estimation.visual_settings import VisualSettings
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float

if TYPE_CHECKING:
    from snakeslam.estimation.visual_match import Match, View


class VisualMap:
    """Grows by keyframes; sightings of known points are averaged into them."""

    def __init__(self, settings: VisualSettings) -> None:
        self._settings = settings
        self.points = PointMap()
        self._Ts_WK: list[Float] = []
        self._covs_W: list[Float] = []

    def add_keyframe(self, T_WC: Float, cov: Float, view: View, known: NDArray[np.bool_]) -> None:
        """Add the features with depth that are not ``known`` (N,) as points; ``cov`` is of the right perturbation."""
        new = np.flatnonzero(view.has_depth & ~known)
        points_W, information = _in_world(T_WC, view, new)
        self.points.add(points_W, information, view.features.descriptors[new], len(self._Ts_WK))
        Ad = se3.adjoint(T_WC)
        self._Ts_WK.append(T_WC)
        self._covs_W.append(Ad @ cov @ Ad.T)
        self.points.shrink(self._settings.max_points)

    def learn(self, T_WC: Float, cov: Float, view: View, match: Match) -> None:
        """Average the agreeing sightings into their points; add a keyframe where the map is thin or the view new."""
        deep = match.fit.inliers & view.has_depth[match.feature]
        point, feature = match.point[deep], match.feature[deep]
        self.points.fuse(point, *_in_world(T_WC, view, feature))
        known = np.zeros(len(view), bool)
        known[match.feature[match.fit.inliers]] = True
        if not self._is_new(T_WC, view, known):
            return
        agreed = match.point[match.fit.inliers]
        self.points.remember(agreed, view.features.descriptors[match.feature[match.fit.inliers]])
        self.add_keyframe(T_WC, cov, view, known)

    def base_cov(self, points: NDArray[np.int64], T_WC: Float) -> Float:
        """Return the mean covariance that points have from their keyframes' poses, as right perturbation of T_WC."""
        share = np.bincount(self.points.keyframe[points], minlength=len(self._covs_W)) / max(len(points), 1)
        cov_W = np.einsum("k,kij->ij", share, np.stack(self._covs_W))
        Ad = se3.adjoint(se3.inv(T_WC))
        return Ad @ cov_W @ Ad.T

    def _is_new(self, T_WC: Float, view: View, known: NDArray[np.bool_]) -> bool:
        """Whether few of the features are in the map, or no keyframe is near and turned the same way."""
        deep = view.has_depth
        if np.count_nonzero(known & deep) < self._settings.keyframe_matched * np.count_nonzero(deep):
            return True
        Ts = np.stack(self._Ts_WK)
        far = np.linalg.norm(Ts[:, :3, 3] - T_WC[:3, 3], axis=-1) > self._settings.keyframe_distance_m
        angle = np.linalg.norm(so3.log(np.swapaxes(Ts[:, :3, :3], -1, -2) @ T_WC[:3, :3]), axis=-1)
        return bool(np.all(far | (angle > np.deg2rad(self._settings.keyframe_angle_deg))))


def _in_world(T_WC: Float, view: View, feature: NDArray[np.int64]) -> tuple[Float, Float]:
    """Return the positions (n, 3) and information (n, 3, 3) in W of features with depth.

    p_C = z (x, y, 1), so the error of (x, y, z) goes by B = [[z, 0, x], [0, z, y], [0, 0, 1]]; with 1/sigma = w the
    information is B^-T diag(w^2) B^-1.
    """
    x, y, z = view.xyz[feature].T
    p_C = np.stack([x * z, y * z, z], axis=-1)
    B_inv = np.zeros((len(z), 3, 3))
    B_inv[:, 0, 0] = B_inv[:, 1, 1] = 1.0 / z
    B_inv[:, 0, 2], B_inv[:, 1, 2], B_inv[:, 2, 2] = -x / z, -y / z, 1.0
    root = view.weights[feature][..., None] * B_inv @ T_WC[:3, :3].T
    return se3.act(T_WC, p_C), np.swapaxes(root, -1, -2) @ root
