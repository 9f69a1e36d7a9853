"""The gait as a sensor of ``fused``: joint states in, the displacement of each frame and its faults out."""

from collections import deque

from snakeslam.estimation.filter.preintegration import ImuBuffer, ImuSegments
from snakeslam.estimation.filter.state import State
from snakeslam.estimation.gait.joint_history import JointHistory
from snakeslam.estimation.gait.learning import SlipModel
from snakeslam.estimation.gait.measurement import FilterDisplacement, GaitDisplacement
from snakeslam.estimation.gait.odometry import NS, FrictionOdometry
from snakeslam.estimation.gait.settings import GaitSensorSettings
from snakeslam.messages import JointState
from snakeslam.robot.model import SnakeModel

GATED = 20
"""Number of the last displacements of which half must pass the gate, or the verdict says that the gait disagrees."""


class GaitSensor:
    """The gait of one robot as a sensor beside camera and IMU."""

    def __init__(self, model: SnakeModel, settings: GaitSensorSettings) -> None:
        self.settings = settings
        self.slip = SlipModel(settings)
        self._joints = JointHistory(model.joint_count)
        self._odometry = FrictionOdometry(model, settings)
        self._accepted: deque[bool] = deque(maxlen=GATED)
        self._last_ns: int | None = None
        self._displacement: GaitDisplacement | None = None
        self._reasons: tuple[str, ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """Faults of the gait at the last frame, in words."""
        return self._reasons

    def add(self, joints: JointState) -> None:
        """Add a joint state."""
        self._joints.add(joints)

    def clear(self) -> None:
        """Drop the joint states, after the clock has been set."""
        self._joints.clear()
        self._last_ns = None

    def displacement(self, state: State, imu: ImuBuffer, t_ns: int, frozen: bool) -> GaitDisplacement | None:
        """Return the displacement from the last frame to ``t_ns``, the state's time; None where there is none.

        It starts at the newest clone or, for a ``frozen`` image, at the last frame, which has no clone.
        """
        start_ns, self._last_ns, self._displacement = self._last_ns, t_ns, None
        has_clone = len(state.clones) > 0 and start_ns == int(state.clones.t_ns[-1])
        rotation = imu.segments(start_ns, t_ns) if start_ns is not None else None
        self._reasons = self._faults(start_ns, t_ns)
        if start_ns is None or rotation is None or self._reasons or not (has_clone or frozen):
            return None
        R_WI = state.clones.R_WI[-1] if has_clone else state.R_WI
        rotation = ImuSegments(rotation.gyro_I - state.bias_g, rotation.accel_I, rotation.dt_s)
        modelled = self._odometry.displacement(self._joints, start_ns, t_ns, rotation, R_WI, self.slip.ratio)
        self._joints.forget_before(start_ns)
        if modelled is not None:
            self.slip.update_phase(modelled)
            self._displacement = GaitDisplacement(self.slip.corrected(modelled), self.slip.cov(modelled))
        return self._displacement

    def learn(self, filter_displacement: FilterDisplacement | None, seeing: bool) -> bool:
        """Learn from the filter's own displacement while ``seeing``; return whether it accepted the gait's."""

        if filter_displacement is None or self._displacement is None:
            return False
        self._accepted.append(filter_displacement.accepted)
        if seeing:
            self.slip.learn(self._displacement.modelled, filter_displacement.dp_I, filter_displacement.cov)
        if 2 * sum(self._accepted) < len(self._accepted):
            self._reasons = (*self._reasons, "the gait disagrees with the motion")
        return filter_displacement.accepted

    def _faults(self, start_ns: int | None, t_ns: int) -> tuple[str, ...]:
        """Return the faults of the joint states since ``start_ns``, in words."""
        bad = self._joints.pop_bad_count()
        faults = [f"{bad} joint states were late, not numbers, not possible or of another robot"] if bad else []
        if start_ns is None:
            return tuple(faults)
        if not self._joints.covers(start_ns, t_ns):
            faults.append(f"no joint states for {self._joints.age_ns(t_ns) * NS * 1e3:.0f} ms: without the gait")
        elif self._joints.stuck(start_ns, t_ns):
            faults.append("joint angles do not follow their rates: without the gait")
        return tuple(faults)
