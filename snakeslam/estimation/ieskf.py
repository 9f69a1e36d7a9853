"""The iterated error-state Kalman update, in information form.

Eq. (41) with the iteration that the paper announces but does not print: from x_0 = x^,
x_{j+1} = x^ [+] P H^T (H P H^T + I)^-1 (r_j + H d_j), r_j = z - h(x_j), d_j = x_j [-] x^, until the step is small
or the cost rises; then P is reduced once. With L = H^T H and b = H^T (r_j + H d_j) the step is P_:m (I + L P_mm)^-1 b,
where m are the errors of clones and landmarks. Jacobians are taken at first estimates, so only residuals and
weights change.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from snakeslam.estimation.measurements import (
    CameraRows,
    Observations,
    Poses,
    jacobians,
    residuals,
    robust_scale,
    triangulate,
)
from snakeslam.estimation.state import CLONE, CORE, LANDMARK, Landmark, State
from snakeslam.estimation.tracks import Track
from snakeslam.messages import Float

GATE_QUANTILE = 0.99
POINT_PRIOR = 1e4
SMALL_STEP = 1e-5
LINEAR = 0.01
"""A first step that brings the cost that the linear model foresees, to this part, needs no second."""
CHI2: Float = np.asarray(chi2.ppf(GATE_QUANTILE, np.arange(1, 200)), dtype=np.float64)


@dataclass(slots=True)
class Features:
    """Tracks whose points are estimated and projected out: M points seen from the window."""

    tracks: list[Track]
    observed: Observations
    points_W: Float

    @staticmethod
    def of(tracks: Sequence[Track], state: State, rows: CameraRows) -> "Features":
        """Triangulate tracks from the window and keep what is well determined and passes the gate."""
        observed = Observations.of(tracks, [c.t_ns for c in state.clones], rows)
        points, good = triangulate(Poses.of(state), observed, rows)
        kept = Features([t for t, ok in zip(tracks, good, strict=True) if ok], observed.pick(good), points[good])
        return kept.pick(kept.within_gate(state, rows)) if kept.tracks else kept

    def pick(self, chosen: NDArray[np.bool_]) -> "Features":
        """Return some of them."""
        tracks = [t for t, ok in zip(self.tracks, chosen, strict=True) if ok]
        return Features(tracks, self.observed.pick(chosen), self.points_W[chosen])

    def within_gate(self, state: State, rows: CameraRows) -> NDArray[np.bool_]:
        """Return which tracks agree with the state by their Mahalanobis distance, (M,).

        The point is given a wide prior in place of a projection.
        """
        r = residuals(self.points_W, Poses.of(state), self.observed, rows)
        Hx, Hf = jacobians(self.points_W, Poses.first_of(state), self.observed, rows)
        m, n = self.observed.seen.shape
        window = slice(CORE, CORE + CLONE * n)
        P = state.cov[window, window].reshape(n, CLONE, n, CLONE)
        PH = np.einsum("aibj,mbkj->maibk", P, Hx, optimize=True)
        S = np.einsum("mali,maibk->malbk", Hx, PH, optimize=True).reshape(m, 3 * n, 3 * n)
        flat = Hf.reshape(m, 3 * n, 3)
        S += POINT_PRIOR * flat @ np.swapaxes(flat, 1, 2) + np.eye(3 * n)
        e = r.reshape(m, 3 * n)
        distance = np.einsum("mi,mi->m", e, np.linalg.solve(S, e[..., None])[..., 0])
        count = np.sum(self.observed.weight > 0.0, axis=(1, 2))
        return np.asarray((count > 3) & (distance < CHI2[np.clip(count - 3, 1, 199) - 1]))


@dataclass(slots=True)
class LandmarkSightings:
    """Landmarks of the state (by index) seen from the newest clone: ``xyz`` (L, 1, 3)."""

    index: NDArray[np.int64]
    observed: Observations

    @staticmethod
    def none() -> "LandmarkSightings":
        """Return an empty set."""
        nothing = Observations(np.empty((0, 1, 3)), np.empty((0, 1), bool), np.empty((0, 1, 3)))
        return LandmarkSightings(np.empty(0, np.int64), nothing)

    def pick(self, chosen: NDArray[np.bool_]) -> "LandmarkSightings":
        """Return some of them."""
        return LandmarkSightings(self.index[chosen], self.observed.pick(chosen))

    def points(self, state: State) -> Float:
        """Return their present positions, (L, 3)."""
        return np.array([state.landmarks[k].p_W for k in self.index]).reshape(-1, 3)

    def first_points(self, state: State) -> Float:
        """Return their first estimates, (L, 3)."""
        return np.array([state.landmarks[k].p_fej for k in self.index]).reshape(-1, 3)

    def within_gate(self, state: State, rows: CameraRows) -> NDArray[np.bool_]:
        """Return which sightings agree with the state, (L,)."""
        newest = len(state.clones) - 1
        r = residuals(self.points(state), Poses.of(state).pick(newest), self.observed, rows)[:, 0]
        Hx, Hf = jacobians(self.first_points(state), Poses.first_of(state).pick(newest), self.observed, rows)
        pose = np.arange(CLONE) + state.clone_slice(newest).start
        own = np.arange(LANDMARK) + (state.landmark_slice(0).start + LANDMARK * self.index)[:, None]
        where = np.hstack([np.broadcast_to(pose, (len(own), CLONE)), own])
        P = state.cov[where[:, :, None], where[:, None, :]]
        H = np.concatenate([Hx[:, 0], Hf[:, 0]], axis=-1)
        S = H @ P @ np.swapaxes(H, 1, 2) + np.eye(3)
        distance = np.sum(r * np.linalg.solve(S, r[..., None])[..., 0], axis=-1)
        count = np.sum(self.observed.weight[:, 0] > 0.0, axis=-1)
        return np.asarray(distance < CHI2[np.maximum(count, 1) - 1])


@dataclass(slots=True)
class _Linear:
    """One linearisation: information, H^T r, cost, and what gives the points' steps back."""

    information: Float
    gradient: Float
    cost: float
    cross: Float
    A: Float
    g: Float


def update(
    state: State, features: Features, sightings: LandmarkSightings, rows: CameraRows, max_iterations: int
) -> int:
    """Take camera rows into the state, in place, by Eq. (41); return the number of iterations."""
    if not features.tracks and not len(sightings.index):
        return 0
    prior = copy_nominal(state)
    columns = state.cov[:, CORE:]
    P_mm = columns[CORE:]
    d = np.zeros(state.size)
    now = _linearise(state, features, sightings, rows)
    best = now.cost
    rounds = 0
    for rounds in range(1, max_iterations + 1):
        before, points = copy_nominal(state), features.points_W
        b = now.gradient + now.information @ d[CORE:]
        y_new = np.linalg.solve(np.eye(len(b)) + now.information @ P_mm, b)
        d_new = columns @ y_new
        step = d_new - d
        restore_nominal(state, prior)
        state.plus(d_new)
        features.points_W = points + _point_steps(now, step)
        after = _linearise(state, features, sightings, rows)
        cost = after.cost + float(y_new @ P_mm @ y_new)
        if cost > best * (1.0 + 1e-9):
            restore_nominal(state, before)
            features.points_W = points
            break
        foreseen = best - float(now.gradient @ step[CORE:])
        best, d, now = cost, d_new, after
        linear = rounds == 1 and abs(cost - foreseen) < LINEAR * cost
        if linear or np.linalg.norm(step) < SMALL_STEP * np.sqrt(len(step)):
            break
    state.reduce_covariance(np.arange(CORE, state.size), now.information)
    features.points_W = features.points_W + _point_steps(now, np.zeros(state.size))
    return rounds


def promote(state: State, features: Features, chosen: NDArray[np.bool_], rows: CameraRows) -> None:
    """Make landmarks of some features that the state has just been updated with.

    The error of a point is -A^-1 cross^T x plus noise of covariance A^-1, which is independent of what the update used.
    """
    now = _linearise(state, features.pick(chosen), LandmarkSightings.none(), rows)
    picked = features.pick(chosen)
    for row, track in enumerate(picked.tracks):
        cov = np.linalg.inv(now.A[row])
        r_f_x = np.zeros((3, state.size))
        r_f_x[:, CORE : CORE + now.cross.shape[1]] = -cov @ now.cross[row].T
        point = picked.points_W[row]
        state.add_landmark(Landmark(track.track_id, point, point), r_f_x, cov)


def _linearise(state: State, features: Features, sightings: LandmarkSightings, rows: CameraRows) -> _Linear:
    size = state.size - CORE
    information, gradient = np.zeros((size, size)), np.zeros(size)
    clones = CLONE * len(state.clones)
    cost, cross, A, g = 0.0, np.zeros((0, clones, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3))
    if features.tracks:
        cost, cross, A, g = _add_features(information[:clones, :clones], gradient[:clones], state, features, rows)
    if len(sightings.index):
        cost += _add_sightings(information, gradient, state, sightings, rows)
    return _Linear(information, gradient, cost, cross, A, g)


def _add_features(
    information: Float, gradient: Float, state: State, features: Features, rows: CameraRows
) -> tuple[float, Float, Float, Float]:
    r = residuals(features.points_W, Poses.of(state), features.observed, rows)
    scale = robust_scale(r)
    Hx, Hf = jacobians(features.points_W, Poses.first_of(state), features.observed, rows)
    r, Hx, Hf = r * scale, Hx * scale[..., None], Hf * scale[..., None]
    m, n = features.observed.seen.shape
    blocks = np.einsum("mnki,mnkj->nij", Hx, Hx, optimize=True)
    for k in range(n):
        at = slice(CLONE * k, CLONE * (k + 1))
        information[at, at] += blocks[k]
    gradient += np.einsum("mnki,mnk->ni", Hx, r).ravel()
    cross = np.einsum("mnki,mnkj->mnij", Hx, Hf).reshape(m, CLONE * n, 3)
    A = np.einsum("mnki,mnkj->mij", Hf, Hf)
    g = np.einsum("mnki,mnk->mi", Hf, r)
    A_inv = np.linalg.inv(A)
    wide = np.moveaxis(cross, 0, 1).reshape(CLONE * n, -1)
    narrow = np.moveaxis(cross @ A_inv, 0, 1).reshape(CLONE * n, -1)
    information -= narrow @ wide.T
    gradient -= narrow @ g.ravel()
    return float(np.sum(r**2)), cross, A, g


def _add_sightings(
    information: Float, gradient: Float, state: State, sightings: LandmarkSightings, rows: CameraRows
) -> float:
    newest = len(state.clones) - 1
    r = residuals(sightings.points(state), Poses.of(state).pick(newest), sightings.observed, rows)
    scale = robust_scale(r)
    Hx, Hf = jacobians(sightings.first_points(state), Poses.first_of(state).pick(newest), sightings.observed, rows)
    r, Hx, Hf = (r * scale)[:, 0], (Hx * scale[..., None])[:, 0], (Hf * scale[..., None])[:, 0]
    at = slice(CLONE * newest, CLONE * (newest + 1))
    information[at, at] += np.einsum("mki,mkj->ij", Hx, Hx)
    gradient[at] += np.einsum("mki,mk->i", Hx, r)
    own = np.arange(LANDMARK) + (CLONE * len(state.clones) + LANDMARK * sightings.index)[:, None]
    pose = np.arange(at.start, at.stop)
    cross = np.swapaxes(Hx, 1, 2) @ Hf
    information[pose[None, :, None], own[:, None, :]] += cross
    information[own[:, :, None], pose[None, None, :]] += np.swapaxes(cross, 1, 2)
    information[own[:, :, None], own[:, None, :]] += np.swapaxes(Hf, 1, 2) @ Hf
    gradient[own] += np.einsum("mki,mk->mi", Hf, r)
    return float(np.sum(r**2))


def _point_steps(now: _Linear, step: Float) -> Float:
    """Return how the projected points follow a step of the state: A^-1 (g - cross^T step), (M, 3)."""
    if not len(now.A):
        return np.zeros((0, 3))
    clones = now.cross.shape[1]
    rhs = now.g - np.einsum("mci,c->mi", now.cross, step[CORE : CORE + clones])
    return np.linalg.solve(now.A, rhs[..., None])[..., 0]


@dataclass(slots=True)
class _Nominal:
    core: tuple[Float, Float, Float, Float, Float]
    clones: list[tuple[Float, Float]]
    landmarks: list[Float]


def copy_nominal(state: State) -> _Nominal:
    """Return the nominal values; arrays are replaced on change, never written to, so references will do."""
    return _Nominal(
        (copy(state.R_WI), state.p_WI, state.v_W, state.bias_g, state.bias_a),
        [(c.R_WI, c.p_WI) for c in state.clones],
        [m.p_W for m in state.landmarks],
    )


def restore_nominal(state: State, nominal: _Nominal) -> None:
    """Put nominal values back."""
    state.R_WI, state.p_WI, state.v_W, state.bias_g, state.bias_a = nominal.core
    for clone, (R_WI, p_WI) in zip(state.clones, nominal.clones, strict=True):
        clone.R_WI, clone.p_WI = R_WI, p_WI
    for landmark, p_W in zip(state.landmarks, nominal.landmarks, strict=True):
        landmark.p_W = p_W
