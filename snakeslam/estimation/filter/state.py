"""The filter's state on its manifold: IMU, a window of pose clones, landmarks; one covariance over their errors.

Errors are (theta, p, v, b_g, b_a | what is free of the camera's mount | theta, p of each clone | p of each
landmark), with R_true = R Exp(theta) and additive others. Beside each value stands its first estimate (``_fej``), where
Jacobians are taken, so that the filter does not gain information along directions that nobody observes [Huang10].
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.filter.blocks import part
from snakeslam.estimation.filter.extrinsics import Mount
from snakeslam.estimation.filter.preintegration import ALPHA, BETA, Preintegrated
from snakeslam.estimation.filter.preintegration import GAMMA as GAMMA_ROWS
from snakeslam.estimation.filter.state_parts import Clones, Landmarks
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float

THETA, P, V, BIAS_G, BIAS_A = (slice(3 * k, 3 * k + 3) for k in range(5))
BIASES = slice(BIAS_G.start, BIAS_A.stop)
POSE = slice(THETA.start, P.stop)
CORE = 15
CLONE = 6
LANDMARK = 3
UP = np.array([0.0, 0.0, 1.0])
# Rows of the summed error (alpha, beta, theta, biases) in the order of the state (theta, p, v, biases).
SUMS = np.r_[GAMMA_ROWS, ALPHA, BETA, BIASES]


Nominal = tuple[Float, Float, Float, Float, Float, Mount | None, Float, Float, Float]
"""R_WI, p_WI, v_W, biases, mount, then R_WI and p_WI of the clones, p_W of the landmarks; never written into."""


@dataclass(slots=True)
class State:
    """Nominal state, first estimates and covariance."""

    t_ns: int
    R_WI: Float
    p_WI: Float
    v_W: Float
    bias_g: Float
    bias_a: Float
    cov: Float
    clones: Clones = field(default_factory=Clones)
    landmarks: Landmarks = field(default_factory=Landmarks)
    mount: Mount | None = None
    """The camera on the IMU, None while its calibration is held."""
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
    def camera_time(self) -> slice:
        """Where the error of the camera's time stands; empty when it is held."""
        return slice(CORE, CORE + (self.mount.time_size if self.mount is not None else 0))

    @property
    def camera_place(self) -> slice:
        """Where the error of the camera's place on the IMU stands; empty when it is held."""
        return slice(self.camera_time.stop, CORE + (self.mount.size if self.mount is not None else 0))

    @property
    def view(self) -> slice:
        """Where all stands that says where a picture was taken from: the camera's place, then the window."""
        return slice(self.camera_place.start, self.window.stop)

    def clone_slice(self, k: int) -> slice:
        """Return where the error of clone ``k`` stands."""
        start = self.camera_place.stop + CLONE * k
        return slice(start, start + CLONE)

    @property
    def window(self) -> slice:
        """Where the errors of all clones stand."""
        start = self.camera_place.stop
        return slice(start, start + CLONE * len(self.clones))

    def landmark_rows(self, index: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return where the errors of landmarks ``index`` (L,) stand, (L, 3)."""
        return self.window.stop + LANDMARK * index[:, None] + np.arange(LANDMARK)

    def _fix_first_estimate(self) -> None:
        self.R_fej, self.p_fej, self.v_fej = self.R_WI, self.p_WI, self.v_W

    # -- Time ---------------------------------------------------------------------------------------------------------

    def propagate(self, pre: Preintegrated, t_ns: int, gravity_W: Float) -> None:
        """Move the IMU state by a pre-integrated measurement; the covariance follows with first-estimate Jacobians."""
        alpha, beta, gamma = pre.corrected(self.bias_g, self.bias_a)
        dt = pre.dt_s
        R, p, v = self.R_WI, self.p_WI, self.v_W
        self.R_WI = R @ gamma
        self.p_WI = p + v * dt + 0.5 * gravity_W * dt**2 + R @ alpha
        self.v_W = v + gravity_W * dt + R @ beta
        self._propagate_covariance(pre, gravity_W)
        self.t_ns = t_ns
        self._fix_first_estimate()

    def _propagate_covariance(self, pre: Preintegrated, gravity_W: Float) -> None:
        dt, R = pre.dt_s, self.R_fej
        Phi = np.eye(CORE)
        Phi[THETA, THETA] = self.R_WI.T @ R
        Phi[P, THETA] = -so3.hat(self.p_WI - self.p_fej - self.v_fej * dt - 0.5 * gravity_W * dt**2) @ R
        Phi[V, THETA] = -so3.hat(self.v_W - self.v_fej - gravity_W * dt) @ R
        Phi[P, V] = np.eye(3) * dt
        Phi[THETA, BIASES] = pre.J[GAMMA_ROWS]
        Phi[P, BIASES] = R @ pre.J[ALPHA]
        Phi[V, BIASES] = R @ pre.J[BETA]
        turn = np.eye(CORE)
        turn[P, P] = turn[V, V] = R
        cov = self.cov
        cov[:CORE] = Phi @ cov[:CORE]
        cov[:, :CORE] = cov[:, :CORE] @ Phi.T
        cov[:CORE, :CORE] += turn @ pre.cov[np.ix_(SUMS, SUMS)] @ turn.T
        cov[:CORE, :CORE] = 0.5 * (cov[:CORE, :CORE] + cov[:CORE, :CORE].T)

    def widen(self, rows: slice, variance: float) -> None:
        """Add variance to a part of the IMU's error, for what the model leaves out."""
        self.cov[rows, rows] += np.eye(rows.stop - rows.start) * variance

    def widen_motion(self, variance_theta: float, variance_v: float, lag_s: float) -> None:
        """Add an error of rotation and velocity that arose ``lag_s`` ago: the position has drifted with it since."""
        eye = np.eye(3)
        self.cov[THETA, THETA] += eye * variance_theta
        self.cov[V, V] += eye * variance_v
        self.cov[P, P] += eye * (variance_v * lag_s**2)
        self.cov[P, V] += eye * (variance_v * lag_s)
        self.cov[V, P] += eye * (variance_v * lag_s)

    def widen_landmarks(self, variance: Float) -> None:
        """Add the same variance to all axes of each landmark, (L,) m^2: its track wanders over the surface."""
        rows = np.arange(self.window.stop, self.size)
        self.cov[rows, rows] += np.repeat(variance, LANDMARK)

    def make_origin(self, yaw_rad: float, p_W: Float) -> None:
        """Define W by the present pose, at ``yaw_rad`` and ``p_W``: both become exact, all errors relative to them.

        With the yaw's error s = e_z^T R_WI theta: theta_i <- theta_i - R_i^T e_z s, p_i <- p_i - p - e_z x (p_i - p) s,
        v <- v - e_z x v s; then all is turned about z.
        """
        A = np.eye(self.size)
        r_yaw_x = np.zeros(self.size)
        r_yaw_x[THETA] = UP @ self.R_WI
        for at, R_i in ((THETA.start, self.R_WI), *self._clone_rotations()):
            A[at : at + 3] -= np.outer(R_i.T @ UP, r_yaw_x)
        R = so3.from_yaw(yaw_rad - float(so3.yaw(self.R_WI)))
        for at, vector, is_point in self._vectors():
            A[at : at + 3] -= np.outer(np.cross(UP, vector - is_point * self.p_WI), r_yaw_x)
            A[at : at + 3, P] -= is_point * np.eye(3)
            A[at : at + 3] = R @ A[at : at + 3]
        self.cov = A @ self.cov @ A.T
        self._move(R, p_W - R @ self.p_WI)

    def _clone_rotations(self) -> list[tuple[int, Float]]:
        return [(self.clone_slice(k).start, R) for k, R in enumerate(self.clones.R_WI)]

    def _vectors(self) -> list[tuple[int, Float, float]]:
        """Return where the error of each vector in W starts, its value, and 1 for a point, 0 for a free vector."""
        clones = [(self.clone_slice(k).start + 3, p_WI, 1.0) for k, p_WI in enumerate(self.clones.p_WI)]
        points = [(self.window.stop + LANDMARK * k, p_W, 1.0) for k, p_W in enumerate(self.landmarks.p_W)]
        return [(P.start, self.p_WI, 1.0), (V.start, self.v_W, 0.0), *clones, *points]

    def _move(self, R: Float, t: Float) -> None:
        """Move all values, x <- R x + t."""
        clones, landmarks = self.clones, self.landmarks
        self.R_WI, self.p_WI, self.v_W = R @ self.R_WI, R @ self.p_WI + t, R @ self.v_W
        self.R_fej, self.p_fej, self.v_fej = R @ self.R_fej, R @ self.p_fej + t, R @ self.v_fej
        clones.R_WI, clones.R_fej = R @ clones.R_WI, R @ clones.R_fej
        clones.p_WI, clones.p_fej = clones.p_WI @ R.T + t, clones.p_fej @ R.T + t
        landmarks.p_W, landmarks.p_fej = landmarks.p_W @ R.T + t, landmarks.p_fej @ R.T + t

    # -- Parts --------------------------------------------------------------------------------------------------------

    def free_mount(self, mount: Mount, variance: Float) -> None:
        """Take what is free of the camera's mount into the state, (size,) variances; there are no clones yet."""
        self.mount = mount
        n = len(self.cov)
        cov = np.zeros((n + mount.size, n + mount.size))
        cov[:n, :n] = self.cov
        cov[np.arange(n, len(cov)), np.arange(n, len(cov))] = variance
        self.cov = cov

    def add_clone(self, r_pose_t: Float | None = None) -> None:
        """Append the pose of the present frame to the window.

        ``r_pose_t`` (6,) is d(theta, p)/dt: where the camera's time is free, an error of it moves the clone.
        """
        at = self.window.stop
        order = np.r_[0:at, POSE, at : self.size]
        self.cov = part(self.cov, order, order)
        if r_pose_t is not None and self.camera_time.stop > CORE:
            clone = slice(at, at + CLONE)
            self.cov[clone] += np.outer(r_pose_t, self.cov[CORE])
            self.cov[:, clone] += np.outer(self.cov[:, CORE], r_pose_t)
        self.clones.append(self.t_ns, self.R_WI, self.p_WI, self.R_fej, self.p_fej)

    def drop_clone(self, k: int) -> None:
        """Marginalise clone ``k``."""
        self._keep_rows(np.delete(np.arange(self.size), self.clone_slice(k)))
        self.clones.delete(k)

    def keep_landmarks(self, kept: NDArray[np.bool_]) -> None:
        """Marginalise the landmarks that are not ``kept`` (L,)."""
        if kept.all():
            return
        self._keep_rows(np.concatenate([np.arange(self.window.stop), self.landmark_rows(np.flatnonzero(kept)).ravel()]))
        self.landmarks.keep(kept)

    def add_landmarks(self, ids: NDArray[np.int64], p_W: Float, r_f_x: Float, cov_ff: Float) -> None:
        """Append points (k, 3) whose errors are ``r_f_x`` (k, 3, size) times the state's plus noise of ``cov_ff``.

        ``cov_ff`` (k, 3, 3) is the noise of each point, independent of the others'.
        """
        k = len(ids)
        cross = r_f_x.reshape(k * LANDMARK, -1) @ self.cov
        corner = cross @ r_f_x.reshape(k * LANDMARK, -1).T
        for row in range(k):
            own = slice(LANDMARK * row, LANDMARK * (row + 1))
            corner[own, own] += cov_ff[row]
        self.cov = np.block([[self.cov, cross.T], [cross, 0.5 * (corner + corner.T)]])
        self.landmarks.append(ids, p_W)

    def _keep_rows(self, kept: NDArray[np.int64]) -> None:
        self.cov = part(self.cov, kept, kept)

    # -- Correction ---------------------------------------------------------------------------------------------------

    def nominal(self) -> Nominal:
        """Return the nominal values, to go back to."""
        clones = self.clones
        core = (self.R_WI, self.p_WI, self.v_W, self.bias_g, self.bias_a)
        return (*core, self.mount, clones.R_WI, clones.p_WI, self.landmarks.p_W)

    def restore(self, nominal: Nominal) -> None:
        """Put nominal values back."""
        self.R_WI, self.p_WI, self.v_W, self.bias_g, self.bias_a = nominal[:5]
        self.mount = nominal[5]
        self.clones.R_WI, self.clones.p_WI, self.landmarks.p_W = nominal[6:]

    def plus(self, dx: Float) -> None:
        """Add an error to every part, in place: X <- X [+] dx."""
        window = dx[self.window].reshape(-1, 2, 3)
        turns = so3.exp(np.concatenate([dx[None, THETA], window[:, 0]]))
        self.R_WI = self.R_WI @ turns[0]
        self.p_WI = self.p_WI + dx[P]
        self.v_W = self.v_W + dx[V]
        self.bias_g = self.bias_g + dx[BIAS_G]
        self.bias_a = self.bias_a + dx[BIAS_A]
        if self.mount is not None:
            self.mount = self.mount.plus(dx[CORE : self.window.start])
        self.clones.R_WI = self.clones.R_WI @ turns[1:]
        self.clones.p_WI = self.clones.p_WI + window[:, 1]
        self.landmarks.p_W = self.landmarks.p_W + dx[self.window.stop :].reshape(-1, LANDMARK)
