"""A backend for the server's tests: a robot whose joints obey and whose head sees one picture, at rest."""

import cv2
import numpy as np

from snakeslam.backends.base import Backend
from snakeslam.calibration import CameraCalibration, ImuCalibration, SensorRig
from snakeslam.messages import CameraFrame, GroundTruth, ImuSample, JointState, JointTarget, Packet
from snakeslam.robot.model import PRESETS, SnakeModel
from snakeslam.runtime.assembly.spec import SessionSpec

STEP_NS = 10_000_000
FRAME_EVERY = 5
BREAKS, ENDS, ENDS_WHEN_MOVED, BREAKS_WHEN_MOVED = 1001, 1002, 1003, 1004
COVERED_WHEN_MOVED, ELSEWHERE_WHEN_MOVED = 1005, 1006
WIDTH, HEIGHT, FOCAL_PX = 320, 240, 240.0


def _picture(rng: np.random.Generator) -> np.ndarray:
    """Return a texture with corners, room left for the noise."""
    coarse = rng.integers(20, 230, (HEIGHT // 10, WIDTH // 10)).astype(np.uint8)
    return cv2.GaussianBlur(np.kron(coarse, np.ones((10, 10), dtype=np.uint8)), (5, 5), 1.0)


class StillRobot(Backend):
    """See the module's docstring; ends after ``end_s``, or once it has moved by ``end_rad``.

    It fails from ``fail_s`` on, or once it has moved by ``fail_rad``.

    With ``cover_rad`` its camera is before a bare wall once it has moved by that much, with ``elsewhere_rad`` somewhere
    else afterwards.
    """

    def __init__(
        self,
        end_s: float = np.inf,
        fail_s: float = np.inf,
        frame_every: int = FRAME_EVERY,
        end_rad: float = np.inf,
        fail_rad: float = np.inf,
        cover_rad: float = np.inf,
        elsewhere_rad: float = np.inf,
    ) -> None:
        self._elsewhere_rad, self._elsewhere = elsewhere_rad, _picture(np.random.default_rng(11))
        self._cover_rad = cover_rad
        self._model = PRESETS["orthogonal24"]
        self._end_s, self._fail_s, self._frame_every, self._end_rad = end_s, fail_s, frame_every, end_rad
        self._fail_rad = fail_rad
        self._t_ns = 0
        self._q_rad = np.zeros(self._model.joint_count)
        self._truth: list[GroundTruth] = []
        self._rng = np.random.default_rng(7)
        self._picture = _picture(self._rng)
        self._moved_rad = 0.0
        self.targets: list[JointTarget] = []

    @property
    def simulated(self) -> bool:
        return False

    @property
    def rig(self) -> SensorRig:
        T_CI = tuple(tuple(row) for row in self._model.T_CI.tolist())
        camera = CameraCalibration(
            T_cam_imu=T_CI,
            intrinsics=(FOCAL_PX, FOCAL_PX, WIDTH / 2.0, HEIGHT / 2.0),
            resolution=(WIDTH, HEIGHT),
            depth_scale=1000.0,
        )
        imu = ImuCalibration(
            gyroscope_noise_density=1e-3,
            gyroscope_random_walk=1e-5,
            accelerometer_noise_density=1e-2,
            accelerometer_random_walk=1e-4,
            update_rate=100.0,
        )
        return SensorRig(cam0=camera, imu0=imu)

    @property
    def model(self) -> SnakeModel:
        return self._model

    @property
    def t_ns(self) -> int:
        return self._t_ns

    def step(self, target: JointTarget | None) -> list[Packet] | None:
        if self._t_ns * 1e-9 >= self._fail_s or self._moved_rad >= self._fail_rad:
            raise RuntimeError("the fake robot\nbroke")
        if self._t_ns * 1e-9 >= self._end_s or self._moved_rad >= self._end_rad:
            return None
        if target is not None:
            self._moved_rad += 0.0 if not self.targets else float(np.abs(target.q_rad - self._q_rad).max())
            self.targets.append(target)
            self._q_rad = target.q_rad
        self._t_ns += STEP_NS
        t_ns, zero = self._t_ns, np.zeros_like(self._q_rad)
        self._truth.append(GroundTruth(t_ns, np.eye(4)))
        packets: list[Packet] = [
            ImuSample(t_ns, self._rng.normal(0.0, 1e-3, 3), self._rng.normal([0.0, 0.0, 9.81], 1e-2)),
            JointState(t_ns, self._q_rad, zero, zero, zero),
        ]
        seq, phase = divmod(t_ns // STEP_NS, self._frame_every)
        if phase == 0:
            depth_m = np.full((HEIGHT, WIDTH), 1.0, dtype=np.float32)
            # A camera that gives the same picture twice counts as frozen.
            seen = self._picture if self._moved_rad < self._cover_rad else np.full_like(self._picture, 90)
            if self._moved_rad >= self._elsewhere_rad:
                seen = self._elsewhere
            gray = seen + self._rng.integers(0, 5, seen.shape, dtype=np.uint8)
            rgb = np.repeat(gray[:, :, None], 3, axis=2)
            packets.append(CameraFrame(t_ns, seq, gray, rgb, depth_m, exposure_ns=1_000_000))
        return packets

    def read_ground_truth(self) -> list[GroundTruth]:
        truth, self._truth = self._truth, []
        return truth

    def close(self) -> None:
        pass


def still_robot(spec: SessionSpec) -> StillRobot:
    """Return the robot; the seed says how it behaves."""
    seed = spec.config.run.seed
    return StillRobot(
        end_s=0.5 if seed == ENDS else np.inf,
        fail_s=0.3 if seed == BREAKS else np.inf,
        end_rad=0.01 if seed == ENDS_WHEN_MOVED else np.inf,
        fail_rad=0.01 if seed == BREAKS_WHEN_MOVED else np.inf,
        cover_rad=0.5 if seed in (COVERED_WHEN_MOVED, ELSEWHERE_WHEN_MOVED) else np.inf,
        elsewhere_rad=3.0 if seed == ELSEWHERE_WHEN_MOVED else np.inf,
    )
