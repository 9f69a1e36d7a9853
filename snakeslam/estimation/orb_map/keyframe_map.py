"""The ORB map: points and keyframes, adjusted together by local bundle adjustment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.orb_map.bundle import Bundle, adjust
from snakeslam.estimation.orb_map.orb import IndexPairs
from snakeslam.estimation.orb_map.points import PointMap
from snakeslam.estimation.orb_map.settings import OrbMapSettings
from snakeslam.estimation.orb_map.view import Match, OrbView
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float

RECENT_KEYFRAMES = 60
"""Keyframes that share points with a new one are selected from so many of the last ones."""
MIN_SHARED = 15
"""Points that two keyframes must share to be adjusted together."""


@dataclass(slots=True)
class Keyframe:
    """A frame of the map: ``T_WC``, its covariance in W, the ids (ascending) of the points it observes, and where."""

    T_WC: Float
    cov_W: Float
    ids: NDArray[np.int64]
    xyz: Float
    weights: Float

    def keep(self, chosen: NDArray[np.bool_]) -> None:
        """Keep only the ``chosen`` observations."""
        self.ids, self.xyz, self.weights = self.ids[chosen], self.xyz[chosen], self.weights[chosen]


class OrbMap:
    """Points and keyframes; each new keyframe is adjusted together with those that share points with it."""

    def __init__(self, settings: OrbMapSettings) -> None:
        self._settings = settings
        self.points = PointMap()
        self.keyframes: list[Keyframe] = []

    def add_keyframe(
        self, T_WC: Float, cov: Float, view: OrbView, feature: NDArray[np.int64], point: NDArray[np.int64]
    ) -> None:
        """Add a frame whose ``feature`` (n,) are observations of ``point`` (n,); others with depth become new points.

        ``cov`` (6, 6) is that of the right perturbation of T_WC.
        """
        new = view.has_depth.copy()
        new[feature] = False
        fresh = np.flatnonzero(new)
        points_W, information = _in_world(T_WC, view, fresh)
        added = self.points.add(points_W, information, view.features.descriptors[fresh], len(self.keyframes))
        ids = self.points.ids[np.concatenate([point, added])]
        order = np.argsort(ids)
        seen = np.concatenate([feature, fresh])[order]
        # T_WC Exp(d) = Exp(Ad d) T_WC: the covariance in W is Ad cov Ad^T.
        Ad = se3.adjoint(T_WC)
        self.keyframes.append(Keyframe(T_WC, Ad @ cov @ Ad.T, ids[order], view.xyz[seen], view.weights[seen]))
        self.points.shrink(self._settings.max_points)

    def extend(self, T_WC: Float, cov: Float, view: OrbView, match: Match, before: IndexPairs) -> Float:
        """Add a keyframe, merge points that are the same, adjust; return the adjusted T_WC.

        A feature that matches a recent point (``match``) and one of long ago (``before``) shows that they are the same:
        a loop is closed.
        """
        # 1. The id of the point that each feature observes, -1 for none.
        good = match.fit.inliers
        ids = np.full(len(view), -1, np.int64)
        ids[match.feature[good]] = self.points.ids[match.point[good]]
        # 2. A feature with a recent and an old point: the observations of both are those of the old one.
        older = self.points.ids[before.point]
        twice = (ids[before.feature] >= 0) & (ids[before.feature] != older)
        self._merge(ids[before.feature][twice], older[twice])
        ids[np.isin(ids, older)] = -1
        ids[before.feature] = older
        # 3. Add the keyframe with the points that are left, then adjust.
        feature = np.flatnonzero(np.isin(ids, self.points.ids))
        point = np.searchsorted(self.points.ids, ids[feature])
        self.points.add_descriptors(point, view.features.descriptors[feature])
        self.add_keyframe(T_WC, cov, view, feature, point)
        self._adjust()
        return self.keyframes[-1].T_WC

    def _merge(self, young: NDArray[np.int64], old: NDArray[np.int64]) -> None:
        """Make the observations of the points with ids ``young`` (n,) those of ``old`` (n,), and remove the young."""
        if not len(young):
            return
        order = np.argsort(young)
        young, old = young[order], old[order]
        for keyframe in self.keyframes:
            at = np.minimum(np.searchsorted(young, keyframe.ids), len(young) - 1)
            ids = np.where(young[at] == keyframe.ids, old[at], keyframe.ids)
            keyframe.ids, first = np.unique(ids, return_index=True)
            keyframe.xyz, keyframe.weights = keyframe.xyz[first], keyframe.weights[first]
        self.points.keep(~np.isin(self.points.ids, young))

    def _adjust(self) -> None:
        """Adjust the newest keyframe, those that share most points with it, and their points."""
        # 1. Keyframes by the number of points they share with the newest. The first ones are adjusted, as many more are
        #    held; the oldest of all is always held, so that the map does not drift as a whole.
        newest = self.keyframes[-1].ids
        recent = range(max(0, len(self.keyframes) - RECENT_KEYFRAMES), len(self.keyframes))
        shared = np.array([np.isin(self.keyframes[k].ids, newest, assume_unique=True).sum() for k in recent])
        order = np.array(recent)[np.lexsort((-np.array(recent), -shared))][: np.count_nonzero(shared >= MIN_SHARED)]
        n_free = min(self._settings.window, len(order) - 1)
        if n_free < 1:
            return
        oldest = int(order.min())
        free = [k for k in order.tolist() if k != oldest][:n_free]
        fixed = [k for k in order.tolist() if k not in free][: self._settings.window]
        if oldest not in fixed:
            fixed[-1:] = [oldest]
        window = [self.keyframes[k] for k in [*free, *fixed]]

        # 2. Points that a free keyframe observes, and at least one other of the window.
        wanted, counts = np.unique(np.concatenate([keyframe.ids for keyframe in window]), return_counts=True)
        by_free = np.unique(np.concatenate([keyframe.ids for keyframe in window[: len(free)]]))
        wanted = wanted[(counts >= 2) & np.isin(wanted, by_free, assume_unique=True)]
        wanted = wanted[np.isin(wanted, self.points.ids, assume_unique=True)]
        chosen = [np.isin(keyframe.ids, wanted, assume_unique=True) for keyframe in window]
        index = np.searchsorted(self.points.ids, wanted)

        # 3. Adjust; observations that are outliers afterwards are removed.
        bundle = Bundle(
            Ts_WK=np.stack([keyframe.T_WC for keyframe in window]),
            free=len(free),
            points_W=self.points.points_W[index],
            keyframe=np.repeat(np.arange(len(window)), [int(mask.sum()) for mask in chosen]),
            point=np.searchsorted(wanted, np.concatenate([k.ids[m] for k, m in zip(window, chosen, strict=True)])),
            xyz=np.concatenate([k.xyz[m] for k, m in zip(window, chosen, strict=True)]),
            weights=np.concatenate([k.weights[m] for k, m in zip(window, chosen, strict=True)]),
        )
        adjusted = adjust(bundle, self._settings.adjust_rounds)
        self.points.set_positions(index, adjusted.points_W, adjusted.information)
        for k, keyframe in enumerate(window):
            keyframe.T_WC = adjusted.Ts_WK[k]
            good = np.ones(len(keyframe.ids), bool)
            good[chosen[k]] = adjusted.inliers[bundle.keyframe == k]
            keyframe.keep(good)

    def keyframe_cov(self, points: NDArray[np.int64], T_WC: Float) -> Float:
        """Return the mean covariance of the poses of the points' keyframes, (6, 6), as right perturbation of T_WC."""
        keyframes, counts = np.unique(self.points.keyframe[points], return_counts=True)
        covs_W = np.stack([self.keyframes[k].cov_W for k in keyframes.tolist()])
        cov_W = np.einsum("k,kij->ij", counts / counts.sum(), covs_W)
        Ad = se3.adjoint(se3.inv(T_WC))
        return Ad @ cov_W @ Ad.T

    def is_new(self, T_WC: Float, view: OrbView, feature: NDArray[np.int64]) -> bool:
        """Return whether few of the features are in the map, or no keyframe has a similar position and orientation."""
        has_depth = view.has_depth
        if np.count_nonzero(has_depth[feature]) < self._settings.keyframe_matched * np.count_nonzero(has_depth):
            return True
        Ts = [keyframe.T_WC for keyframe in self.keyframes]
        near = [T for T in Ts if np.linalg.norm(T[:3, 3] - T_WC[:3, 3]) <= self._settings.keyframe_distance_m]
        if not near:
            return True
        rotation_rad = np.linalg.norm(so3.log(np.swapaxes(np.stack(near)[:, :3, :3], -1, -2) @ T_WC[:3, :3]), axis=-1)
        return bool(np.all(rotation_rad > np.deg2rad(self._settings.keyframe_angle_deg)))


def _in_world(T_WC: Float, view: OrbView, feature: NDArray[np.int64]) -> tuple[Float, Float]:
    """Return the positions (n, 3) and information (n, 3, 3) in W of features with depth.

    p_C = z (x, y, 1), so dp_C/d(x, y, z) = B = [z 0 x; 0 z y; 0 0 1], and with w = 1/sigma the information in C is
    B^-T diag(w^2) B^-1.
    """
    x, y, z = view.xyz[feature].T
    p_C = np.stack([x * z, y * z, z], axis=-1)
    B_inv = np.zeros((len(z), 3, 3))
    B_inv[:, 0, 0] = B_inv[:, 1, 1] = 1.0 / z
    B_inv[:, 0, 2], B_inv[:, 1, 2], B_inv[:, 2, 2] = -x / z, -y / z, 1.0
    root = view.weights[feature][..., None] * B_inv @ T_WC[:3, :3].T
    return se3.act(T_WC, p_C), np.swapaxes(root, -1, -2) @ root
