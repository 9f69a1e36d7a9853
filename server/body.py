"""Where the robot's body is drawn, its heading, and the mean path of a head that swings."""

import numpy as np

from server.view import View
from snakeslam.messages import Float
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import snake_model
from snakeslam.runtime.bus.topics import Tick

USUAL_PERIOD_S = 4.0
Row = tuple[float, float, float, float]


def body_links(view: View, tick: Tick) -> Float | None:
    """Return Ts_WL (N + 1, 4, 4), tail to head; before the first estimate as the joints are, the head at the origin.

    None where nothing is known of the body: a recording without joints, or an estimate that was lost.
    """
    if tick.Ts_WL is not None:
        return tick.Ts_WL
    if tick.q_measured_rad is None or view.kind != "sim" or view.estimate.rows:
        return None
    model = snake_model(view.config.robot)
    if len(tick.q_measured_rad) != model.joint_count:
        return None
    return link_poses_from_imu(model, tick.q_measured_rad, np.eye(4))


def heading_rad(tick: Tick, Ts_WL: Float) -> float:
    """Return where the robot is heading: the head's mean heading over a period, else the direction of the body."""
    if tick.head.heading_deg is not None:
        return float(np.deg2rad(tick.head.heading_deg))
    along_W = np.sum(Ts_WL[:, :2, 0], axis=0)
    return float(np.arctan2(along_W[1], along_W[0]))


def mean_path(rows: list[Row], period_s: float) -> Float:
    """Return the path (M, 3) m of a swinging head averaged over ``period_s``, centred; at the ends over what there is.

    ``rows`` are (t_s, x, y, z) in order of time.
    """
    table = np.asarray(rows, dtype=np.float64).reshape(-1, 4)
    t_s = table[:, 0]
    reach_s = np.minimum(period_s / 2.0, np.minimum(t_s - t_s[0], t_s[-1] - t_s)) if len(table) else t_s
    first = np.searchsorted(t_s, t_s - reach_s, side="left")
    after = np.searchsorted(t_s, t_s + reach_s, side="right")
    sums = np.vstack([np.zeros(3), np.cumsum(table[:, 1:], axis=0)])
    return (sums[after] - sums[first]) / (after - first)[:, None]
