"""Tracks whose points are projected out, as a measurement on the window's clones.

The error of a point is removed through the normal equations, which for the information is the same as the null space
of its Jacobian [Mourikis07]: L = sum Hx^T Hx - (Hx^T Hf) (Hf^T Hf)^-1 (Hf^T Hx).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import Information
from snakeslam.estimation.filter.state import CLONE, LANDMARK, State
from snakeslam.estimation.measurements.camera import (
    CameraRows,
    Observations,
    Poses,
    all_jacobians,
    residuals,
    robust_scale,
)
from snakeslam.estimation.measurements.triangulation import triangulate
from snakeslam.messages import Float

POINT_PRIOR = 1e4
POINT_UNKNOWNS = 3


@dataclass(slots=True)
class _Linear:
    """Rows at one linearisation with robust weights ``scale`` (M, n, 1): ``Hf`` (M, 3n, 3), ``g`` = Hf^T r (M, 3),

    ``A_inv`` = (Hf^T Hf)^-1 (M, 3, 3), ``cross`` = Hx^T Hf (c + 6n, M, 3).
    """

    Hf: Float
    scale: Float
    A_inv: Float
    cross: Float
    g: Float
    at: slice
    """Where the errors of ``cross`` stand: the camera's place and the window."""


@dataclass(slots=True)
class Features:
    """M points seen from the window: ``ids`` (M,), ``points_W`` (M, 3)."""

    ids: NDArray[np.int64]
    observed: Observations
    points_W: Float
    rows: CameraRows
    _now: _Linear | None = field(default=None)
    _fresh: tuple[Float, Float, Float, Float] | None = field(default=None)
    """r, Hx, Hf, Hc for the linearisation that follows the gate, where neither state nor points have moved."""

    @staticmethod
    def of(ids: NDArray[np.int64], observed: Observations, state: State, rows: CameraRows) -> "Features":
        """Triangulate tracks from the window and keep what is well determined."""
        if not len(ids):
            return Features(ids, observed, np.empty((0, 3)), rows)
        points, good = triangulate(Poses.of(state), observed.at_middle(state.mount), rows)
        good &= observed.row_counts > POINT_UNKNOWNS
        return Features(ids, observed, points, rows).pick(good)

    def __len__(self) -> int:
        return len(self.ids)

    def pick(self, chosen: NDArray[np.bool_]) -> "Features":
        """Return some of them."""
        picked = Features(self.ids[chosen], self.observed.pick(chosen), self.points_W[chosen], self.rows)
        if self._fresh is not None:
            r, Hx, Hf, Hc = self._fresh
            picked._fresh = r[chosen], Hx[chosen], Hf[chosen], Hc[chosen]
        return picked

    def _rows_of_state(self, state: State) -> tuple[Float, Float, Float, Float]:
        """Return whitened residuals (M, n, 3) and Jacobians (M, n, 3, 6), (M, n, 3, 3), (M, n, 3, c)."""
        r = residuals(self.points_W, Poses.of(state), self.observed, self.rows)
        return r, *all_jacobians(self.points_W, Poses.first_of(state), self.observed, self.rows)

    def innovation(self, state: State) -> Innovation:
        """Return how far each is from what the state foresees, S = Hx P Hx^T + c Hf Hf^T + I.

        The point is given a wide prior, c, in place of a projection.
        """
        self._fresh = r, Hx, Hf, Hc = self._rows_of_state(state)
        m, n = self.observed.seen.shape
        P = state.cov[state.window, state.window].reshape(n, CLONE, n, CLONE)
        # P H^T for all features at once, one clone b after the other: (n, 6n, 3m).
        PH = P.transpose(2, 0, 1, 3).reshape(n, CLONE * n, CLONE) @ Hx.transpose(1, 3, 0, 2).reshape(n, CLONE, 3 * m)
        PH = PH.reshape(n, n, CLONE, m, 3).transpose(3, 1, 2, 0, 4).reshape(m, n, CLONE, 3 * n)
        S = (Hx @ PH).reshape(m, 3 * n, 3 * n)
        if Hc.shape[-1]:
            S += _by_camera(state, Hx, Hc)
        flat = Hf.reshape(m, 3 * n, 3)
        S += POINT_PRIOR * flat @ np.swapaxes(flat, 1, 2)
        return Innovation.of(r.reshape(m, 3 * n), S, self.observed.row_counts - POINT_UNKNOWNS)

    def linearise(self, state: State, total: Information) -> None:
        """Add the projected rows to ``total``."""
        r, Hx, Hf, Hc = self._fresh or self._rows_of_state(state)
        self._fresh = None
        scale = robust_scale(r)
        r, Hx, Hf, Hc = r * scale, Hx * scale[..., None], Hf * scale[..., None], Hc * scale[..., None]
        m, n = self.observed.seen.shape
        at, by_clone = state.view, np.swapaxes(Hx, 0, 1)
        stacked = by_clone.reshape(n, 3 * m, CLONE)
        blocks = np.swapaxes(stacked, 1, 2) @ stacked
        for k in range(n):
            own = state.clone_slice(k)
            total.L[own, own] += blocks[k]
        by_pose = np.swapaxes(stacked, 1, 2)
        total.gradient[state.window] += (by_pose @ np.swapaxes(r, 0, 1).reshape(n, 3 * m, 1)).ravel()
        cross = np.swapaxes(np.swapaxes(Hx, -1, -2) @ Hf, 0, 1)  # (n, M, 6, 3)
        cross = np.swapaxes(cross, 1, 2).reshape(CLONE * n, m, 3)
        if Hc.shape[-1]:
            cross = np.concatenate([_add_camera(state, total, by_pose, r, Hc, Hf), cross])
        flat, r_flat = Hf.reshape(m, 3 * n, 3), r.reshape(m, 3 * n, 1)
        flat_T = np.swapaxes(flat, 1, 2)
        A_inv: Float = np.asarray(np.linalg.inv(flat_T @ flat), dtype=np.float64)
        g = (flat_T @ r_flat)[..., 0]
        narrow = np.einsum("cmi,mij->cmj", cross, A_inv).reshape(len(cross), -1)
        total.L[at, at] -= narrow @ cross.reshape(len(cross), -1).T
        total.gradient[at] -= narrow @ g.ravel()
        total.cost += float(np.sum(r * r))
        self._now = _Linear(flat, scale, A_inv, cross, g, at)

    def cost(self, state: State) -> float:
        """Return the cost; notes the gradient on the points."""
        now = self.linear()
        r = residuals(self.points_W, Poses.of(state), self.observed, self.rows) * now.scale
        now.g = (np.swapaxes(now.Hf, 1, 2) @ r.reshape(len(self), -1, 1))[..., 0]
        return float(np.sum(r * r))

    def follow(self, step: Float) -> Float:
        """Move the points by A^-1 (g - cross^T step)."""
        now, kept = self.linear(), self.points_W
        rhs = now.g - np.einsum("cmi,c->mi", now.cross, step[now.at])
        self.points_W = kept + (now.A_inv @ rhs[..., None])[..., 0]
        return kept

    def go_back(self, kept: Float) -> None:
        """Put the points back."""
        self.points_W = kept

    def linear(self) -> _Linear:
        """Return the last linearisation; RuntimeError before the first."""
        if self._now is None:
            raise RuntimeError("features are linearised before their points follow")
        return self._now


def _by_camera(state: State, Hx: Float, Hc: Float) -> Float:
    """Return what an uncertain place of the camera adds to Hx P Hx^T, (M, 3n, 3n)."""
    m, n = Hx.shape[:2]
    c, place = Hc.shape[-1], state.camera_place
    P_cx = state.cov[place, state.window].reshape(c, n, CLONE).transpose(1, 0, 2)
    PH = np.einsum("ncj,mnkj->mcnk", P_cx, Hx).reshape(m, c, 3 * n)
    flat = Hc.reshape(m, 3 * n, c)
    mixed = flat @ (PH + 0.5 * state.cov[place, place] @ np.swapaxes(flat, 1, 2))
    return mixed + np.swapaxes(mixed, 1, 2)


def _add_camera(state: State, total: Information, by_pose: Float, r: Float, Hc: Float, Hf: Float) -> Float:
    """Add the rows of the camera's place to ``total``, before points are projected out; return Hc^T Hf (c, M, 3).

    ``by_pose`` (n, 6, 3M) are the transposed Jacobians by the clones.
    """
    m, n = r.shape[:2]
    place, window = state.camera_place, state.window
    flat = Hc.reshape(3 * m * n, -1)
    total.L[place, place] += flat.T @ flat
    mixed = (by_pose @ np.swapaxes(Hc, 0, 1).reshape(n, 3 * m, -1)).reshape(CLONE * n, -1)
    total.L[window, place] += mixed
    total.L[place, window] += mixed.T
    total.gradient[place] += flat.T @ r.ravel()
    return np.einsum("mnkc,mnkj->cmj", Hc, Hf, optimize=True)


def promote(state: State, features: Features, chosen: NDArray[np.bool_]) -> None:
    """Make landmarks of some features that the state has just been updated with.

    The error of a point is -A^-1 cross^T x plus noise of covariance A^-1, which is independent of what the update used.
    """
    picked = features.pick(chosen)
    picked.linearise(state, Information.none(state.size))
    picked.follow(np.zeros(state.size))
    now = picked.linear()
    r_f_x = np.zeros((len(picked), LANDMARK, state.size))
    r_f_x[..., now.at] = -now.A_inv @ np.transpose(now.cross, (1, 2, 0))
    state.add_landmarks(picked.ids, picked.points_W, r_f_x, now.A_inv)
