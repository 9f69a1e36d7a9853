"""Numeric Jacobians, against which the analytic ones are tested."""

from collections.abc import Callable

import numpy as np

from snakeslam.geometry.so3 import Array


def jacobian(f: Callable[[Array], Array], size: int, step: float = 1e-6) -> Array:
    """Return df/dd at d = 0 by central differences, for f: (size,) -> (m,); result (m, size)."""
    columns = []
    for k in range(size):
        d = np.zeros(size)
        d[k] = step
        columns.append((np.ravel(f(d)) - np.ravel(f(-d))) / (2.0 * step))
    return np.stack(columns, axis=-1)
