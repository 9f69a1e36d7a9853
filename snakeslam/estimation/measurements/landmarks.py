"""Observations of the state's landmarks from the newest clone: a measurement of landmark, clone and extrinsics."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import Information
from snakeslam.estimation.filter.state import LANDMARK, State
from snakeslam.estimation.measurements.camera import (
    Observations,
    Poses,
    ReprojectionModel,
    all_jacobians,
    residuals,
    robust_scale,
)
from snakeslam.messages import Float


@dataclass(slots=True)
class LandmarkObservations:
    """Observations of landmarks ``index`` (L,) from the newest clone; the arrays of ``observed`` are (L, 1, 3)."""

    index: NDArray[np.int64]
    observed: Observations
    camera: ReprojectionModel
    _scale: Float = field(default_factory=lambda: np.empty(0))
    _first: tuple[NDArray[np.int64], Float] | None = None
    """The result of ``_jacobian``: it is taken at first estimates, which do not change within a frame."""

    def __len__(self) -> int:
        return len(self.index)

    def pick(self, chosen: NDArray[np.bool_]) -> "LandmarkObservations":
        """Return the ``chosen`` observations (L,)."""
        picked = LandmarkObservations(self.index[chosen], self.observed.pick(chosen), self.camera)
        if self._first is not None:
            at, H = self._first
            picked._first = at[chosen], H[chosen]
        return picked

    def _residuals(self, state: State) -> Float:
        newest = Poses.of(state).pick(len(state.clones) - 1)
        return residuals(state.landmarks.p_W[self.index], newest, self.observed, self.camera)[:, 0]

    def _jacobian(self, state: State) -> tuple[NDArray[np.int64], Float]:
        """Return H (L, 3, k) by extrinsics, newest clone and landmark, and the indices (L, k) of their errors."""
        if self._first is not None:
            return self._first
        newest = len(state.clones) - 1
        first = Poses.first_estimates_of(state).pick(newest)
        Hx, Hf, Hc = all_jacobians(state.landmarks.p_fej[self.index], first, self.observed, self.camera)
        pose = np.r_[state.extrinsics_part, state.clone_slice(newest)]
        at = np.hstack([np.broadcast_to(pose, (len(self.index), len(pose))), state.landmark_rows(self.index)])
        self._first = at, np.concatenate([Hc[:, 0], Hx[:, 0], Hf[:, 0]], axis=-1)
        return self._first

    def innovation(self, state: State) -> Innovation:
        """Return the innovation of each landmark, S = H P H^T + I."""
        at, H = self._jacobian(state)
        P = state.cov[at[:, :, None], at[:, None, :]]
        return Innovation.of(self._residuals(state), H @ P @ np.swapaxes(H, 1, 2), self.observed.row_counts)

    def linearise(self, state: State, total: Information) -> None:
        """Add L, H^T r and r^T r to ``total``, with Huber's weights.

        Extrinsics and clone (``shared``) are the same for all landmarks, so their blocks are sums; each landmark's
        (``owned``) are its own.
        """
        r = self._residuals(state)
        self._scale = robust_scale(r)
        at, H = self._jacobian(state)
        r, H = r * self._scale, H * self._scale[..., None]
        # H_l^T H_l (k, k) of every landmark l, with k = extrinsics and clone (shared), then the landmark's own three.
        H_T = np.swapaxes(H, 1, 2)
        blocks, gradient = H_T @ H, (H_T @ r[..., None])[..., 0]
        shared, owned = slice(0, at.shape[1] - LANDMARK), slice(at.shape[1] - LANDMARK, None)
        # Indices of both in the state: the shared ones are the same for all, so their block is the sum.
        pose, own = at[0, shared], at[:, owned]

        total.L[pose[:, None], pose] += blocks[:, shared, shared].sum(axis=0)
        total.L[pose[None, :, None], own[:, None, :]] += blocks[:, shared, owned]
        total.L[own[:, :, None], pose[None, None, :]] += blocks[:, owned, shared]
        total.L[own[:, :, None], own[:, None, :]] += blocks[:, owned, owned]
        total.gradient[pose] += gradient[:, shared].sum(axis=0)
        total.gradient[own] += gradient[:, owned]
        total.cost += float(np.sum(r * r))

    def cost(self, state: State) -> float:
        """Return r^T r with the weights of the last linearisation."""
        r = self._residuals(state) * self._scale
        return float(np.sum(r * r))

    def back_substitute(self, step: Float) -> Float:
        """Return nothing: landmarks are part of the state."""
        del step
        return np.empty(0)

    def restore(self, kept: Float) -> None:
        """Do nothing: landmarks are part of the state."""
        del kept
