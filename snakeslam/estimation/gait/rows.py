"""Rows of the gait on the filter's state: the way since the clone before, or the velocity alone."""

from dataclasses import dataclass, replace

import numpy as np

from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import PlainRows
from snakeslam.estimation.filter.state import THETA, P, State, V
from snakeslam.estimation.gait.odometry import Reckoned
from snakeslam.geometry import so3
from snakeslam.messages import Float

INFLATIONS = (1.0, 2.0, 4.0, 8.0)


@dataclass(frozen=True, slots=True)
class GaitWay:
    """What the gait says of one frame: the way, and its covariance (3, 3) with all that is known of slip.

    ``cov`` is that of dp_I; that of the velocity is ``cov / dt_s^2``.
    """

    reckoned: Reckoned
    cov: Float


@dataclass(frozen=True, slots=True)
class Carried:
    """What the filter made of a way: whether it was taken, and what it says itself, ``moved_I`` (3,) m with ``cov``."""

    taken: bool
    moved_I: Float
    cov: Float


@dataclass(slots=True)
class GaitRows(PlainRows):
    """Rows R_k^T (p - p_k) = dp_I from clone k to the state, or R^T v = v_I where ``before`` is None."""

    measured: Float
    W: Float
    """Whitens: W cov W^T = I."""
    before: int | None

    @staticmethod
    def of(motion: GaitWay, before: int | None) -> "GaitRows":
        """Return the rows of a motion since clone ``before``; with None those of the velocity at its end."""
        told, dt_s = motion.reckoned, motion.reckoned.dt_s
        cov = motion.cov if before is not None else motion.cov / dt_s**2
        W = np.asarray(np.linalg.inv(np.linalg.cholesky(cov)), dtype=np.float64)
        return GaitRows(told.dp_I if before is not None else told.v_I, W, before)

    def foreseen(self, state: State) -> Float:
        """Return what the state says of it, (3,)."""
        if self.before is None:
            return state.R_WI.T @ state.v_W
        clones = state.clones
        return clones.R_WI[self.before].T @ (state.p_WI - clones.p_WI[self.before])

    def residual(self, state: State) -> Float:
        """Return the whitened residual, (3,)."""
        return self.W @ (self.measured - self.foreseen(state))

    def jacobian(self, state: State) -> Float:
        """Return the whitened Jacobian at first estimates, (3, size).

        [R_k^T (p - p_k)]x by theta_k, -R_k^T by p_k, R_k^T by p; [R^T v]x by theta, R^T by v.
        """
        H = np.zeros((3, state.size))
        if self.before is None:
            H[:, THETA] = so3.hat(state.R_fej.T @ state.v_fej)
            H[:, V] = state.R_fej.T
            return self.W @ H
        at = state.clone_slice(self.before).start
        R, p = state.clones.R_fej[self.before], state.clones.p_fej[self.before]
        H[:, at + THETA.start : at + THETA.stop] = so3.hat(R.T @ (state.p_fej - p))
        H[:, at + P.start : at + P.stop] = -R.T
        H[:, P] = R.T
        return self.W @ H

    def carried(self, state: State, taken: bool) -> Carried:
        """Return what the state says of the way."""
        H = np.linalg.solve(self.W, self.jacobian(state))
        return Carried(taken, self.foreseen(state), H @ state.cov @ H.T)

    def innovation(self, state: State) -> Innovation:
        """Return how far it is from what the state foresees."""
        H = self.jacobian(state)
        return Innovation.of(self.residual(state)[None], (H @ state.cov @ H.T)[None], np.array([3]))

    def gated(self, state: State, max_inflation: float) -> "GaitRows | None":
        """Return the rows with the sigma at which they pass the gate, None when ``max_inflation`` is not enough."""
        for factor in INFLATIONS:
            rows = replace(self, W=self.W / factor)
            if factor <= max_inflation and rows.innovation(state).accepted.all():
                return rows
        return None
