"""estimator.mode = vio and fused: camera, IMU and, in fused, the gait in one iterated error-state Kalman filter.

``VisualInertialOdometry._process_frame`` is the algorithm: one frame from packet to published pose, step by step. The
state is x = (R_WI, p_WI, v_W, b_g, b_a), the camera's extrinsics where they are not certain, a window of past poses
(clones, as in MSCKF) and landmarks. Equation numbers are the paper's (``snakeslam eq NUMBER``); docs/estimator.md has
the residual and the Jacobian of every measurement.
"""

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.filter.extrinsics import Extrinsics
from snakeslam.estimation.filter.gating import Agreement
from snakeslam.estimation.filter.imu_doubt import MotionDoubt
from snakeslam.estimation.filter.preintegration import ImuBuffer
from snakeslam.estimation.filter.state import CORE, P, State, V
from snakeslam.estimation.frontend.tracking import Frontend, TrackedFeatures
from snakeslam.estimation.gait.measurement import GaitDisplacement
from snakeslam.estimation.gait.sensor import GaitSensor
from snakeslam.estimation.health import NEW_MAP, TIED, Evidence, judge, supports
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.estimation.imaging.roll_prior import RollPrior, with_roll
from snakeslam.estimation.measurements.zero_velocity import STATIONARY_NS, StationaryDetector, StationaryPeriod
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.vio.published import frame_estimate
from snakeslam.estimation.vio.relocalisation import Relocaliser
from snakeslam.estimation.vio.starting import STATIONARY_START, FrameFeatures, Starter
from snakeslam.estimation.vio.window import SensorModel, SlidingWindow, WindowUpdate
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame, Float, Health, ImuSample, JointState, MapTie, Packet, Verdict

MEAN_VELOCITY_NS = 500_000_000
"""The velocity is averaged over this time before it may contradict a stationary image: a tremor averages to zero."""
STATIONARY_SPEED_M_S = 0.01
"""With a faster mean velocity the head is not stationary: slow motion along the optical axis hardly moves an image."""
CLOCK_SET_BACK_FRAMES = 10
"""After so many frames in the past, themselves in order, the clock has been set back; one such frame is only late."""
MAX_RESTART_SIGMA_M = 0.3
"""A lost filter restarts at its last position if that has a smaller sigma, else where the camera last supported it."""


class FeatureSource(Protocol):
    """What tracks features: the front-end, or a simulation of one."""

    def process(self, frame: CameraFrame, T_C1C0: Float, doubted: bool = False) -> TrackedFeatures:
        """Return the features of ``frame``, given about how the camera has moved since, which may be ``doubted``."""
        ...

    def drop(self, ids: NDArray[np.int64]) -> None:
        """Track these no longer."""
        ...


class VisualInertialOdometry:
    """Packets in, one estimate a frame out."""

    def __init__(
        self,
        settings: EstimatorSettings,
        rig: SensorRig,
        seed: int,
        frontend: FeatureSource | None = None,
        gait: GaitSensor | None = None,
    ) -> None:
        if rig.imu0 is None:
            mode = "vio" if gait is None else "fused"
            raise InputError("estimator.mode", f"'{mode}' needs an IMU, and this recording has none", "visual")
        self._settings = settings
        camera = PinholeCamera(rig.cam0)
        self._model = SensorModel.of(settings, rig.cam0, rig.imu0, camera.focal_px)
        self._shift_ns = round(rig.cam0.timeshift_cam_imu * 1e9)
        self._frontend: FeatureSource = frontend or Frontend(
            settings.frontend, camera, seed, round(settings.noise.unknown_exposure_ms * 1e6)
        )
        self._imu = ImuBuffer(rig.imu0)
        self._gait = gait
        self._stationary_detector = StationaryDetector(rig.imu0, camera.focal_px)
        self._roll_prior = RollPrior()
        self._relocaliser = Relocaliser(settings, rig.cam0, seed)
        self._starter = Starter(settings, self._model)
        self._window: SlidingWindow | None = None
        self._last_ns: int | None = None
        """Time of the last frame, and below of the last one whose image was new, on the IMU's clock."""
        self._image_ns: int | None = None
        self._back_ns: list[int] = []
        """Times of frames that came with a stamp in the past, since the last good one."""
        self._v_mean_W, self._v_mean_ns = np.zeros(3), 0
        self._bias_g = np.zeros(3)
        self._supported_ns = 0
        """Time of the last frame that supported the state."""
        self._origin: tuple[float, Float] = (0.0, np.zeros(3))
        """Yaw and position in W at which the next start begins."""

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        """Take the roll that the gait is to give the head: a prior for features where the gyro fails."""
        self._roll_prior.add(t_ns, roll_rad)

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Take one packet; return an estimate for a camera frame."""
        if isinstance(packet, ImuSample):
            self._imu.add(packet)
        elif isinstance(packet, JointState) and self._gait is not None:
            self._gait.add(packet)
        return self._process_frame(packet) if isinstance(packet, CameraFrame) else None

    # -- The algorithm ------------------------------------------------------------------------------------------------

    def _process_frame(self, frame: CameraFrame) -> FrameEstimate:
        """Propagate, track, correct, judge, publish: one frame."""
        limits, last_ns = self._settings.health, self._last_ns

        # 1. Time. The exposure on the IMU's clock, t_I = t_C + t_d, with t_d as calibrated plus as estimated.
        t_ns = frame.t_ns + self._shift_ns + self._estimated_offset_ns()
        refusal = self._refuse_by_time(frame, t_ns)
        if refusal is not None:
            return refusal
        gap_s = self._imu.longest_gap_s(last_ns, t_ns) if last_ns is not None else 0.0
        doubt = self._imu.doubt(last_ns, t_ns) if last_ns is not None else None

        # 2. Propagation. x <- f(x, alpha, beta, gamma) by the pre-integrated IMU, Eq. (23)-(26); P <- F P F^T + Q. Gaps
        #    between the samples, and samples that no motion explains, add their own covariance to Q.
        if self._window is not None:
            self._window.propagate(self._imu.segments(self._window.state.t_ns, t_ns), t_ns, gap_s, doubt)

        # 3. Front-end. Features are searched where the predicted motion T_C1C0 of the camera puts them.
        doubted = (
            doubt is not None or gap_s > limits.max_imu_gap_s or (self._window is None and self._starter.waits_long)
        )
        features = self._frontend.process(frame, self._predicted_motion(t_ns), doubted)
        observed = FrameFeatures(t_ns, features)
        self._last_ns, self._image_ns = t_ns, self._image_ns if features.frozen else t_ns
        if self._window is None:
            return self._try_to_start(frame, observed, gap_s)
        window, state = self._window, self._window.state

        # 4. Gait. The displacement R_k^T (p - p_k) of the head since the last frame, from the joints and the balance of
        #    friction between all links and the ground.
        displacement = (
            self._gait.displacement(state, self._imu, t_ns, features.frozen) if self._gait is not None else None
        )

        # 5. Zero velocity. v = 0, p = p_0, R = R_0 where image, IMU and gait agree that the head is stationary.
        stationary = self._detect_stationary(observed, window, displacement, last_ns)

        # 6. Correction. Tracks that end, landmarks in view, zero velocity and gait, each through its chi-square gate,
        #    in one iterated update, Eq. (41): x_j+1 = x^ [+] K_j (z [-] h(x_j) + H_j (x_j [-] x^)), P = (I - K H) P.
        update = self._correct(window, features, stationary, displacement)
        self._frontend.drop(update.refused)

        # 7. Support. Enough features agree with the state, or the gait holds it while the camera sees nothing.
        evidence = self._weigh(observed, state, update, stationary is not None, gap_s, doubt)
        if self._gait is not None:
            holds = self._gait.learn(update.filter_displacement, supports(evidence, limits))
            evidence = replace(evidence, gait_supports=holds, gait_faults=self._gait.reasons)
            limits = limits.model_copy(update={"max_blind_s": self._gait.settings.max_blind_s}) if holds else limits

        # 8. Relocalisation. After a blind time the position is measured against a keyframe K, p = p_K + R_K p_KI. A map
        #    that was begun anew is tied to the one before when one of that map's keyframes is recognised.
        events: tuple[str, ...] = ()
        tie: MapTie | None = None
        if supports(evidence, limits):
            events = self._relocalise(frame, observed, window, evidence.blind_s)
            tie = self._tie_to_old_map(frame, observed, state)
            self._supported_ns, self._origin = t_ns, (float(so3.yaw(state.R_WI)), state.p_WI)
            evidence = replace(evidence, blind_s=0.0)

        # 9. Verdict. A lost filter publishes no pose and starts anew from its last trusted position.
        self._imu.forget_before(min(state.t_ns - STATIONARY_NS, self._image_ns or state.t_ns))
        health = judge(evidence, limits)
        if health.verdict is Verdict.LOST:
            self._reset(state)
            return frame_estimate(frame, observed, None, health, ("reset",))
        self._bias_g = state.bias_g
        events = (*events, TIED) if tie is not None and tie.into == 0 else events
        return frame_estimate(frame, observed, state, health, events, self._shift_ns, self._relocaliser.island, tie)

    # -- Time ---------------------------------------------------------------------------------------------------------

    @property
    def extrinsics(self) -> tuple[Extrinsics, Float] | None:
        """The filter's estimate of the camera's extrinsics and clock, with its covariance; None while they are held."""
        state = self._window.state if self._window is not None else None
        if state is None or state.extrinsics is None:
            return None
        return state.extrinsics, state.cov[CORE : state.extrinsics_part.stop, CORE : state.extrinsics_part.stop].copy()

    def _estimated_offset_ns(self) -> int:
        """Return the estimate of the camera's time offset beyond its calibration."""
        return 0 if self.extrinsics is None else round(self.extrinsics[0].offset_s * 1e9)

    def _refuse_by_time(self, frame: CameraFrame, t_ns: int) -> FrameEstimate | None:
        """Return what is published of a frame from the past, or far ahead of the IMU; None for every other."""
        if self._last_ns is not None and t_ns <= self._last_ns:
            return self._refuse_past_frame(frame, t_ns)
        ahead_s = self._imu.ahead_s(t_ns)
        if self._window is not None and ahead_s > self._settings.health.max_blind_s:
            health = Health(Verdict.BLIND, (f"the frame's time is {ahead_s:.1f} s ahead of the IMU",))
            return frame_estimate(frame, None, None, health)
        self._back_ns.clear()
        return None

    def _refuse_past_frame(self, frame: CameraFrame, t_ns: int) -> FrameEstimate:
        """Leave out a frame whose time goes back; when the clock itself has been set back, start anew with it."""
        self._back_ns = [*self._back_ns, t_ns] if not self._back_ns or t_ns > self._back_ns[-1] else [t_ns]
        reasons = ("the frame's time goes back",)
        if len(self._back_ns) < CLOCK_SET_BACK_FRAMES:
            return frame_estimate(frame, None, None, Health(Verdict.BLIND, reasons))
        if self._window is not None:
            self._reset(self._window.state)
        self._imu.clear()
        if self._gait is not None:
            self._gait.clear()
        self._last_ns = self._image_ns = None
        self._back_ns.clear()
        return frame_estimate(frame, None, None, Health(Verdict.LOST, (*reasons, "the clock was set back")), ("reset",))

    # -- Steps --------------------------------------------------------------------------------------------------------

    def _predicted_motion(self, t_ns: int) -> Float:
        """Return T_C1C0, about how the camera has moved since the last new image.

        With a state T_C1C0 = (T_WI T_IC)^-1 T_WI0 T_IC, from the newest clone I0; without one only the rotation is
        known, prod exp((w - b_g) dt) by the gyro, or the roll that the gait is to give the head.
        """
        extrinsics = self.extrinsics[0] if self.extrinsics is not None else self._model.camera
        T_IC = se3.from_rt(extrinsics.R_IC, extrinsics.p_IC)
        if self._window is not None and len(self._window.state.clones):
            state = self._window.state
            T_WI0 = se3.from_rt(state.clones.R_WI[-1], state.clones.p_WI[-1])
            return se3.inv(state.T_WI @ T_IC) @ T_WI0 @ T_IC
        trusted = self._image_ns is not None and not self._starter.waits_long
        span = self._imu.segments(self._image_ns, t_ns) if trusted and self._image_ns is not None else None
        if span is None:
            roll_rad = None if self._image_ns is None else self._roll_prior.between(self._image_ns, t_ns)
            return np.eye(4) if roll_rad is None else se3.from_rt(with_roll(np.eye(3), -roll_rad), np.zeros(3))
        R_I0I1 = np.eye(3)
        for step in so3.exp((span.gyro_I - self._bias_g) * span.dt_s[:, None]):
            R_I0I1 = R_I0I1 @ step
        return se3.inv(T_IC) @ se3.from_rt(R_I0I1.T, np.zeros(3)) @ T_IC

    def _detect_stationary(
        self, observed: FrameFeatures, window: SlidingWindow, displacement: GaitDisplacement | None, last_ns: int | None
    ) -> StationaryPeriod | None:
        """Return the evidence that the head is stationary; None when image, IMU, filter or gait see it move.

        A head that is held still on a crawling body looks stationary to image and IMU; the filter's mean velocity and
        the gait know better. In a tremor since the start that velocity is the tremor's, and does not count.
        """
        state, t_ns = window.state, observed.t_ns
        stationary = self._stationary_detector.update(
            t_ns, observed.features, self._imu.recent(t_ns - STATIONARY_NS), state.bias_g
        )
        window.add_vibration(self._stationary_detector.tremor_m_s2, t_ns - (last_ns or t_ns))
        share = min(1.0, (t_ns - self._v_mean_ns) / MEAN_VELOCITY_NS)
        self._v_mean_W, self._v_mean_ns = self._v_mean_W + share * (state.v_W - self._v_mean_W), t_ns
        sigma_v = float(np.sqrt(np.linalg.eigvalsh(state.cov[V, V])[-1]))
        moves = float(np.linalg.norm(self._v_mean_W)) > STATIONARY_SPEED_M_S + sigma_v
        if stationary is None or displacement is not None or (moves and not stationary.since_start):
            return None
        return stationary

    @staticmethod
    def _correct(
        window: SlidingWindow,
        features: TrackedFeatures,
        stationary: StationaryPeriod | None,
        displacement: GaitDisplacement | None,
    ) -> WindowUpdate:
        """Update the window; an image that repeats the one before measures nothing, and the rest is used alone."""
        if not features.frozen:
            return window.correct(features, stationary, displacement)
        if stationary is not None:
            window.correct_stationary(stationary)
        return window.correct_gait(displacement) if displacement is not None else WindowUpdate.none()

    def _weigh(
        self,
        observed: FrameFeatures,
        state: State,
        update: WindowUpdate,
        stationary: bool,
        gap_s: float,
        doubt: MotionDoubt | None,
    ) -> Evidence:
        """Return what camera and IMU say for and against the state."""
        features = observed.features
        return Evidence(
            tracked=features.tracked,
            rejected=len(features.rejected_ids),
            agreement=Agreement.of(update.innovations),
            cov_v=state.cov[V, V],
            blind_s=(observed.t_ns - self._supported_ns) / 1e9,
            frozen=features.frozen,
            stationary=stationary,
            imu_gap_s=gap_s,
            imu_doubts=doubt.reasons if doubt is not None else (),
            bad_samples=self._imu.pop_bad_count(),
        )

    # -- Maps, starts, resets -----------------------------------------------------------------------------------------

    def _relocalise(
        self, frame: CameraFrame, observed: FrameFeatures, window: SlidingWindow, blind_s: float
    ) -> tuple[str, ...]:
        """After a blind time measure the position against the keyframes; return the event."""
        position = self._relocaliser.update(frame, observed.features, window.state, blind_s)
        if position is None or not window.correct_position(position):
            return ()
        self._relocaliser.succeeded()
        return ("relocalised",)

    def _tie_to_old_map(self, frame: CameraFrame, observed: FrameFeatures, state: State) -> MapTie | None:
        """Recognise a keyframe of an earlier map and move the state there; None while that does not succeed."""
        island, position = self._relocaliser.island, self._relocaliser.find_old_map(frame, observed.features)
        if position is None:
            return None
        T_WI_before = state.T_WI
        state.make_origin(float(so3.yaw(position.T_WI[:3, :3])), position.T_WI[:3, 3])
        tie = MapTie(island, position.island, state.T_WI @ se3.inv(T_WI_before))
        self._v_mean_W = tie.T[:3, :3] @ self._v_mean_W
        self._relocaliser.tie(tie)
        return tie

    def _reset(self, state: State) -> None:
        """Forget the state; the next start begins at its last position, or at the last supported one if it diverged."""
        sigma_m = np.sqrt(np.trace(state.cov[P, P]))
        if np.all(np.isfinite(state.T_WI)) and sigma_m < MAX_RESTART_SIGMA_M:
            self._origin = (float(so3.yaw(state.R_WI)), state.p_WI)
        self._window = None
        self._starter = Starter(self._settings, self._model)

    def _try_to_start(self, frame: CameraFrame, observed: FrameFeatures, gap_s: float) -> FrameEstimate:
        """Start from a stationary or a moving head once the last frames allow it; the first pose defines W."""
        bad = self._imu.pop_bad_count()
        started = self._starter.try_to_start(observed, self._imu)
        if self._starter.bias_g is not None:
            self._bias_g = self._starter.bias_g
        if started is None:
            reasons = ["waiting for a start"]
            reasons += [self._starter.fault] if self._starter.fault is not None else []
            reasons += [f"IMU silent for {gap_s * 1e3:.0f} ms"] if gap_s > self._settings.health.max_imu_gap_s else []
            reasons += [f"{bad} IMU samples were late, not numbers or not possible"] if bad else []
            return frame_estimate(frame, observed, None, Health(Verdict.INITIALISING, tuple(reasons)))
        self._window, event = started
        state = self._window.state
        self._window.propagate(self._imu.segments(state.t_ns, observed.t_ns), observed.t_ns, 0.0)
        self._frontend.drop(self._window.correct(observed.features).refused)
        # After a reset the keyframes of the map so far may show where the head is; if not, a new map begins.
        events: tuple[str, ...] = (event,)
        position = self._relocaliser.restart(frame)
        if position is not None:
            self._origin = (float(so3.yaw(position.T_WI[:3, :3])), position.T_WI[:3, 3])
            events = (event, "relocalised")
        elif self._relocaliser.island:
            events = (event, NEW_MAP)
        state.make_origin(*self._origin)
        if event == STATIONARY_START:
            self._stationary_detector.begin(observed.t_ns, observed.features)
        self._bias_g, self._supported_ns = state.bias_g, observed.t_ns
        health = Health(Verdict.GOOD, (), observed.features.tracked)
        return frame_estimate(frame, observed, state, health, events, self._shift_ns, self._relocaliser.island)
