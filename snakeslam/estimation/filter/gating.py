"""Chi-square gates: the innovation of each measurement against the covariance that the state predicts for it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from snakeslam.geometry.median import median
from snakeslam.messages import Float

GATE_QUANTILE = 0.99
MAX_DOF = 200
"""Limits are tabulated below this; a track has three rows for each of 31 clones at most, which is 93."""
CHI2: Float = np.asarray(2.0 * special.gammaincinv(0.5 * np.arange(1, MAX_DOF), GATE_QUANTILE), dtype=np.float64)
"""Quantile of chi-square for 1, 2, .. degrees of freedom, 2 P^-1(k/2, q); importing scipy.stats takes 0.5 s."""
LIMITS = np.concatenate([[-1.0], CHI2])
"""The same from 0 degrees of freedom on, where nothing passes."""


@dataclass(frozen=True, slots=True)
class Innovation:
    """Squared Mahalanobis distances d^2 = r^T S^-1 r of M measurements, (M,), with their degrees of freedom, (M,)."""

    distance: Float
    dof: NDArray[np.int64]

    @staticmethod
    def none() -> "Innovation":
        """Return the innovation of no measurements."""
        return Innovation(np.empty(0), np.empty(0, np.int64))

    @staticmethod
    def of(r: Float, excess: Float, dof: NDArray[np.int64]) -> "Innovation":
        """Return the innovation for whitened residuals (M, k): S = H P H^T + I, ``excess`` = H P H^T (M, k, k)."""
        S = excess + np.eye(r.shape[1])
        return Innovation(np.einsum("mi,mi->m", r, np.linalg.solve(S, r[..., None])[..., 0]), dof)

    @property
    def accepted(self) -> NDArray[np.bool_]:
        """Which measurements are below the 99 % quantile of chi^2, (M,); those with 0 degrees of freedom are not."""
        return np.asarray(self.distance < LIMITS[np.minimum(np.maximum(self.dof, 0), MAX_DOF - 1)])


@dataclass(frozen=True, slots=True)
class Agreement:
    """How a frame's measurements agree with the state: their number, how many passed the gate, median d^2 / dof."""

    tried: int
    accepted: int
    ratio: float

    @staticmethod
    def of(innovations: Sequence[Innovation]) -> "Agreement":
        """Return the agreement of all measurements of a frame; a ratio of about 1 is as predicted, 0 without any."""
        distance = np.concatenate([np.empty(0), *(i.distance / np.maximum(i.dof, 1) for i in innovations)])
        accepted = sum(int(i.accepted.sum()) for i in innovations)
        return Agreement(len(distance), accepted, median(distance) if len(distance) else 0.0)
