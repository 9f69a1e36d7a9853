"""The gait as a measurement of the filter: the displacement since the last clone, or the velocity alone."""

from dataclasses import dataclass, replace

import numpy as np

from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import DirectMeasurement
from snakeslam.estimation.filter.state import THETA, P, State, V
from snakeslam.estimation.gait.odometry import ModelledDisplacement
from snakeslam.geometry import so3
from snakeslam.messages import Float

INFLATIONS = (1.0, 2.0, 4.0, 8.0)
"""Factors on sigma that are tried in turn until the innovation passes its gate."""


@dataclass(frozen=True, slots=True)
class GaitDisplacement:
    """The displacement of one frame by the gait, corrected for the learnt biases, with its covariance (3, 3).

    ``cov`` is that of dp_I; the velocity's is ``cov / dt_s^2``.
    """

    modelled: ModelledDisplacement
    cov: Float


@dataclass(frozen=True, slots=True)
class FilterDisplacement:
    """The filter's own displacement ``dp_I`` (3,) m with ``cov`` (3, 3), and whether it accepted that of the gait."""

    accepted: bool
    dp_I: Float
    cov: Float


@dataclass(slots=True)
class GaitMeasurement(DirectMeasurement):
    """Rows R_k^T (p - p_k) = dp_I from clone k to the state, or R^T v = v_I where ``before`` is None."""

    measured: Float
    W: Float
    """Whitening matrix, W cov W^T = I."""
    before: int | None

    @staticmethod
    def of(motion: GaitDisplacement, before: int | None) -> "GaitMeasurement":
        """Return the rows of a displacement since clone ``before``; with None those of the velocity at its end."""
        modelled, dt_s = motion.modelled, motion.modelled.dt_s
        cov = motion.cov if before is not None else motion.cov / dt_s**2
        W = np.asarray(np.linalg.inv(np.linalg.cholesky(cov)), dtype=np.float64)
        return GaitMeasurement(modelled.dp_I if before is not None else modelled.v_I, W, before)

    def predicted(self, state: State) -> Float:
        """Return the state's own displacement R_k^T (p - p_k), or its velocity R^T v, (3,)."""
        if self.before is None:
            return state.R_WI.T @ state.v_W
        clones = state.clones
        return clones.R_WI[self.before].T @ (state.p_WI - clones.p_WI[self.before])

    def residual(self, state: State) -> Float:
        """Return the whitened residual, (3,)."""
        return self.W @ (self.measured - self.predicted(state))

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

    def filter_displacement(self, state: State, accepted: bool) -> FilterDisplacement:
        """Return the state's own displacement with its covariance H P H^T."""
        H = np.linalg.solve(self.W, self.jacobian(state))
        return FilterDisplacement(accepted, self.predicted(state), H @ state.cov @ H.T)

    def innovation(self, state: State) -> Innovation:
        """Return the innovation, S = H P H^T + I."""
        H = self.jacobian(state)
        return Innovation.of(self.residual(state)[None], (H @ state.cov @ H.T)[None], np.array([3]))

    def gated(self, state: State, max_inflation: float) -> "GaitMeasurement | None":
        """Return the rows with the least sigma at which they pass the gate; None if ``max_inflation`` is not enough."""
        for factor in INFLATIONS:
            rows = replace(self, W=self.W / factor)
            if factor <= max_inflation and rows.innovation(state).accepted.all():
                return rows
        return None
