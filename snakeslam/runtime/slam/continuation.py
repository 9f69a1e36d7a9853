"""Lets a slam node that was started again go on in the world of the one before it.

The robot is held while slam is silent, so the first pose of the new slam is the last pose of the old one. With V the
world of the new slam, T_WV = Yaw(T_WI_last T_VI_first^-1): yaw and translation only, because both know where down is.

If the robot has moved since, or the last pose was in a map that nothing tied to the first one, the poses are moved in
the same way, but the map counts as not connected: the keyframes that could tie the two were lost with the old slam.
"""

from dataclasses import replace

import numpy as np

from snakeslam.estimation.health import NEW_MAP, TIED, in_map
from snakeslam.geometry import se3
from snakeslam.messages import Float, PoseEstimate, SlamUpdate


def yaw_alignment(T_WI: Float, T_VI: Float) -> Float:
    """Return T_WV (4, 4), of yaw and translation only, that brings the pose ``T_VI`` onto ``T_WI``."""
    R = T_WI[:3, :3] @ T_VI[:3, :3].T
    yaw = np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])
    c, s = np.cos(yaw), np.sin(yaw)
    R_WV = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return se3.from_rt(R_WV, T_WI[:3, 3] - R_WV @ T_VI[:3, 3])


class WorldContinuation:
    """Moves updates into the world of ``last``, the last pose of the slam before; None: nothing is moved.

    Keys of chunks begin after ``first_key``. ``holds`` is False when the robot has moved since ``last``.
    """

    def __init__(self, last: PoseEstimate | None, first_key: int = 0, *, holds: bool = True) -> None:
        self._last = last
        self._connected = last is None or (holds and last.health.map_connected)
        self._first_key = first_key
        self._new_map_reported = False
        self._T_WV: Float | None = None if last is not None else np.eye(4)

    def moved(self, update: SlamUpdate) -> SlamUpdate:
        """Return ``update`` in the old world, with its chunks under new keys; without chunks until there is a pose."""
        if self._last is None:
            return update
        if self._T_WV is None and update.pose is not None:
            self._T_WV = yaw_alignment(self._last.T_WI, update.pose.T_WI)
        T_WV = self._T_WV
        if T_WV is None:
            return replace(update, chunks=())
        chunks = tuple(replace(c, key=c.key + self._first_key, T_WK=T_WV @ c.T_WK) for c in update.chunks)
        pose = None if update.pose is None else _moved_pose(T_WV, update.pose)
        moved = replace(update, pose=pose, chunks=chunks)
        return moved if self._connected else self._unconnected(moved)

    def _unconnected(self, update: SlamUpdate) -> SlamUpdate:
        """Return an update whose maps have numbers from 1 on: number 0 is the map of the slam before."""
        health = in_map(update.health, update.island + 1) if update.health.map_connected else update.health
        pose = None if update.pose is None else replace(update.pose, health=health)
        chunks = tuple(replace(chunk, island=chunk.island + 1) for chunk in update.chunks)
        events = tuple(event for event in update.events if event != TIED)
        first, self._new_map_reported = not self._new_map_reported, True
        return replace(
            update,
            pose=pose,
            health=health if update.pose is not None else update.health,
            chunks=chunks,
            events=(*events, NEW_MAP) if first else events,
            island=update.island + 1,
        )


def _moved_pose(T_WV: Float, pose: PoseEstimate) -> PoseEstimate:
    """Rotate position, velocity and their covariance into W; the attitude's error is in the IMU's frame and stays."""
    J = np.eye(9)
    J[3:6, 3:6] = J[6:9, 6:9] = T_WV[:3, :3]
    return replace(pose, T_WI=T_WV @ pose.T_WI, v_W=T_WV[:3, :3] @ pose.v_W, cov=J @ pose.cov @ J.T)
