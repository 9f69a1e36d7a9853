"""The median of few numbers, which each frame needs several times."""

from snakeslam.geometry.compiled import compiled
from snakeslam.geometry.so3 import Array


@compiled
def median(values: Array) -> float:
    """Return the median of ``values`` (N,), N >= 1; numpy's own takes twenty times as long on a few."""
    ordered = values.copy()
    ordered.sort()
    middle = len(ordered) // 2
    if len(ordered) % 2:
        return float(ordered[middle])
    return float(0.5 * (ordered[middle - 1] + ordered[middle]))
