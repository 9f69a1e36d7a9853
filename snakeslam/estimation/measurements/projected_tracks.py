"""Tracks as a measurement on the window's clones, with their points projected out, as in MSCKF [Mourikis07].

A track has residual r = z - h, Jacobian Hx by clones and extrinsics, and Hf by its point. Projection on the left null
space of Hf removes the point; for the information that is the Schur complement of the normal equations,

    L = sum Hx^T Hx - (Hx^T Hf) (Hf^T Hf)^-1 (Hf^T Hx),   b = sum Hx^T r - (Hx^T Hf) (Hf^T Hf)^-1 Hf^T r

and back-substitution, df = (Hf^T Hf)^-1 (Hf^T r - Hf^T Hx dx), moves the points along in the iterated update.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import Information
from snakeslam.estimation.filter.state import CLONE, LANDMARK, State
from snakeslam.estimation.measurements.camera import (
    Observations,
    Poses,
    ReprojectionModel,
    all_jacobians,
    residuals,
    robust_scale,
)
from snakeslam.estimation.measurements.triangulation import triangulate
from snakeslam.messages import Float

POINT_PRIOR = 1e4
"""Variance c of a point in the gate, m^2: so wide that S = Hx P Hx^T + c Hf Hf^T + I is the projected covariance."""
POINT_UNKNOWNS = 3


@dataclass(slots=True)
class _Linearisation:
    """``Hf`` (M, 3n, 3) with Huber's weights ``scale`` (M, n, 1), and the Schur complement's parts.

    ``A_inv`` = (Hf^T Hf)^-1 (M, 3, 3), ``cross`` = Hx^T Hf (c + 6n, M, 3), ``g`` = Hf^T r (M, 3).
    """

    Hf: Float
    scale: Float
    A_inv: Float
    cross: Float
    g: Float
    at: slice
    """Slice of the error state that ``cross`` refers to: the camera's extrinsics and the window."""


@dataclass(slots=True)
class ProjectedTracks:
    """M tracks with their triangulated points: ``ids`` (M,), ``points_W`` (M, 3)."""

    ids: NDArray[np.int64]
    observed: Observations
    points_W: Float
    camera: ReprojectionModel
    _last: _Linearisation | None = field(default=None)
    _fresh: tuple[Float, Float, Float, Float] | None = field(default=None)
    """r, Hx, Hf, Hc of the gate, used once more by the first linearisation: neither state nor points have changed."""

    @staticmethod
    def of(
        ids: NDArray[np.int64], observed: Observations, state: State, camera: ReprojectionModel
    ) -> "ProjectedTracks":
        """Return those tracks whose points can be triangulated from the window, with more rows than unknowns."""
        if not len(ids):
            return ProjectedTracks(ids, observed, np.empty((0, 3)), camera)
        points, good = triangulate(Poses.of(state), observed.without_readout(state.extrinsics), camera)
        good &= observed.row_counts > POINT_UNKNOWNS
        return ProjectedTracks(ids, observed, points, camera).pick(good)

    def __len__(self) -> int:
        return len(self.ids)

    def pick(self, chosen: NDArray[np.bool_]) -> "ProjectedTracks":
        """Return the ``chosen`` tracks (M,)."""
        picked = ProjectedTracks(self.ids[chosen], self.observed.pick(chosen), self.points_W[chosen], self.camera)
        if self._fresh is not None:
            r, Hx, Hf, Hc = self._fresh
            picked._fresh = r[chosen], Hx[chosen], Hf[chosen], Hc[chosen]
        return picked

    def _rows_of_state(self, state: State) -> tuple[Float, Float, Float, Float]:
        """Return whitened r (M, n, 3), and Jacobians Hx (M, n, 3, 6), Hf (M, n, 3, 3), Hc (M, n, 3, c)."""
        r = residuals(self.points_W, Poses.of(state), self.observed, self.camera)
        return r, *all_jacobians(self.points_W, Poses.first_estimates_of(state), self.observed, self.camera)

    def innovation(self, state: State) -> Innovation:
        """Return the innovation of each track, S = Hx P Hx^T + c Hf Hf^T + I."""
        self._fresh = r, Hx, Hf, Hc = self._rows_of_state(state)
        m, n = self.observed.seen.shape

        # 1. Clones: P Hx^T for all tracks at once, one clone after the other, (n, 6n, 3m); then Hx P Hx^T.
        P = state.cov[state.window, state.window].reshape(n, CLONE, n, CLONE)
        PH = P.transpose(2, 0, 1, 3).reshape(n, CLONE * n, CLONE) @ Hx.transpose(1, 3, 0, 2).reshape(n, CLONE, 3 * m)
        PH = PH.reshape(n, n, CLONE, m, 3).transpose(3, 1, 2, 0, 4).reshape(m, n, CLONE, 3 * n)
        S = (Hx @ PH).reshape(m, 3 * n, 3 * n)

        # 2. Extrinsics: + Hc P_cx Hx^T + (Hc P_cx Hx^T)^T + Hc P_cc Hc^T.
        if Hc.shape[-1]:
            c, at = Hc.shape[-1], state.extrinsics_part
            P_cx = state.cov[at, state.window].reshape(c, n, CLONE).transpose(1, 0, 2)
            PH = np.einsum("ncj,mnkj->mcnk", P_cx, Hx).reshape(m, c, 3 * n)
            flat_c = Hc.reshape(m, 3 * n, c)
            half = flat_c @ (PH + 0.5 * state.cov[at, at] @ np.swapaxes(flat_c, 1, 2))
            S += half + np.swapaxes(half, 1, 2)

        # 3. Point: + c Hf Hf^T with a wide prior, which costs it its three degrees of freedom.
        flat = Hf.reshape(m, 3 * n, 3)
        S += POINT_PRIOR * flat @ np.swapaxes(flat, 1, 2)
        return Innovation.of(r.reshape(m, 3 * n), S, self.observed.row_counts - POINT_UNKNOWNS)

    def linearise(self, state: State, total: Information) -> None:
        """Add the projected L, H^T r and r^T r to ``total``, with Huber's weights."""
        r, Hx, Hf, Hc = self._fresh or self._rows_of_state(state)
        self._fresh = None
        scale = robust_scale(r)
        r, Hx, Hf, Hc = r * scale, Hx * scale[..., None], Hf * scale[..., None], Hc * scale[..., None]
        m, n = self.observed.seen.shape
        at, extrinsics, window = state.camera_poses_part, state.extrinsics_part, state.window

        # 1. Clones: Hx^T Hx is block-diagonal, since an observation depends on its own clone only.
        by_clone = np.swapaxes(Hx, 0, 1).reshape(n, 3 * m, CLONE)
        by_clone_T = np.swapaxes(by_clone, 1, 2)
        blocks = by_clone_T @ by_clone
        for k in range(n):
            own = state.clone_slice(k)
            total.L[own, own] += blocks[k]
        total.gradient[window] += (by_clone_T @ np.swapaxes(r, 0, 1).reshape(n, 3 * m, 1)).ravel()
        cross = np.swapaxes(np.swapaxes(Hx, -1, -2) @ Hf, 0, 1)  # (n, M, 6, 3)
        cross = np.swapaxes(cross, 1, 2).reshape(CLONE * n, m, 3)

        # 2. Extrinsics: Hc^T Hc, Hx^T Hc and Hc^T r, and the rows of Hc^T Hf above those of Hx^T Hf.
        if Hc.shape[-1]:
            flat_c = Hc.reshape(3 * m * n, -1)
            total.L[extrinsics, extrinsics] += flat_c.T @ flat_c
            mixed = (by_clone_T @ np.swapaxes(Hc, 0, 1).reshape(n, 3 * m, -1)).reshape(CLONE * n, -1)
            total.L[window, extrinsics] += mixed
            total.L[extrinsics, window] += mixed.T
            total.gradient[extrinsics] += flat_c.T @ r.ravel()
            cross = np.concatenate([np.einsum("mnkc,mnkj->cmj", Hc, Hf, optimize=True), cross])

        # 3. Project the points out: L -= (Hx^T Hf) A^-1 (Hx^T Hf)^T, b -= (Hx^T Hf) A^-1 g, A = Hf^T Hf, g = Hf^T r.
        flat, r_flat = Hf.reshape(m, 3 * n, 3), r.reshape(m, 3 * n, 1)
        flat_T = np.swapaxes(flat, 1, 2)
        A_inv: Float = np.asarray(np.linalg.inv(flat_T @ flat), dtype=np.float64)
        g = (flat_T @ r_flat)[..., 0]
        cross_A_inv = np.einsum("cmi,mij->cmj", cross, A_inv).reshape(len(cross), -1)
        total.L[at, at] -= cross_A_inv @ cross.reshape(len(cross), -1).T
        total.gradient[at] -= cross_A_inv @ g.ravel()
        total.cost += float(np.sum(r * r))
        self._last = _Linearisation(flat, scale, A_inv, cross, g, at)

    def cost(self, state: State) -> float:
        """Return r^T r at the state's present value; also update g = Hf^T r for the next ``follow``."""
        last = self.linearisation()
        r = residuals(self.points_W, Poses.of(state), self.observed, self.camera) * last.scale
        last.g = (np.swapaxes(last.Hf, 1, 2) @ r.reshape(len(self), -1, 1))[..., 0]
        return float(np.sum(r * r))

    def back_substitute(self, step: Float) -> Float:
        """Move the points by A^-1 (g - Hf^T Hx step), back-substitution; return their positions before."""
        last, kept = self.linearisation(), self.points_W
        rhs = last.g - np.einsum("cmi,c->mi", last.cross, step[last.at])
        self.points_W = kept + (last.A_inv @ rhs[..., None])[..., 0]
        return kept

    def restore(self, kept: Float) -> None:
        """Put the points back."""
        self.points_W = kept

    def linearisation(self) -> _Linearisation:
        """Return the last linearisation; RuntimeError before the first."""
        if self._last is None:
            raise RuntimeError("tracks must be linearised before their points can be moved")
        return self._last


def promote(state: State, features: ProjectedTracks, chosen: NDArray[np.bool_]) -> None:
    """Make the points of ``chosen`` tracks, with which the state has just been updated, landmarks of the state.

    A point's error is f = -A^-1 Hf^T Hx x + n with A = Hf^T Hf and cov(n) = A^-1. That noise is independent of the rows
    that the update has used: they are those of the left null space of Hf.
    """
    picked = features.pick(chosen)
    picked.linearise(state, Information.none(state.size))
    picked.back_substitute(np.zeros(state.size))
    last = picked.linearisation()
    r_f_x = np.zeros((len(picked), LANDMARK, state.size))
    r_f_x[..., last.at] = -last.A_inv @ np.transpose(last.cross, (1, 2, 0))
    state.add_landmarks(picked.ids, picked.points_W, r_f_x, last.A_inv)
