"""The map as a PLY file: only what is new of it is transformed, and the file is made once for all who ask."""

import numpy as np
from numpy.typing import NDArray

from server.bulk import Bulk, Made
from server.live import Live
from snakeslam.mapping.export import ply_bytes, ply_vertices
from snakeslam.messages import MapChunk

AGE_S = 1.0


class MapFile:
    """The newest file of the live session's map; at most AGE_S old."""

    def __init__(self, live: Live, bulk: Bulk) -> None:
        self._live = live
        self._known: dict[int, tuple[MapChunk, NDArray[np.void]]] = {}
        self._made = Made(bulk, self._make, lambda: (id(live.view), live.view.map_revision), AGE_S)

    async def get(self) -> bytes:
        """Return the file."""
        return await self._made.get()

    def _make(self) -> bytes:
        chunks = dict(self._live.view.chunks)
        known, self._known = self._known, {}
        for key in sorted(chunks):
            chunk, before = chunks[key], known.get(key)
            same = before is not None and before[0] is chunk
            self._known[key] = before if same and before is not None else (chunk, ply_vertices(chunk))
        return ply_bytes([vertices for _, vertices in self._known.values()])
