"""The iterated error-state Kalman update, in information form, over any set of measurements.

Eq. (41) with the iteration that the paper announces but does not print: from x_0 = x^,
x_{j+1} = x^ [+] P H^T (H P H^T + I)^-1 (r_j + H d_j), r_j = z - h(x_j), d_j = x_j [-] x^, until the step is small
or the cost rises; then P is reduced once. With L = H^T H and b = H^T (r_j + H d_j) the step is P_:m (I + L P_mm)^-1 b,
where m are the errors that the measurements touch. Jacobians are taken at first estimates, so only residuals and
weights change.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.blas import dtrmm

from snakeslam.estimation.filter.blocks import add_to_part, part
from snakeslam.estimation.filter.state import State
from snakeslam.messages import Float

SMALL_STEP = 1e-5
LINEAR = 0.01
"""A first step that brings the cost that the linear model foresees, to this part, needs no second."""
WORSE = 1e-9
JITTER = 1e-14


@dataclass(slots=True)
class Information:
    """What measurements tell of the error at one linearisation: L = H^T H (N, N), H^T r (N,), cost r^T r."""

    L: Float
    gradient: Float
    cost: float

    @staticmethod
    def none(size: int) -> "Information":
        """Return nothing about an error of ``size``."""
        return Information(np.zeros((size, size)), np.zeros(size), 0.0)


class Measurement(Protocol):
    """Whitened rows on the state, and perhaps unknowns of their own that are projected out."""

    def linearise(self, state: State, total: Information) -> None:
        """Add L, H^T r and r^T r at the state's present value to ``total``."""
        ...

    def cost(self, state: State) -> float:
        """Return r^T r at the state's present value with the weights of the last linearisation."""
        ...

    def follow(self, step: Float) -> Float:
        """Move own unknowns as a step (N,) of the state since the linearisation asks; return what to go back to."""
        ...

    def go_back(self, kept: Float) -> None:
        """Undo ``follow``."""
        ...


class PlainRows(ABC):
    """Whitened rows without unknowns of their own: a residual and its Jacobian say all."""

    __slots__ = ()

    @abstractmethod
    def residual(self, state: State) -> Float:
        """Return the whitened residual, (count,)."""

    @abstractmethod
    def jacobian(self, state: State) -> Float:
        """Return the whitened Jacobian, (count, size)."""

    def linearise(self, state: State, total: Information) -> None:
        """Add the rows to ``total``."""
        r, H = self.residual(state), self.jacobian(state)
        total.L += H.T @ H
        total.gradient += H.T @ r
        total.cost += float(r @ r)

    def cost(self, state: State) -> float:
        """Return the cost."""
        r = self.residual(state)
        return float(r @ r)

    def follow(self, step: Float) -> Float:
        """Nothing of its own moves."""
        del step
        return np.empty(0)

    def go_back(self, kept: Float) -> None:
        """Nothing of its own has moved."""
        del kept


def update(state: State, measurements: Sequence[Measurement], max_iterations: int) -> int:
    """Take measurements into the state, in place, by Eq. (41); return the number of iterations."""
    if not measurements:
        return 0
    prior, d, prior_cost = state.nominal(), np.zeros(state.size), 0.0
    solved: _Solved | None = None
    rounds = 0
    for rounds in range(1, max_iterations + 1):
        total = _linearise(state, measurements)
        solved = _Solved.of(state, total, d)
        step = solved.d - d
        before, own = state.nominal(), [m.follow(step) for m in measurements]
        state.restore(prior)
        state.plus(solved.d)
        best = total.cost + prior_cost
        cost = sum(m.cost(state) for m in measurements) + solved.prior_cost
        if not cost <= best * (1.0 + WORSE):
            state.restore(before)
            for m, kept in zip(measurements, own, strict=True):
                m.go_back(kept)
            break
        foreseen = best - float(total.gradient @ step)
        d, prior_cost = solved.d, solved.prior_cost
        linear = rounds == 1 and abs(cost - foreseen) < LINEAR * cost
        if linear or np.linalg.norm(step) < SMALL_STEP * np.sqrt(len(step)):
            break
    nothing = np.zeros(state.size)
    for m in measurements:
        m.cost(state)
        m.follow(nothing)
    if solved is not None:
        state.cov = solved.posterior(state.cov)
    return rounds


def _linearise(state: State, measurements: Sequence[Measurement]) -> Information:
    total = Information.none(state.size)
    for m in measurements:
        m.linearise(state, total)
    return total


@dataclass(slots=True)
class _Solved:
    """One linear solution over the rows m that anything is told about; ``rest`` are the others.

    With P_mm = U^T U, B = P_:m U^-1 and S = I + U L U^T: the error from the prior is ``d`` = B S^-1 U b and
    P <- P - B B^T + B S^-1 B^T, symmetric and positive by its form.
    """

    rest: NDArray[np.int64]
    B: Float
    S_chol: Float
    d: Float
    prior_cost: float

    @staticmethod
    def of(state: State, total: Information, d: Float) -> "_Solved":
        touched = np.diagonal(total.L) > 0.0
        active, rest = np.flatnonzero(touched), np.flatnonzero(~touched)
        P, L = part(state.cov, active, active), part(total.L, active, active)
        # An error that is exactly zero (the pose that defines W) has no factor: 1e-7 m and rad do no harm.
        P[np.diag_indices(len(P))] += JITTER
        U = cholesky(P, check_finite=False, overwrite_a=True)
        B = np.empty((state.size, len(active)))
        B[active] = U.T
        B[rest] = solve_triangular(U, part(state.cov, active, rest), trans="T", check_finite=False).T
        S = dtrmm(1.0, U, dtrmm(1.0, U, L.T), side=1, trans_a=1)
        S[np.diag_indices(len(S))] += 1.0
        S_chol = cholesky(S, check_finite=False, overwrite_a=True)
        rhs = U @ (total.gradient[active] + L @ d[active])
        w = cho_solve((S_chol, False), rhs, check_finite=False)
        return _Solved(rest, B, S_chol, B @ w, float(w @ w))

    def posterior(self, cov: Float) -> Float:
        """Return the covariance after the update."""
        Y = solve_triangular(self.S_chol, self.B.T, trans="T", check_finite=False)
        # B B^T is P itself but for the rows that nothing touches.
        new: Float = Y.T @ Y
        B_rest = self.B[self.rest]
        add_to_part(new, self.rest, part(cov, self.rest, self.rest) - B_rest @ B_rest.T)
        return new
