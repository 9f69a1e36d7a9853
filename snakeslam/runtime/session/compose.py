"""One state of the session from the states of robot and slam; pure."""

from dataclasses import replace

import numpy as np

from snakeslam.calibration import SensorRig
from snakeslam.messages import GaitCommand, Health, Verdict
from snakeslam.robot.model import SnakeModel
from snakeslam.runtime.bus.topics import Answer, HeadMotion, RobotShape, RobotState, SlamState, Started, Tick

NO_ESTIMATE = Health(Verdict.INITIALISING)
SILENT = Health(Verdict.LOST, ("the estimator is silent",))


def tick(robot: RobotState, slam: SlamState | None, sender: str, *, slam_alive: bool = True) -> Tick:
    """Return both states as one, with the answer to ``sender``; a silent slam keeps its last pose."""
    answer = next((answer for answer in robot.answers if answer.sender == sender), Answer(sender, 0))
    health = NO_ESTIMATE if slam is None else slam.health
    return Tick(
        t_ns=robot.t_ns,
        commands_done=answer.done,
        moving=robot.moving,
        estop_reason=robot.estop_reason,
        gait=robot.gait,
        health=health if slam_alive else replace(SILENT, map_connected=health.map_connected),
        realtime_factor=robot.realtime_factor,
        frame_rate_hz=slam.frame_rate_hz if slam is not None and slam_alive else None,
        q_target_rad=robot.q_target_rad,
        q_measured_rad=robot.q_measured_rad,
        T_WI=None if slam is None else slam.T_WI,
        Ts_WL=None if slam is None else slam.Ts_WL,
        T_WI_truth=None if slam is None else slam.T_WI_truth,
        head=HeadMotion() if slam is None else slam.head,
        error_m=None if slam is None else slam.error_m,
        distance_m=None if slam is None else slam.distance_m,
        map_points=0 if slam is None else slam.map_points,
        head_settings=robot.head_settings,
        notice=robot.notice,
        refusals=answer.refusals,
        governed=robot.governed,
        held_because=robot.held_because,
        back_up_offered=robot.back_up_offered,
    )


def started(t_start_ns: int, mode: str, rig: SensorRig, model: SnakeModel | None, gait: GaitCommand | None) -> Started:
    """Return what the page needs to draw the session."""
    camera = rig.cam0
    width, height = camera.resolution
    shape = None
    if model is not None:
        shape = RobotShape(model.name, model.joint_count, model.joint_length_m, model.radius_m)
    fov_y_rad = 2.0 * float(np.arctan2(height / 2.0, camera.intrinsics[1]))
    return Started(t_start_ns, mode, shape, camera.T_IC, fov_y_rad, width / height, gait)
