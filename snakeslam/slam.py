"""One page: packets in, estimates and map changes out. No clock, thread, file or socket."""

from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.estimation.base import Estimator, FrameEstimate
from snakeslam.estimation.gait.sensor import GaitSensor
from snakeslam.estimation.planar.dead_reckoning import GaitDeadReckoning
from snakeslam.estimation.planar.odometry import PlanarOdometry
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.start.plausibility import check_camera
from snakeslam.estimation.vio.odometry import VisualInertialOdometry
from snakeslam.estimation.visual.odometry import VisualOdometry
from snakeslam.mapping.keyframes import KeyframeMapper
from snakeslam.mapping.settings import MappingSettings
from snakeslam.messages import CameraFrame, JointTarget, MapChunk, Packet, SlamUpdate, check_packet
from snakeslam.robot.model import SnakeModel


def build_estimator(
    settings: EstimatorSettings, rig: SensorRig, seed: int, model: SnakeModel | None = None
) -> Estimator:
    """Return the estimator that ``settings.mode`` names.

    InputError when it needs a sensor that is not there, or when no camera can have such a calibration.
    """
    check_camera(rig.cam0)
    if settings.mode == "visual":
        return VisualOdometry(settings.visual, settings.noise, settings.health.max_blind_s, rig, seed)
    if settings.mode == "vio":
        return VisualInertialOdometry(settings, rig, seed)
    if settings.mode == "planar":
        if rig.imu0 is None:
            raise InputError("estimator.mode", "'planar' needs an IMU, and this recording has none", "visual")
        return PlanarOdometry(
            settings.planar, settings.max_iterations, VisualInertialOdometry(settings, rig, seed), model
        )
    if settings.mode == "gait":
        return GaitDeadReckoning(settings.planar, model)
    if model is None:
        raise InputError("estimator.mode", "'fused' needs a robot's joints, and here are none", "visual, vio")
    return VisualInertialOdometry(settings, rig, seed, gait=GaitSensor(model, settings.gait))


class Slam:
    """The estimator followed by the mapper; the same in a scripted run, live and over a recording."""

    def __init__(
        self,
        estimator: EstimatorSettings,
        mapping: MappingSettings,
        rig: SensorRig,
        seed: int,
        model: SnakeModel | None = None,
    ) -> None:
        self._estimator = build_estimator(estimator, rig, seed, model)
        self._mapper = KeyframeMapper(mapping, rig.cam0)
        self._T_IC = rig.cam0.T_IC

    def expect(self, target: JointTarget) -> None:
        """Take what control commanded: the roll of a rolling gait helps to follow features."""
        self._estimator.expect_roll(target.t_ns, target.head_roll_rad)

    def process(self, packet: Packet) -> SlamUpdate | None:
        """Take one packet, in time order; return an update for every camera frame and None otherwise.

        BackendError for a packet of an unknown type.
        """
        check_packet(packet)
        estimate = self._estimator.process(packet)
        if estimate is None or not isinstance(packet, CameraFrame):
            return None
        return SlamUpdate(
            t_ns=estimate.t_ns,
            seq=estimate.seq,
            pose=estimate.pose,
            health=estimate.health,
            tracks_px=estimate.tracks_px,
            track_ids=estimate.track_ids,
            track_inliers=estimate.track_inliers,
            chunks=self._map(packet, estimate),
            events=estimate.events,
            island=estimate.island,
            tie=estimate.tie,
        )

    def _map(self, frame: CameraFrame, estimate: FrameEstimate) -> tuple[MapChunk, ...]:
        """Only frames that the camera supports add to the map; a map that was tied to an earlier one moves there."""
        moved = () if estimate.tie is None else self._mapper.tie(estimate.tie)
        if estimate.pose is None or not estimate.health.verdict.tracked:
            return moved
        T_IC = self._T_IC if estimate.T_IC is None else estimate.T_IC
        return (*moved, *self._mapper.update(frame, estimate.pose.T_WI @ T_IC, estimate.island))
