"""Parts of the filter's state that come and go: pose clones and landmarks, each with first estimates."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.messages import Float


@dataclass(slots=True)
class Clones:
    """The IMU's poses at the times of the window's frames, oldest first, with their first estimates; n of them."""

    t_ns: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    R_WI: Float = field(default_factory=lambda: np.empty((0, 3, 3)))
    p_WI: Float = field(default_factory=lambda: np.empty((0, 3)))
    R_fej: Float = field(default_factory=lambda: np.empty((0, 3, 3)))
    p_fej: Float = field(default_factory=lambda: np.empty((0, 3)))

    def __len__(self) -> int:
        return len(self.t_ns)

    def append(self, t_ns: int, R_WI: Float, p_WI: Float, R_fej: Float, p_fej: Float) -> None:
        """Add the newest."""
        self.t_ns = np.append(self.t_ns, np.int64(t_ns))
        self.R_WI, self.R_fej = np.concatenate([self.R_WI, R_WI[None]]), np.concatenate([self.R_fej, R_fej[None]])
        self.p_WI, self.p_fej = np.concatenate([self.p_WI, p_WI[None]]), np.concatenate([self.p_fej, p_fej[None]])

    def delete(self, k: int) -> None:
        """Remove one."""
        self.t_ns = np.delete(self.t_ns, k)
        self.R_WI, self.R_fej = np.delete(self.R_WI, k, axis=0), np.delete(self.R_fej, k, axis=0)
        self.p_WI, self.p_fej = np.delete(self.p_WI, k, axis=0), np.delete(self.p_fej, k, axis=0)


@dataclass(slots=True)
class Landmarks:
    """Points in W that stay in the state as long as their tracks last: ``p_W`` (L, 3) with first estimates."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    p_W: Float = field(default_factory=lambda: np.empty((0, 3)))
    p_fej: Float = field(default_factory=lambda: np.empty((0, 3)))
    rejections: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    """How often in a row each has failed the gate."""

    def __len__(self) -> int:
        return len(self.ids)

    def append(self, ids: NDArray[np.int64], p_W: Float) -> None:
        """Add points (k, 3) whose first estimates are their present ones."""
        self.ids = np.concatenate([self.ids, ids])
        self.p_W, self.p_fej = np.concatenate([self.p_W, p_W]), np.concatenate([self.p_fej, p_W])
        self.rejections = np.concatenate([self.rejections, np.zeros(len(ids), np.int64)])

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Remove the others."""
        self.ids, self.rejections = self.ids[kept], self.rejections[kept]
        self.p_W, self.p_fej = self.p_W[kept], self.p_fej[kept]
