"""The parts of the filter's state whose number changes: pose clones and landmarks, each with first estimates."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.messages import Float


@dataclass(slots=True)
class Clones:
    """Poses of the IMU at the times of the window's n frames, oldest first, with their first estimates."""

    t_ns: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    R_WI: Float = field(default_factory=lambda: np.empty((0, 3, 3)))
    p_WI: Float = field(default_factory=lambda: np.empty((0, 3)))
    R_fej: Float = field(default_factory=lambda: np.empty((0, 3, 3)))
    p_fej: Float = field(default_factory=lambda: np.empty((0, 3)))

    def __len__(self) -> int:
        return len(self.t_ns)

    def append(self, t_ns: int, R_WI: Float, p_WI: Float, R_fej: Float, p_fej: Float) -> None:
        """Append the newest clone."""
        self.t_ns = np.append(self.t_ns, np.int64(t_ns))
        self.R_WI, self.R_fej = np.concatenate([self.R_WI, R_WI[None]]), np.concatenate([self.R_fej, R_fej[None]])
        self.p_WI, self.p_fej = np.concatenate([self.p_WI, p_WI[None]]), np.concatenate([self.p_fej, p_fej[None]])

    def delete(self, k: int) -> None:
        """Remove clone ``k``."""
        self.t_ns = np.delete(self.t_ns, k)
        self.R_WI, self.R_fej = np.delete(self.R_WI, k, axis=0), np.delete(self.R_fej, k, axis=0)
        self.p_WI, self.p_fej = np.delete(self.p_WI, k, axis=0), np.delete(self.p_fej, k, axis=0)


@dataclass(slots=True)
class Landmarks:
    """Points in W that stay in the state while their feature is tracked: ``p_W`` (L, 3) with first estimates."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    p_W: Float = field(default_factory=lambda: np.empty((0, 3)))
    p_fej: Float = field(default_factory=lambda: np.empty((0, 3)))
    rejections: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    """Number of frames in succession in which each landmark has failed its gate."""

    def __len__(self) -> int:
        return len(self.ids)

    def append(self, ids: NDArray[np.int64], p_W: Float) -> None:
        """Append points (k, 3); their present estimates are their first ones."""
        self.ids = np.concatenate([self.ids, ids])
        self.p_W, self.p_fej = np.concatenate([self.p_W, p_W]), np.concatenate([self.p_fej, p_W])
        self.rejections = np.concatenate([self.rejections, np.zeros(len(ids), np.int64)])

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Remove the landmarks that are not ``kept`` (L,)."""
        self.ids, self.rejections = self.ids[kept], self.rejections[kept]
        self.p_W, self.p_fej = self.p_W[kept], self.p_fej[kept]
