"""The map from keyframes: which frames become keyframes, and the chunk of points that each one adds."""

from dataclasses import dataclass, field, replace

import numpy as np

from snakeslam.calibration import CameraCalibration
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.geometry import se3, so3
from snakeslam.mapping.chunks import depth_points
from snakeslam.mapping.settings import MappingSettings
from snakeslam.mapping.voxels import Voxels
from snakeslam.messages import CameraFrame, Float, MapChunk, MapTie


@dataclass(slots=True)
class _Island:
    """One map: its occupied voxels, the poses of its keyframes (K, 4, 4), and its chunks.

    The chunks of the first map, which never moves, are not kept.
    """

    voxels: Voxels
    Ts_WK: Float = field(default_factory=lambda: np.empty((0, 4, 4)))
    chunks: list[MapChunk] = field(default_factory=list)


class KeyframeMapper:
    """Adds keyframes from frames with their poses; one map for each number, until a tie connects them."""

    def __init__(self, settings: MappingSettings, calibration: CameraCalibration) -> None:
        self._settings = settings
        self._camera = PinholeCamera(calibration)
        self._islands: dict[int, _Island] = {}
        self._keyframes = 0
        self._last: tuple[int, Float] | None = None

    def update(self, frame: CameraFrame, T_WC: Float, number: int = 0) -> tuple[MapChunk, ...]:
        """Return the chunk that a frame adds, or nothing if its view is not new, it is blurred or has no depth.

        ``number`` is the number of the map, 0 for the first one and all that are tied to it. A chunk has those points
        of the frame whose voxels are empty.
        """
        island = self._island(number)
        blurred = self._rotates_fast(frame.t_ns, T_WC)
        if frame.depth_m is None or blurred or not _is_new(island.Ts_WK, T_WC, self._settings):
            return ()
        points_K, rgb = depth_points(frame, self._camera, self._settings)
        island.Ts_WK = np.concatenate([island.Ts_WK, T_WC[None]])
        key, self._keyframes = self._keyframes, self._keyframes + 1
        chosen = island.voxels.fill(se3.act(T_WC, points_K), self._settings.max_points)
        if not len(chosen):
            return ()
        chunk = MapChunk(key, 0, T_WC, points_K[chosen].astype(np.float32), rgb[chosen], number)
        if number:
            island.chunks.append(chunk)
        return (chunk,)

    def tie(self, tie: MapTie) -> tuple[MapChunk, ...]:
        """Move a map into an earlier one, T_WK <- T T_WK; return its chunks there, each with its next revision."""
        moved, into = self._islands.pop(tie.island, None), self._island(tie.into)
        # The pose of the last frame is one of the other map: it gives no rotation rate.
        self._last = None
        if moved is None:
            return ()
        into.Ts_WK = np.concatenate([into.Ts_WK, tie.T @ moved.Ts_WK])
        chunks = [replace(c, revision=c.revision + 1, T_WK=tie.T @ c.T_WK, island=tie.into) for c in moved.chunks]
        for chunk in chunks:
            into.voxels.fill(se3.act(chunk.T_WK, chunk.points_K.astype(np.float64)), len(chunk.points_K))
        if tie.into:
            into.chunks += chunks
        return tuple(chunks)

    def _island(self, number: int) -> _Island:
        return self._islands.setdefault(number, _Island(Voxels(self._settings.voxel_m)))

    def _rotates_fast(self, t_ns: int, T_WC: Float) -> bool:
        """Return whether the camera has rotated since the last frame so fast that the image is blurred."""
        last, self._last = self._last, (t_ns, T_WC)
        if last is None or t_ns <= last[0]:
            return False
        angle_rad = np.linalg.norm(so3.log(last[1][:3, :3].T @ T_WC[:3, :3]))
        return bool(np.rad2deg(angle_rad) > self._settings.max_rate_deg_s * (t_ns - last[0]) / 1e9)


def _is_new(Ts_WK: Float, T_WC: Float, settings: MappingSettings) -> bool:
    """Return whether no keyframe has both a similar position and a similar orientation."""
    to_keyframes = Ts_WK[:, :3, 3] - T_WC[:3, 3]
    far = np.einsum("ni,ni->n", to_keyframes, to_keyframes) > settings.keyframe_distance_m**2
    cosine = (np.einsum("nij,ij->n", Ts_WK[:, :3, :3], T_WC[:3, :3]) - 1.0) / 2.0
    # Angle of R_WK^T R_WC by its trace, cos = (tr - 1) / 2.
    rotated = cosine < np.cos(np.deg2rad(settings.keyframe_angle_deg))
    return bool(np.all(far | rotated))
