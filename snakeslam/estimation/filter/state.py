"""The filter's state on its manifold: IMU, camera extrinsics, a window of clones, landmarks; one covariance for all.

The error is (theta, p, v, b_g, b_a | estimated part of the camera's extrinsics | theta, p of each clone | p of each
landmark), with R_true = R Exp(theta); all others add. Beside each value stands its first estimate (``_fej``), where the
Jacobians are taken, so that the filter gains no information along unobservable directions, position and yaw [Huang10].
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.filter.extrinsics import Extrinsics
from snakeslam.estimation.filter.preintegration import ALPHA, BETA, Preintegrated
from snakeslam.estimation.filter.preintegration import GAMMA as GAMMA_ROWS
from snakeslam.estimation.filter.state_parts import Clones, Landmarks
from snakeslam.estimation.filter.submatrices import submatrix
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float

THETA, P, V, BIAS_G, BIAS_A = (slice(3 * k, 3 * k + 3) for k in range(5))
BIASES = slice(BIAS_G.start, BIAS_A.stop)
POSE = slice(THETA.start, P.stop)
CORE = 15
CLONE = 6
LANDMARK = 3
UP = np.array([0.0, 0.0, 1.0])
STATE_ORDER = np.r_[GAMMA_ROWS, ALPHA, BETA, BIASES]
"""Indices of the pre-integrated error (alpha, beta, theta, biases) in the order of the state (theta, p, v, biases)."""


Nominal = tuple[Float, Float, Float, Float, Float, Extrinsics | None, Float, Float, Float]
"""R_WI, p_WI, v_W, biases, extrinsics, R_WI and p_WI of the clones, p_W of the landmarks; arrays never modified."""


@dataclass(slots=True)
class State:
    """Nominal state, first estimates and the covariance ``cov`` (size, size) of the error."""

    t_ns: int
    R_WI: Float
    p_WI: Float
    v_W: Float
    bias_g: Float
    bias_a: Float
    cov: Float
    clones: Clones = field(default_factory=Clones)
    landmarks: Landmarks = field(default_factory=Landmarks)
    extrinsics: Extrinsics | None = None
    """The camera's extrinsics and clock; None where they are taken from the calibration."""
    R_fej: Float = field(init=False)
    p_fej: Float = field(init=False)
    v_fej: Float = field(init=False)

    def __post_init__(self) -> None:
        self._fix_first_estimate()

    @property
    def T_WI(self) -> Float:
        """Pose of the IMU, (4, 4)."""
        return se3.from_rt(self.R_WI, self.p_WI)

    @property
    def size(self) -> int:
        """Length of the error state."""
        return self.window.stop + LANDMARK * len(self.landmarks)

    @property
    def time_offset_part(self) -> slice:
        """Slice of the error of the camera's time offset; empty when it is not estimated."""
        return slice(CORE, CORE + (self.extrinsics.time_size if self.extrinsics is not None else 0))

    @property
    def extrinsics_part(self) -> slice:
        """Slice of the errors of the camera's extrinsics and readout; empty when they are not estimated."""
        return slice(self.time_offset_part.stop, CORE + (self.extrinsics.size if self.extrinsics is not None else 0))

    @property
    def camera_poses_part(self) -> slice:
        """Slice of the errors of all camera poses: extrinsics and readout, then the window of clones."""
        return slice(self.extrinsics_part.start, self.window.stop)

    def clone_slice(self, k: int) -> slice:
        """Return the slice of the error of clone ``k``."""
        start = self.extrinsics_part.stop + CLONE * k
        return slice(start, start + CLONE)

    @property
    def window(self) -> slice:
        """Slice of the errors of all clones."""
        start = self.extrinsics_part.stop
        return slice(start, start + CLONE * len(self.clones))

    def landmark_rows(self, index: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the indices of the errors of landmarks ``index`` (L,), (L, 3)."""
        return self.window.stop + LANDMARK * index[:, None] + np.arange(LANDMARK)

    def _fix_first_estimate(self) -> None:
        self.R_fej, self.p_fej, self.v_fej = self.R_WI, self.p_WI, self.v_W

    # -- Propagation --------------------------------------------------------------------------------------------------

    def propagate(self, pre: Preintegrated, t_ns: int, gravity_W: Float) -> None:
        """Propagate mean and covariance of the IMU state to ``t_ns`` by a pre-integrated measurement."""
        alpha, beta, gamma = pre.corrected(self.bias_g, self.bias_a)
        dt = pre.dt_s

        # 1. Mean, Eq. (25): p' = p + v dt + g dt^2 / 2 + R alpha, v' = v + g dt + R beta, R' = R gamma.
        R, p, v = self.R_WI, self.p_WI, self.v_W
        self.R_WI = R @ gamma
        self.p_WI = p + v * dt + 0.5 * gravity_W * dt**2 + R @ alpha
        self.v_W = v + gravity_W * dt + R @ beta

        # 2. Error transition [Forster17]. R alpha and R beta are replaced by the differences of the first estimates at
        #    both ends, D = p' - p - v dt - g dt^2 / 2 and E = v' - v - g dt: then the product of successive transitions
        #    keeps position and yaw unobservable [Huang10].
        #      theta' = R'^T R theta + J_gamma b
        #      p'     = p + v dt - [D]x R theta + R J_alpha b
        #      v'     = v - [E]x R theta + R J_beta b
        R = self.R_fej
        Phi = np.eye(CORE)
        Phi[THETA, THETA] = self.R_WI.T @ R
        Phi[P, THETA] = -so3.hat(self.p_WI - self.p_fej - self.v_fej * dt - 0.5 * gravity_W * dt**2) @ R
        Phi[V, THETA] = -so3.hat(self.v_W - self.v_fej - gravity_W * dt) @ R
        Phi[P, V] = np.eye(3) * dt
        Phi[THETA, BIASES] = pre.J[GAMMA_ROWS]
        Phi[P, BIASES] = R @ pre.J[ALPHA]
        Phi[V, BIASES] = R @ pre.J[BETA]

        # 3. Covariance: P <- Phi P Phi^T + G Q G^T, where G rotates the noise of alpha and beta into W. The covariance
        #    of everything else stays, its correlations with the IMU state change.
        G = np.eye(CORE)
        G[P, P] = G[V, V] = R
        cov = self.cov
        cov[:CORE] = Phi @ cov[:CORE]
        cov[:, :CORE] = cov[:, :CORE] @ Phi.T
        cov[:CORE, :CORE] += G @ pre.cov[np.ix_(STATE_ORDER, STATE_ORDER)] @ G.T
        cov[:CORE, :CORE] = 0.5 * (cov[:CORE, :CORE] + cov[:CORE, :CORE].T)
        self.t_ns = t_ns
        self._fix_first_estimate()

    def inflate(self, rows: slice, variance: float) -> None:
        """Add ``variance`` to each component of a part of the error, for effects outside of the noise model."""
        self.cov[rows, rows] += np.eye(rows.stop - rows.start) * variance

    def inflate_motion(self, variance_theta: float, variance_v: float, lag_s: float) -> None:
        """Add errors of rotation and velocity that arose ``lag_s`` ago; the position has drifted by dv lag since."""
        eye = np.eye(3)
        self.cov[THETA, THETA] += eye * variance_theta
        self.cov[V, V] += eye * variance_v
        self.cov[P, P] += eye * (variance_v * lag_s**2)
        self.cov[P, V] += eye * (variance_v * lag_s)
        self.cov[V, P] += eye * (variance_v * lag_s)

    def inflate_landmarks(self, variance: Float) -> None:
        """Add ``variance`` (L,) m^2 to all axes of each landmark, for a track that drifts over the surface."""
        rows = np.arange(self.window.stop, self.size)
        self.cov[rows, rows] += np.repeat(variance, LANDMARK)

    def make_origin(self, yaw_rad: float, p_W: Float) -> None:
        """Define W by the present pose: yaw and position become exact, all other errors relative to them.

        With the yaw's error s = e_z^T R_WI theta: theta_i <- theta_i - R_i^T e_z s, p_i <- p_i - p - e_z x (p_i - p) s,
        v <- v - e_z x v s; then everything is rotated about z and shifted, so that the pose is at ``yaw_rad``, ``p_W``.
        """
        A = np.eye(self.size)
        r_yaw_x = np.zeros(self.size)
        r_yaw_x[THETA] = UP @ self.R_WI
        clone_rotations = ((self.clone_slice(k).start, R) for k, R in enumerate(self.clones.R_WI))
        for at, R_i in ((THETA.start, self.R_WI), *clone_rotations):
            A[at : at + 3] -= np.outer(R_i.T @ UP, r_yaw_x)
        R = so3.from_yaw(yaw_rad - float(so3.yaw(self.R_WI)))
        for at, vector, is_point in self._vectors():
            A[at : at + 3] -= np.outer(np.cross(UP, vector - is_point * self.p_WI), r_yaw_x)
            A[at : at + 3, P] -= is_point * np.eye(3)
            A[at : at + 3] = R @ A[at : at + 3]
        self.cov = A @ self.cov @ A.T
        t = p_W - R @ self.p_WI
        clones, landmarks = self.clones, self.landmarks
        self.R_WI, self.p_WI, self.v_W = R @ self.R_WI, R @ self.p_WI + t, R @ self.v_W
        self.R_fej, self.p_fej, self.v_fej = R @ self.R_fej, R @ self.p_fej + t, R @ self.v_fej
        clones.R_WI, clones.R_fej = R @ clones.R_WI, R @ clones.R_fej
        clones.p_WI, clones.p_fej = clones.p_WI @ R.T + t, clones.p_fej @ R.T + t
        landmarks.p_W, landmarks.p_fej = landmarks.p_W @ R.T + t, landmarks.p_fej @ R.T + t

    def _vectors(self) -> list[tuple[int, Float, float]]:
        """Return the index of the error of each vector in W, its value, and 1 for a point or 0 for a free vector."""
        clones = [(self.clone_slice(k).start + 3, p_WI, 1.0) for k, p_WI in enumerate(self.clones.p_WI)]
        points = [(self.window.stop + LANDMARK * k, p_W, 1.0) for k, p_W in enumerate(self.landmarks.p_W)]
        return [(P.start, self.p_WI, 1.0), (V.start, self.v_W, 0.0), *clones, *points]

    # -- Parts --------------------------------------------------------------------------------------------------------

    def add_extrinsics(self, extrinsics: Extrinsics, variance: Float) -> None:
        """Add the estimated part of the camera's extrinsics with variances (size,); before the first clone."""
        self.extrinsics = extrinsics
        n = len(self.cov)
        cov = np.zeros((n + extrinsics.size, n + extrinsics.size))
        cov[:n, :n] = self.cov
        cov[np.arange(n, len(cov)), np.arange(n, len(cov))] = variance
        self.cov = cov

    def add_clone(self, r_pose_t: Float | None = None) -> None:
        """Append the present pose to the window (stochastic cloning [Mourikis07]): P <- J P J^T.

        ``r_pose_t`` (6,) is d(theta, p)/dt: where the camera's time offset is estimated, its error moves the clone
        along, and only thus do measurements depend on it [Li14].
        """
        at = self.window.stop
        order = np.r_[0:at, POSE, at : self.size]
        self.cov = submatrix(self.cov, order, order)
        if r_pose_t is not None and self.time_offset_part.stop > CORE:
            clone = slice(at, at + CLONE)
            self.cov[clone] += np.outer(r_pose_t, self.cov[CORE])
            self.cov[:, clone] += np.outer(self.cov[:, CORE], r_pose_t)
        self.clones.append(self.t_ns, self.R_WI, self.p_WI, self.R_fej, self.p_fej)

    def drop_clone(self, k: int) -> None:
        """Marginalise clone ``k``."""
        kept = np.delete(np.arange(self.size), self.clone_slice(k))
        self.cov = submatrix(self.cov, kept, kept)
        self.clones.delete(k)

    def keep_landmarks(self, kept: NDArray[np.bool_]) -> None:
        """Marginalise the landmarks that are not ``kept`` (L,)."""
        if kept.all():
            return
        rows = np.concatenate([np.arange(self.window.stop), self.landmark_rows(np.flatnonzero(kept)).ravel()])
        self.cov = submatrix(self.cov, rows, rows)
        self.landmarks.keep(kept)

    def add_landmarks(self, ids: NDArray[np.int64], p_W: Float, r_f_x: Float, cov_ff: Float) -> None:
        """Append points (k, 3) whose errors are ``r_f_x`` (k, 3, size) times the state's error, plus noise.

        ``cov_ff`` (k, 3, 3) is the covariance of that noise, independent from point to point.
        """
        k = len(ids)
        cross = r_f_x.reshape(k * LANDMARK, -1) @ self.cov
        corner = cross @ r_f_x.reshape(k * LANDMARK, -1).T
        for row in range(k):
            own = slice(LANDMARK * row, LANDMARK * (row + 1))
            corner[own, own] += cov_ff[row]
        self.cov = np.block([[self.cov, cross.T], [cross, 0.5 * (corner + corner.T)]])
        self.landmarks.append(ids, p_W)

    # -- Correction ---------------------------------------------------------------------------------------------------

    def nominal(self) -> Nominal:
        """Return the nominal values, to be restored later."""
        clones = self.clones
        core = (self.R_WI, self.p_WI, self.v_W, self.bias_g, self.bias_a)
        return (*core, self.extrinsics, clones.R_WI, clones.p_WI, self.landmarks.p_W)

    def restore(self, nominal: Nominal) -> None:
        """Set the nominal values to earlier ones."""
        self.R_WI, self.p_WI, self.v_W, self.bias_g, self.bias_a = nominal[:5]
        self.extrinsics = nominal[5]
        self.clones.R_WI, self.clones.p_WI, self.landmarks.p_W = nominal[6:]

    def plus(self, dx: Float) -> None:
        """Apply an error to every part, in place: X <- X [+] dx, R <- R Exp(theta), all others add."""
        window = dx[self.window].reshape(-1, 2, 3)
        rotations = so3.exp(np.concatenate([dx[None, THETA], window[:, 0]]))
        self.R_WI = self.R_WI @ rotations[0]
        self.p_WI = self.p_WI + dx[P]
        self.v_W = self.v_W + dx[V]
        self.bias_g = self.bias_g + dx[BIAS_G]
        self.bias_a = self.bias_a + dx[BIAS_A]
        if self.extrinsics is not None:
            self.extrinsics = self.extrinsics.plus(dx[CORE : self.window.start])
        self.clones.R_WI = self.clones.R_WI @ rotations[1:]
        self.clones.p_WI = self.clones.p_WI + window[:, 1]
        self.landmarks.p_W = self.landmarks.p_W + dx[self.window.stop :].reshape(-1, LANDMARK)
