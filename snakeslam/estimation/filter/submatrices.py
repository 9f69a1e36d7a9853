"""Submatrices of a covariance or an information matrix; numpy's indexing by two arrays takes several times as long."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float


@compiled
def submatrix(matrix: Float, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Float:
    """Return ``matrix[rows][:, columns]``, (len(rows), len(columns)), for index arrays (n,) and (m,)."""
    out = np.empty((len(rows), len(columns)))
    for i in range(len(rows)):
        row = matrix[rows[i]]
        for j in range(len(columns)):
            out[i, j] = row[columns[j]]
    return out


@compiled
def add_to_submatrix(matrix: Float, rows: NDArray[np.int64], added: Float) -> None:
    """Add ``added`` (n, n) to ``matrix[rows][:, rows]`` in place."""
    for i in range(len(rows)):
        for j in range(len(rows)):
            matrix[rows[i], rows[j]] += added[i, j]
