"""How far measurements are from what the state foresees, in units of what it allows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from snakeslam.geometry.median import median
from snakeslam.messages import Float

GATE_QUANTILE = 0.99
MAX_DOF = 200
CHI2: Float = np.asarray(2.0 * special.gammaincinv(0.5 * np.arange(1, MAX_DOF), GATE_QUANTILE), dtype=np.float64)
"""Quantile of chi-squared by degrees of freedom from 1: 2 P^-1(k/2, q); scipy.stats takes half a second to import."""
LIMITS = np.concatenate([[-1.0], CHI2])
"""The same from 0, where nothing is within it."""


@dataclass(frozen=True, slots=True)
class Innovation:
    """Squared Mahalanobis distances d^2 = r^T S^-1 r of M measurements, (M,), with their degrees of freedom, (M,)."""

    distance: Float
    dof: NDArray[np.int64]

    @staticmethod
    def none() -> "Innovation":
        """Return that of no measurements."""
        return Innovation(np.empty(0), np.empty(0, np.int64))

    @staticmethod
    def of(r: Float, excess: Float, dof: NDArray[np.int64]) -> "Innovation":
        """Return it for whitened residuals (M, k) whose covariance is ``excess`` (M, k, k) plus the unit matrix."""
        S = excess + np.eye(r.shape[1])
        return Innovation(np.einsum("mi,mi->m", r, np.linalg.solve(S, r[..., None])[..., 0]), dof)

    @property
    def accepted(self) -> NDArray[np.bool_]:
        """Which are within the 99 % quantile of chi^2, (M,); those without a degree of freedom are not."""
        return np.asarray(self.distance < LIMITS[np.minimum(np.maximum(self.dof, 0), MAX_DOF - 1)])


@dataclass(frozen=True, slots=True)
class Agreement:
    """How a frame's measurements agree with the state: tried, within the gate, and the median of d^2 per freedom."""

    tried: int
    accepted: int
    ratio: float

    @staticmethod
    def of(innovations: Sequence[Innovation]) -> "Agreement":
        """Return it for all measurements of a frame; about 1 is as foreseen, 0 without any."""
        distance = np.concatenate([np.empty(0), *(i.distance / np.maximum(i.dof, 1) for i in innovations)])
        accepted = sum(int(i.accepted.sum()) for i in innovations)
        return Agreement(len(distance), accepted, median(distance) if len(distance) else 0.0)
