"""The transform from the world of ``vio`` to that of the planar filter, which changes when ``vio`` starts anew."""

import numpy as np

from snakeslam.estimation.planar.motion import rotation
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float


class WorldAlignment:
    """``T`` (4, 4), a yaw and a horizontal shift, chosen so that the head is where the planar filter has it.

    ``cov`` (3, 3) is the covariance of the head's (x, y, yaw) when it was chosen, at ``head`` (3,).
    """

    def __init__(self, head: Float, cov: Float, T: Float | None = None) -> None:
        self.head, self.cov = head, cov
        self.T = np.eye(4) if T is None else T

    def realigned(self, vio: Float, head: Float, cov: Float, drift: Float) -> "WorldAlignment":
        """Return the alignment that brings ``vio`` (3,), the (x, y, yaw) of the new start, to the filter's ``head``."""
        dyaw = head[2] - vio[2]
        T = se3.from_rt(so3.from_yaw(dyaw), np.array([*(head[:2] - rotation(dyaw) @ vio[:2]), 0.0]))
        return WorldAlignment(head, self.cov_at(head) + cov + drift, T)

    def cov_at(self, head: Float) -> Float:
        """Return J cov J^T for a head that has moved on: an error of the yaw displaces it across its displacement."""
        J = np.eye(3)
        J[:2, 2] = rotation(np.pi / 2.0) @ (head[:2] - self.head[:2])
        return J @ self.cov @ J.T
