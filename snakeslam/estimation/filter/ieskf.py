"""The iterated error-state Kalman update [Bell93], in information form, over any set of measurements.

Eq. (41) with the iteration that the paper announces but does not print: from x_0 = x^,

    x_{j+1} = x^ [+] P H^T (H P H^T + I)^-1 (r_j + H d_j),   r_j = z - h(x_j),   d_j = x_j [-] x^

is Gauss-Newton on r^T r + d^T P^-1 d, for whitened residuals. It ends when the step is small, or when the cost rises;
then P is updated once. In information form, with L = H^T H and b = H^T (r_j + H d_j), the argument of [+] is
P_:m (I + L P_mm)^-1 b, where m are the components of the error on which a measurement depends: they are fewer than the
rows. Jacobians are taken at first estimates [Huang10], so that only residuals and weights change between iterations.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.blas import dtrmm

from snakeslam.estimation.filter.state import State
from snakeslam.estimation.filter.submatrices import add_to_submatrix, submatrix
from snakeslam.messages import Float

SMALL_STEP = 1e-5
"""RMS of the step (m, rad, m/s, ..) below which the iteration has converged: far below every sigma of the state."""
LINEAR = 0.01
"""If the first step changes the cost as the linear model predicts, to this share, a second would change nothing."""

ROUNDING = 1e-9
"""Relative rise of the cost that is rounding and not divergence."""
JITTER = 1e-14
"""Variance added to the prior before it is factorised. The pose that defines W has none, and its factor would be
singular; 1e-7 m and rad are far below every other sigma."""


@dataclass(slots=True)
class Information:
    """The normal equations of all measurements at one linearisation: L = H^T H (N, N), H^T r (N,), cost r^T r."""

    L: Float
    gradient: Float
    cost: float

    @staticmethod
    def none(size: int) -> "Information":
        """Return zero information about an error state of length ``size``."""
        return Information(np.zeros((size, size)), np.zeros(size), 0.0)


class Measurement(Protocol):
    """Whitened residuals of the state. A measurement may have unknowns of its own (points), which it projects out."""

    def linearise(self, state: State, total: Information) -> None:
        """Add L, H^T r and r^T r at the state's present value to ``total``."""
        ...

    def cost(self, state: State) -> float:
        """Return r^T r at the state's present value with the weights of the last linearisation."""
        ...

    def back_substitute(self, step: Float) -> Float:
        """Back-substitute: move own unknowns by the ``step`` (N,) of the state; return their values before."""
        ...

    def restore(self, kept: Float) -> None:
        """Put own unknowns back to the values that ``follow`` returned."""
        ...


class DirectMeasurement(ABC):
    """A measurement without unknowns of its own: its whitened residual and Jacobian are all there is to it."""

    __slots__ = ()

    @abstractmethod
    def residual(self, state: State) -> Float:
        """Return the whitened residual, (count,)."""

    @abstractmethod
    def jacobian(self, state: State) -> Float:
        """Return the whitened Jacobian, (count, size)."""

    def linearise(self, state: State, total: Information) -> None:
        """Add H^T H, H^T r and r^T r to ``total``."""
        r, H = self.residual(state), self.jacobian(state)
        total.L += H.T @ H
        total.gradient += H.T @ r
        total.cost += float(r @ r)

    def cost(self, state: State) -> float:
        """Return r^T r."""
        r = self.residual(state)
        return float(r @ r)

    def back_substitute(self, step: Float) -> Float:
        """Return nothing: there are no own unknowns."""
        del step
        return np.empty(0)

    def restore(self, kept: Float) -> None:
        """Do nothing: there are no own unknowns."""
        del kept


def update(state: State, measurements: Sequence[Measurement], max_iterations: int) -> int:
    """Correct the state by measurements, in place, Eq. (41); return the number of iterations."""
    if not measurements:
        return 0
    prior, d, prior_cost = state.nominal(), np.zeros(state.size), 0.0
    rest, B, S_chol = np.arange(state.size), np.empty((state.size, 0)), np.empty((0, 0))
    iteration = 0
    for iteration in range(1, max_iterations + 1):
        # 1. Linearise at x_j: L = H^T H, H^T r_j and r_j^T r_j over all measurements.
        total = Information.none(state.size)
        for m in measurements:
            m.linearise(state, total)
        touched = np.diagonal(total.L) > 0.0
        active, rest = np.flatnonzero(touched), np.flatnonzero(~touched)

        # 2. Square root of the prior: P_mm = U^T U and B = P_:m U^-1, of which the rows m are U^T itself.
        P, L = submatrix(state.cov, active, active), submatrix(total.L, active, active)
        P[np.diag_indices(len(P))] += JITTER
        U = cholesky(P, check_finite=False, overwrite_a=True)
        B = np.empty((state.size, len(active)))
        B[active] = U.T
        B[rest] = solve_triangular(U, submatrix(state.cov, active, rest), trans="T", check_finite=False).T

        # 3. Solve: S = I + U L U^T, w = S^-1 U (H^T r_j + L d_j), d_{j+1} = B w, and d^T P^-1 d = w^T w.
        S = dtrmm(1.0, U, dtrmm(1.0, U, L.T), side=1, trans_a=1)
        S[np.diag_indices(len(S))] += 1.0
        S_chol = cholesky(S, check_finite=False, overwrite_a=True)
        w = cho_solve((S_chol, False), U @ (total.gradient[active] + L @ d[active]), check_finite=False)
        d_new, prior_cost_new = B @ w, float(w @ w)

        # 4. x_{j+1} = x^ [+] d_{j+1}. A step that raises the cost r^T r + d^T P^-1 d is undone, and is the last.
        step = d_new - d
        before, points = state.nominal(), [m.back_substitute(step) for m in measurements]
        state.restore(prior)
        state.plus(d_new)
        cost_before = total.cost + prior_cost
        cost = sum(m.cost(state) for m in measurements) + prior_cost_new
        if not cost <= cost_before * (1.0 + ROUNDING):
            state.restore(before)
            for m, kept in zip(measurements, points, strict=True):
                m.restore(kept)
            break

        # 5. Converged: the first step was as good as the linear model predicts, or the step is small.
        predicted_cost = cost_before - float(total.gradient @ step)
        d, prior_cost = d_new, prior_cost_new
        linear = iteration == 1 and abs(cost - predicted_cost) < LINEAR * cost
        if linear or np.linalg.norm(step) < SMALL_STEP * np.sqrt(len(step)):
            break

    # 6. Own unknowns of the measurements at the final state.
    nothing = np.zeros(state.size)
    for m in measurements:
        m.cost(state)
        m.back_substitute(nothing)

    # 7. P <- P - B B^T + B S^-1 B^T, symmetric and positive by its form. B B^T is P except in the untouched rows.
    if iteration:
        Y = solve_triangular(S_chol, B.T, trans="T", check_finite=False)
        cov: Float = Y.T @ Y
        add_to_submatrix(cov, rest, submatrix(state.cov, rest, rest) - B[rest] @ B[rest].T)
        state.cov = cov
    return iteration
