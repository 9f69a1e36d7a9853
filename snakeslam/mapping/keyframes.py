"""Which frames become keyframes, and the chunk that each one adds to the map."""

import numpy as np

from snakeslam.calibration import CameraCalibration
from snakeslam.estimation.camera import PinholeCamera
from snakeslam.geometry import se3, so3
from snakeslam.mapping.chunks import depth_points
from snakeslam.mapping.settings import MappingSettings
from snakeslam.mapping.voxels import Voxels
from snakeslam.messages import CameraFrame, Float, MapChunk


class KeyframeMapper:
    """Takes frames with their poses; gives a chunk where the view is new."""

    def __init__(self, settings: MappingSettings, calibration: CameraCalibration) -> None:
        self._settings = settings
        self._camera = PinholeCamera(calibration)
        self._voxels = Voxels(settings.voxel_m)
        self._Ts_WK = np.empty((0, 4, 4))
        self._last: tuple[int, Float] | None = None

    def update(self, frame: CameraFrame, T_WC: Float) -> tuple[MapChunk, ...]:
        """Return the new chunk of a frame: the points of a new view where the map has none; nothing if blurred."""
        blurred = self._turns_fast(frame.t_ns, T_WC)
        if frame.depth_m is None or blurred or not self._is_new(T_WC):
            return ()
        points_K, rgb = depth_points(frame, self._camera, self._settings)
        self._Ts_WK = np.concatenate([self._Ts_WK, T_WC[None]])
        chosen = self._voxels.fill(se3.act(T_WC, points_K), self._settings.max_points)
        if not len(chosen):
            return ()
        return (MapChunk(len(self._Ts_WK) - 1, 0, T_WC, points_K[chosen].astype(np.float32), rgb[chosen]),)

    def _turns_fast(self, t_ns: int, T_WC: Float) -> bool:
        last, self._last = self._last, (t_ns, T_WC)
        if last is None or t_ns <= last[0]:
            return False
        angle_rad = np.linalg.norm(so3.log(last[1][:3, :3].T @ T_WC[:3, :3]))
        return bool(np.rad2deg(angle_rad) > self._settings.max_rate_deg_s * (t_ns - last[0]) / 1e9)

    def _is_new(self, T_WC: Float) -> bool:
        """Whether no keyframe is both near and turned the same way."""
        to_keyframes = self._Ts_WK[:, :3, 3] - T_WC[:3, 3]
        far = np.einsum("ni,ni->n", to_keyframes, to_keyframes) > self._settings.keyframe_distance_m**2
        cosine = (np.einsum("nij,ij->n", self._Ts_WK[:, :3, :3], T_WC[:3, :3]) - 1.0) / 2.0
        turned = cosine < np.cos(np.deg2rad(self._settings.keyframe_angle_deg))
        return bool(np.all(far | turned))
