"""Lets a slam that was started anew go on in the world of the one before it.

The robot is held while slam is silent, so the first new pose is the last old one: T_WV = Yaw(T_WI_last T_VI_first^-1)
brings the new world V onto the old W, by yaw and translation, as both know where down is.

Where the robot has moved since, or that pose was itself in a map that nothing tied to the first one, the same is done,
but the map is said not to be connected: nothing can tie the two, for the keyframes died with the slam before.
"""

from dataclasses import replace

import numpy as np

from snakeslam.estimation.health import NEW_MAP, TIED, in_map
from snakeslam.messages import Float, PoseEstimate, SlamUpdate
from snakeslam.runtime.view.live import yaw_alignment


class Anchor:
    """Moves updates into the world of ``last`` (None: there is none, and nothing is moved)."""

    def __init__(self, last: PoseEstimate | None, first_key: int = 0, *, holds: bool = True) -> None:
        self._last = last
        self._connected = last is None or (holds and last.health.map_connected)
        self._first_key = first_key
        self._told = False
        self._T_WV: Float | None = None if last is not None else np.eye(4)

    def moved(self, update: SlamUpdate) -> SlamUpdate:
        """Return ``update`` in the old world, its chunks under keys of their own."""
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
        return moved if self._connected else self._apart(moved)

    def _apart(self, update: SlamUpdate) -> SlamUpdate:
        """Return an update whose every map is a new one: number 0 is that of the map before."""
        health = in_map(update.health, update.island + 1) if update.health.map_connected else update.health
        pose = None if update.pose is None else replace(update.pose, health=health)
        chunks = tuple(replace(chunk, island=chunk.island + 1) for chunk in update.chunks)
        events = tuple(event for event in update.events if event != TIED)
        first, self._told = not self._told, True
        return replace(
            update,
            pose=pose,
            health=health if update.pose is not None else update.health,
            chunks=chunks,
            events=(*events, NEW_MAP) if first else events,
            island=update.island + 1,
        )


def _moved_pose(T_WV: Float, pose: PoseEstimate) -> PoseEstimate:
    """Position and velocity, and their covariance, turn with the world; the attitude's error is the IMU's own."""
    turn = np.eye(9)
    turn[3:6, 3:6] = turn[6:9, 6:9] = T_WV[:3, :3]
    return replace(pose, T_WI=T_WV @ pose.T_WI, v_W=T_WV[:3, :3] @ pose.v_W, cov=turn @ pose.cov @ turn.T)
