"""One run of a study: simulated, measured over whole gait periods; nothing written."""

import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace

import numpy as np

from snakeslam.backends.base import Backend
from snakeslam.errors import BackendError
from snakeslam.estimation.settings import Mode
from snakeslam.geometry import so3
from snakeslam.messages import Float, SlamUpdate
from snakeslam.runtime.assembly.build import build_backend, build_slam
from snakeslam.runtime.session.lockstep import build_loop
from snakeslam.studies.broadcast import Broadcast, Listener
from snakeslam.studies.experiment import run_loop
from snakeslam.studies.measures import MEASURES, MeasureName
from snakeslam.studies.metrics import HeadWindow, Metrics, evaluate, net_speed_m_s, truth_trajectory, whole_periods
from snakeslam.studies.study import Point
from snakeslam.studies.trajectories import Trajectory

HALF_SAMPLE_NS = 2_500_000
"""Half the IMU's interval, at which the truth is known."""
SERIES_STRIDE = 4
Values = dict[MeasureName, float | None]


@dataclass(frozen=True, slots=True)
class Measured:
    """Measured values, None where unknown, and the head's path in the measured window.

    ``heard``: the values of the other estimators. ``series`` (n, 4): time since its beginning in s, yaw about its
    mean in rad, x and y in W in m; 50 Hz.
    """

    values: Values
    series: Float
    heard: dict[Mode, Values] = field(default_factory=dict[Mode, Values])


def run_point(point: Point) -> Measured:
    """Run ``point`` and measure it; deterministic.

    Camera and estimator take part only where the point has them; the motion of a robot whose control does not feed the
    estimate back is the same without. BackendError when the motion is not finite.
    """
    config = point.config
    with closing(build_backend(config, "here" if point.estimator else "none")) as backend:
        recorder = Broadcast(_listeners(point, backend))
        loop = build_loop(config, backend, recorder, slam=point.estimator, autostart=True)
        end_ns = backend.t_ns + round(config.run.duration_s * 1e9)
        wall_s = run_loop(loop, end_ns, lambda _: None)
        gravity_known = backend.rig.imu0 is not None
    return _measured(point, recorder, wall_s, gravity_known)


def _measured(point: Point, recorder: Broadcast, wall_s: float, gravity_known: bool) -> Measured:
    """Judge the loop's estimates and those of each listener against the same truth."""
    window = _window(truth_trajectory(recorder.truth), point)
    head = HeadWindow(int(window.t_ns[0]), point.period_s)

    def judged(updates: Sequence[SlamUpdate], frame_ms: Sequence[float]) -> Values:
        metrics = evaluate(
            updates,
            recorder.truth,
            frame_ms,
            duration_s=recorder.duration_s,
            wall_s=wall_s,
            gravity_known=gravity_known,
            head=head,
        )
        return _values(point, replace(metrics, speed_m_s=net_speed_m_s(window)))

    heard: dict[Mode, Values] = {m: judged(one.updates, one.frame_ms) for m, one in recorder.listeners.items()}
    return Measured(judged(recorder.updates, recorder.frame_ms), _series(window), heard)


def _listeners(point: Point, backend: Backend) -> dict[Mode, Listener]:
    """Return the estimators beside the first, which the loop has; each with a mapper, as it would have alone."""
    config, found = point.config, dict[Mode, Listener]()
    for mode in point.estimators[1:]:
        estimator = config.estimator.model_copy(update={"mode": mode})
        found[mode] = Listener(build_slam(config.model_copy(update={"estimator": estimator}), backend))
    return found


def _window(truth: Trajectory, point: Point) -> Trajectory:
    """Return the last whole periods that are to be measured."""
    if not np.all(np.isfinite(truth.Ts_WI)):
        raise BackendError("the simulated motion is not finite")
    from_ns = truth.t_ns[-1] - round(point.measured_periods * point.period_s * 1e9) - HALF_SAMPLE_NS
    return whole_periods(truth.at(truth.t_ns >= from_ns), point.period_s)


def _values(point: Point, metrics: Metrics) -> Values:
    values: Values = {name: MEASURES[name].of(metrics) for name in point.measure}
    broken = next((name for name, value in values.items() if value is not None and not math.isfinite(value)), None)
    if broken is not None:
        raise BackendError(f"{broken} is not finite")
    return values


def _series(window: Trajectory) -> Float:
    yaw_rad = np.unwrap(so3.yaw(window.Ts_WI[:, :3, :3]))
    t_s = (window.t_ns - window.t_ns[0]) / 1e9
    return np.column_stack([t_s, yaw_rad - np.mean(yaw_rad), window.Ts_WI[:, :2, 3]])[::SERIES_STRIDE]
