"""What is known of each tracked feature: where it was seen, and how deep."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.messages import Float


@dataclass(slots=True)
class Track:
    """Observations of one feature in the window, oldest first: time, normalised (x, y), depth in m (0 = unknown)."""

    track_id: int
    t_ns: list[int] = field(default_factory=list[int])
    xyz: list[tuple[float, float, float]] = field(default_factory=list[tuple[float, float, float]])
    has_depth: bool = False
    """Whether any observation has had a depth."""

    @property
    def length(self) -> int:
        """Number of observations held."""
        return len(self.t_ns)

    def forget(self, t_ns: int) -> None:
        """Drop the observation at a time, if there is one."""
        if t_ns in self.t_ns:
            k = self.t_ns.index(t_ns)
            del self.t_ns[k], self.xyz[k]


class TrackStore:
    """The tracks by id."""

    def __init__(self) -> None:
        self._tracks: dict[int, Track] = {}

    def observe(self, t_ns: int, ids: NDArray[np.int64], xy: Float, depth_m: Float) -> None:
        """Add one frame's observations, all of the same length."""
        for track_id, (x, y), z in zip(ids.tolist(), xy.tolist(), depth_m.tolist(), strict=True):
            track = self._tracks.setdefault(track_id, Track(track_id))
            track.t_ns.append(t_ns)
            track.xyz.append((x, y, z))
            track.has_depth |= z > 0.0

    def take_lost(self, alive: set[int]) -> list[Track]:
        """Remove and return the tracks that are not among the living."""
        gone = [track_id for track_id in self._tracks if track_id not in alive]
        return [self._tracks.pop(track_id) for track_id in gone]

    def drop(self, track_ids: set[int]) -> None:
        """Remove tracks."""
        for track_id in track_ids:
            self._tracks.pop(track_id, None)

    def forget(self, t_ns: int) -> None:
        """Drop all observations of a time that has left the window."""
        for track in self._tracks.values():
            track.forget(t_ns)

    def clear(self) -> None:
        """Drop everything."""
        self._tracks.clear()

    def all(self) -> list[Track]:
        """Return the tracks, oldest first."""
        return list(self._tracks.values())

    def get(self, track_id: int) -> Track | None:
        """Return a track by id."""
        return self._tracks.get(track_id)
