"""The filter's state on its manifold: IMU, a window of pose clones, landmarks; one covariance over their errors.

Errors are (theta, p, v, b_g, b_a | theta, p of each clone | p of each landmark), with R_true = R Exp(theta) and
additive others. Beside each value stands its first estimate (``_fej``), where Jacobians are taken, so that the
filter does not gain information along directions that nobody observes [Huang10].
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.preintegration import ALPHA, BETA, Preintegrated
from snakeslam.estimation.preintegration import GAMMA as GAMMA_ROWS
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float

THETA, P, V, BIAS_G, BIAS_A = (slice(3 * k, 3 * k + 3) for k in range(5))
BIASES = slice(BIAS_G.start, BIAS_A.stop)
CORE = 15
CLONE = 6
LANDMARK = 3


@dataclass(slots=True)
class Clone:
    """The IMU's pose at the time of one frame."""

    t_ns: int
    R_WI: Float
    p_WI: Float
    R_fej: Float
    p_fej: Float


@dataclass(slots=True)
class Landmark:
    """A point in W that stays in the state as long as its track lasts."""

    track_id: int
    p_W: Float
    p_fej: Float
    rejections: int = 0


@dataclass(slots=True)
class State:
    """Nominal state, first estimates and covariance; the only writer of ``cov`` is this class."""

    t_ns: int
    R_WI: Float
    p_WI: Float
    v_W: Float
    bias_g: Float
    bias_a: Float
    cov: Float
    clones: list[Clone] = field(default_factory=list[Clone])
    landmarks: list[Landmark] = field(default_factory=list[Landmark])
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
        return CORE + CLONE * len(self.clones) + LANDMARK * len(self.landmarks)

    def clone_slice(self, k: int) -> slice:
        """Return where the error of clone ``k`` stands."""
        return slice(CORE + CLONE * k, CORE + CLONE * (k + 1))

    def landmark_slice(self, k: int) -> slice:
        """Return where the error of landmark ``k`` stands."""
        start = CORE + CLONE * len(self.clones) + LANDMARK * k
        return slice(start, start + LANDMARK)

    def _fix_first_estimate(self) -> None:
        self.R_fej, self.p_fej, self.v_fej = self.R_WI.copy(), self.p_WI.copy(), self.v_W.copy()

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
        # Rows of the summed error (alpha, beta, theta, biases) to those of the state (theta, p, v, biases).
        G = np.zeros((CORE, CORE))
        G[THETA, GAMMA_ROWS] = np.eye(3)
        G[P, ALPHA] = G[V, BETA] = R
        G[BIASES, BIASES] = np.eye(6)
        cov = self.cov
        cov[:CORE] = Phi @ cov[:CORE]
        cov[:, :CORE] = cov[:, :CORE] @ Phi.T
        cov[:CORE, :CORE] += G @ pre.cov @ G.T
        self._symmetrise()

    def widen(self, rows: slice, variance: float) -> None:
        """Add variance to a part of the IMU's error, for what the model leaves out."""
        self.cov[rows, rows] += np.eye(rows.stop - rows.start) * variance

    def turn_world(self, R: Float, p_W: Float) -> None:
        """Express a fresh state (no clones yet) in a world turned by ``R`` about z and moved by ``p_W``."""
        self.R_WI, self.p_WI, self.v_W = R @ self.R_WI, R @ self.p_WI + p_W, R @ self.v_W
        turn = np.eye(CORE)
        turn[P, P] = turn[V, V] = R
        self.cov = turn @ self.cov @ turn.T
        self._fix_first_estimate()

    def add_clone(self) -> None:
        """Append the present pose to the window."""
        at = CORE + CLONE * len(self.clones)
        pose = np.r_[THETA, P]
        order = np.r_[0:at, pose, at : self.size]
        self.cov = self.cov[np.ix_(order, order)]
        self.clones.append(Clone(self.t_ns, self.R_WI.copy(), self.p_WI.copy(), self.R_fej.copy(), self.p_fej.copy()))

    def drop_clone(self, k: int) -> None:
        """Marginalise clone ``k``."""
        self._delete(self.clone_slice(k))
        del self.clones[k]

    def drop_landmarks(self, track_ids: set[int]) -> None:
        """Marginalise the landmarks of these tracks."""
        for k in reversed(range(len(self.landmarks))):
            if self.landmarks[k].track_id in track_ids:
                self._delete(self.landmark_slice(k))
                del self.landmarks[k]

    def add_landmark(self, landmark: Landmark, r_f_x: Float, cov_ff: Float) -> None:
        """Append a landmark whose error is ``r_f_x`` (3, size) times the state's plus noise of ``cov_ff`` (3, 3)."""
        cross = r_f_x @ self.cov
        corner = cross @ r_f_x.T + cov_ff
        self.cov = np.block([[self.cov, cross.T], [cross, 0.5 * (corner + corner.T)]])
        self.landmarks.append(landmark)

    def _delete(self, rows: slice) -> None:
        keep = np.r_[0 : rows.start, rows.stop : self.size]
        self.cov = self.cov[np.ix_(keep, keep)]

    def plus(self, dx: Float) -> None:
        """Add an error to every part, in place: X <- X [+] dx."""
        self.R_WI = self.R_WI @ so3.exp(dx[THETA])
        self.p_WI = self.p_WI + dx[P]
        self.v_W = self.v_W + dx[V]
        self.bias_g = self.bias_g + dx[BIAS_G]
        self.bias_a = self.bias_a + dx[BIAS_A]
        if self.clones:
            clone_dx = dx[CORE : CORE + CLONE * len(self.clones)].reshape(-1, 2, 3)
            turns = so3.exp(clone_dx[:, 0])
            for clone, turn, step in zip(self.clones, turns, clone_dx[:, 1], strict=True):
                clone.R_WI = clone.R_WI @ turn
                clone.p_WI = clone.p_WI + step
        for k, landmark in enumerate(self.landmarks):
            landmark.p_W = landmark.p_W + dx[self.landmark_slice(k)]

    def reduce_covariance(self, rows: NDArray[np.int64], information: Float) -> None:
        """Take up ``information`` L (m, m) on the error's ``rows`` (m,): P_m: <- (I + P_mm L)^-1 P_m:."""
        others = np.setdiff1d(np.arange(self.size), rows)
        before = self.cov[rows]
        after = np.linalg.solve(np.eye(len(rows)) + before[:, rows] @ information, before)
        cov = np.empty_like(self.cov)
        cov[rows] = after
        cov[np.ix_(others, rows)] = after[:, others].T
        rest = self.cov[np.ix_(others, others)]
        cov[np.ix_(others, others)] = rest - before[:, others].T @ (information @ after[:, others])
        self.cov = cov
        self._symmetrise()

    def _symmetrise(self) -> None:
        self.cov = 0.5 * (self.cov + self.cov.T)
