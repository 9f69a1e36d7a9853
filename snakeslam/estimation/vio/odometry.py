"""estimator.mode = vio: tightly coupled vision and IMU in an iterated error-state filter over a window of clones.

With a gait beside them it is ``fused``.

For each frame: propagate by the pre-integrated IMU, follow features, clone the pose, update with what left the window
or was lost and with the landmarks in view, shrink the window, judge.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.filter.extrinsics import Mount
from snakeslam.estimation.filter.gating import Agreement
from snakeslam.estimation.filter.imu_doubt import MotionDoubt
from snakeslam.estimation.filter.preintegration import ImuBuffer
from snakeslam.estimation.filter.state import CORE, P, State, V
from snakeslam.estimation.frontend.tracking import Frontend, FrontendFrame
from snakeslam.estimation.gait.aid import GaitAid
from snakeslam.estimation.gait.rows import GaitWay
from snakeslam.estimation.health import NEW_MAP, TIED, Evidence, judge, supports
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.estimation.imaging.roll_prior import RollPrior, with_roll
from snakeslam.estimation.measurements.zero_velocity import REST_NS, Rest, RestDetector
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.vio.published import frame_estimate
from snakeslam.estimation.vio.relocalisation import Relocaliser
from snakeslam.estimation.vio.starting import AT_REST, Seen, Starter
from snakeslam.estimation.vio.window import Model, Report, SlidingWindow
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame, Float, Health, ImuSample, JointState, MapTie, Packet, Verdict

REST_MEAN_NS = 500_000_000
REST_SPEED_M_S = 0.01
"""Faster than this by its own reckoning it is not at rest: a slow way along the view hardly moves the picture."""
CLOCK_SET_BACK_FRAMES = 10
MAX_SIGMA_RECKONED_M = 0.3


class FeatureSource(Protocol):
    """What follows features: the front-end, or a simulation of one."""

    def process(self, frame: CameraFrame, T_C1C0: Float, doubted: bool = False) -> FrontendFrame:
        """Return the features of ``frame``, given about how the camera has moved since, which may be ``doubted``."""
        ...

    def drop(self, ids: NDArray[np.int64]) -> None:
        """Follow these no longer."""
        ...


@dataclass(frozen=True, slots=True)
class _Inputs:
    """The frame before, and what was wrong with the IMU since: the longest gap, doubted samples."""

    last_ns: int | None
    gap_s: float
    doubt: MotionDoubt | None


class VisualInertialOdometry:
    """Packets in, one estimate a frame out."""

    def __init__(
        self,
        settings: EstimatorSettings,
        rig: SensorRig,
        seed: int,
        frontend: FeatureSource | None = None,
        gait: GaitAid | None = None,
    ) -> None:
        if rig.imu0 is None:
            mode = "vio" if gait is None else "fused"
            raise InputError("estimator.mode", f"'{mode}' needs an IMU, and this recording has none", "visual")
        self._settings = settings
        camera = PinholeCamera(rig.cam0)
        self._model = Model.of(settings, rig.cam0, rig.imu0, camera.focal_px)
        self._shift_ns = round(rig.cam0.timeshift_cam_imu * 1e9)
        self._frontend: FeatureSource = frontend or Frontend(
            settings.frontend, camera, seed, round(settings.noise.unknown_exposure_ms * 1e6)
        )
        self._imu = ImuBuffer(rig.imu0)
        self._gait = gait
        self._starter = Starter(settings, self._model)
        self._rest = RestDetector(rig.imu0, camera.focal_px)
        self._filter: SlidingWindow | None = None
        self._last_ns: int | None = None
        self._picture_ns: int | None = None
        self._back_ns: list[int] = []
        self._roll = RollPrior()
        self._relocaliser = Relocaliser(settings, rig.cam0, seed)
        self._v_mean_W, self._v_mean_ns = np.zeros(3), 0
        self._bias_g = np.zeros(3)
        self._supported_ns = 0
        self._anchor: tuple[float, Float] = (0.0, np.zeros(3))

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        """Take the roll that the gait is to give the head: a prior for features where the gyro fails."""
        self._roll.add(t_ns, roll_rad)

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Take one packet; return an estimate for a camera frame."""
        if isinstance(packet, ImuSample):
            self._imu.add(packet)
        elif isinstance(packet, JointState) and self._gait is not None:
            self._gait.take(packet)
        return self._take_frame(packet) if isinstance(packet, CameraFrame) else None

    # -- Time ---------------------------------------------------------------------------------------------------------

    def _take_frame(self, frame: CameraFrame) -> FrameEstimate:
        t_ns = frame.t_ns + self._shift_ns + self._offset_ns()
        last_ns = self._last_ns
        if last_ns is not None and t_ns <= last_ns:
            return self._goes_back(frame, t_ns)
        ahead_s = self._imu.ahead_s(t_ns)
        if self._filter is not None and ahead_s > self._settings.health.max_blind_s:
            health = Health(Verdict.BLIND, (f"the frame's time is {ahead_s:.1f} s ahead of the IMU",))
            return frame_estimate(frame, None, None, health)
        self._back_ns.clear()
        gap_s = self._imu.longest_gap_s(last_ns, t_ns) if last_ns is not None else 0.0
        doubt = self._imu.doubt(last_ns, t_ns) if last_ns is not None else None
        if self._filter is not None:
            self._filter.propagate(self._imu.segments(self._filter.state.t_ns, t_ns), t_ns, gap_s, doubt)
        waits = self._filter is None and self._starter.waits_long
        doubted = waits or doubt is not None or gap_s > self._settings.health.max_imu_gap_s
        seen = Seen(t_ns, self._frontend.process(frame, self._motion(t_ns), doubted))
        self._last_ns = t_ns
        if not seen.features.frozen:
            self._picture_ns = t_ns
        if self._filter is None:
            return self._start(frame, seen, gap_s)
        return self._track(frame, seen, self._filter, _Inputs(last_ns, gap_s, doubt))

    @property
    def mount(self) -> tuple[Mount, Float] | None:
        """What the filter makes of the camera's time and place, and its covariance; None before or while held."""
        state = self._filter.state if self._filter is not None else None
        if state is None or state.mount is None:
            return None
        return state.mount, state.cov[CORE : state.camera_place.stop, CORE : state.camera_place.stop].copy()

    def _offset_ns(self) -> int:
        """Return what the filter has found of the camera's time beyond its calibration."""
        return 0 if self.mount is None else round(self.mount[0].offset_s * 1e9)

    def _goes_back(self, frame: CameraFrame, t_ns: int) -> FrameEstimate:
        """Leave out a frame whose time goes back; when the clock itself has been set back, start anew with it."""
        self._back_ns = [*self._back_ns, t_ns] if not self._back_ns or t_ns > self._back_ns[-1] else [t_ns]
        reasons = ("the frame's time goes back",)
        if len(self._back_ns) < CLOCK_SET_BACK_FRAMES:
            return frame_estimate(frame, None, None, Health(Verdict.BLIND, reasons))
        if self._filter is not None:
            self._reset(self._filter.state)
        self._imu.clear()
        if self._gait is not None:
            self._gait.clear()
        self._last_ns = self._picture_ns = None
        self._back_ns.clear()
        return frame_estimate(frame, None, None, Health(Verdict.LOST, (*reasons, "the clock was set back")), ("reset",))

    # -- One frame ----------------------------------------------------------------------------------------------------

    def _track(self, frame: CameraFrame, seen: Seen, window: SlidingWindow, inputs: "_Inputs") -> FrameEstimate:
        """Correct the propagated state by what is seen, and judge."""
        features, state, health = seen.features, window.state, self._settings.health
        way = self._gait.tell(state, self._imu, seen.t_ns, features.frozen) if self._gait else None
        rest = self._rest.see(seen.t_ns, features, self._imu.recent(seen.t_ns - REST_NS), state.bias_g)
        window.vibrate(self._rest.tremor_m_s2, seen.t_ns - (inputs.last_ns or seen.t_ns))
        # A head held still on a crawling body looks at rest to the picture and to the IMU. In a tremor the filter's
        # own velocity does not count: it is that of the tremor.
        moves = self._moves(state, seen.t_ns)
        if rest is not None and ((moves and not rest.since_start) or way is not None):
            rest = None
        report = self._correct(seen, window, rest, way)
        self._frontend.drop(report.refused)
        evidence = Evidence(
            followed=features.followed,
            rejected=len(features.rejected_ids),
            agreement=Agreement.of(report.innovations),
            cov_v=state.cov[V, V],
            blind_s=(seen.t_ns - self._supported_ns) / 1e9,
            frozen=features.frozen,
            resting=rest is not None,
            imu_gap_s=inputs.gap_s,
            imu_doubts=inputs.doubt.words if inputs.doubt is not None else (),
            bad_samples=self._imu.take_bad_count(),
        )
        if self._gait is not None:
            holds = self._gait.hear(report.carried, supports(evidence, health))
            evidence = replace(evidence, gait_holds=holds, gait_faults=self._gait.reasons)
            health = health.model_copy(update={"max_blind_s": self._gait.settings.max_blind_s}) if holds else health
        events: tuple[str, ...] = ()
        tie: MapTie | None = None
        if supports(evidence, health):
            events = self._relocalise(frame, seen, window, evidence.blind_s)
            tie = self._tie(frame, seen, state)
            self._supported_ns = seen.t_ns
            self._anchor = (float(so3.yaw(state.R_WI)), state.p_WI)
            evidence = replace(evidence, blind_s=0.0)
        return self._conclude(frame, seen, state, judge(evidence, health), events, tie)

    def _relocalise(self, frame: CameraFrame, seen: Seen, window: SlidingWindow, blind_s: float) -> tuple[str, ...]:
        """After a time without sight look where the head has come to; return what to say of it."""
        place = self._relocaliser.see(frame, seen.features, window.state, blind_s)
        if place is None or not window.relocate(place):
            return ()
        self._relocaliser.found()
        return ("relocalised",)

    def _tie(self, frame: CameraFrame, seen: Seen, state: State) -> MapTie | None:
        """Look for a map that is not connected in the keyframes of those before, and move the state to where it is."""
        island, place = self._relocaliser.island, self._relocaliser.find_old_map(frame, seen.features)
        if place is None:
            return None
        before = state.T_WI
        state.make_origin(float(so3.yaw(place.T_WI[:3, :3])), place.T_WI[:3, 3])
        tie = MapTie(island, place.island, state.T_WI @ se3.inv(before))
        self._v_mean_W = tie.T[:3, :3] @ self._v_mean_W
        self._relocaliser.tie(tie)
        return tie

    @staticmethod
    def _correct(seen: Seen, window: SlidingWindow, rest: Rest | None, way: GaitWay | None) -> Report:
        """Take the picture, and rest or gait, into the filter; a picture that does not change is none."""
        if not seen.features.frozen:
            return window.correct(seen.features, rest, way)
        if rest is not None:
            window.hold(rest)
        return window.carry(way) if way is not None else Report.none()

    def _conclude(
        self,
        frame: CameraFrame,
        seen: Seen,
        state: State,
        health: Health,
        events: tuple[str, ...],
        tie: MapTie | None = None,
    ) -> FrameEstimate:
        """Publish; start anew when the filter is lost."""
        self._imu.forget_before(min(state.t_ns - REST_NS, self._picture_ns or state.t_ns))
        if health.verdict is not Verdict.LOST:
            self._bias_g = state.bias_g
            events = (*events, TIED) if tie is not None and tie.into == 0 else events
            return frame_estimate(frame, seen, state, health, events, self._shift_ns, self._relocaliser.island, tie)
        self._reset(state)
        return frame_estimate(frame, seen, None, health, ("reset",))

    def _reset(self, state: State) -> None:
        """Forget everything but where the robot was last: as reckoned, or as last seen where that has gone astray."""
        sigma_m = np.sqrt(np.trace(state.cov[P, P]))
        if np.all(np.isfinite(state.T_WI)) and sigma_m < MAX_SIGMA_RECKONED_M:
            self._anchor = (float(so3.yaw(state.R_WI)), state.p_WI)
        self._filter = None
        self._starter = Starter(self._settings, self._model)

    def _start(self, frame: CameraFrame, seen: Seen, gap_s: float) -> FrameEstimate:
        """Try to start; the first pose defines W."""
        bad = self._imu.take_bad_count()
        started = self._starter.try_to_start(seen, self._imu)
        if self._starter.bias_g is not None:
            self._bias_g = self._starter.bias_g
        if started is None:
            reasons = ["waiting for a start"]
            reasons += [self._starter.fault] if self._starter.fault is not None else []
            reasons += [f"IMU silent for {gap_s * 1e3:.0f} ms"] if gap_s > self._settings.health.max_imu_gap_s else []
            reasons += [f"{bad} IMU samples were late, not numbers or not possible"] if bad else []
            return frame_estimate(frame, seen, None, Health(Verdict.INITIALISING, tuple(reasons)))
        self._filter, event = started
        state = self._filter.state
        self._filter.propagate(self._imu.segments(state.t_ns, seen.t_ns), seen.t_ns, 0.0)
        report = self._filter.correct(seen.features)
        self._frontend.drop(report.refused)
        events: tuple[str, ...] = (event,)
        place = self._relocaliser.start(frame)
        if place is not None:
            self._anchor = (float(so3.yaw(place.T_WI[:3, :3])), place.T_WI[:3, 3])
            events = (event, "relocalised")
        elif self._relocaliser.island:
            events = (event, NEW_MAP)
        state.make_origin(*self._anchor)
        if event == AT_REST:
            self._rest.begin(seen.t_ns, seen.features)
        self._bias_g = state.bias_g
        self._supported_ns = seen.t_ns
        health = Health(Verdict.GOOD, (), seen.features.followed)
        return frame_estimate(frame, seen, state, health, events, self._shift_ns, self._relocaliser.island)

    def _motion(self, t_ns: int) -> Float:
        """Return T_C1C0, about how the camera has moved since the last new picture: as the filter foresees.

        Without a filter only the gyro's turn is known.
        """
        place = self.mount[0] if self.mount is not None else self._model.rows
        T_IC = se3.from_rt(place.R_IC, place.p_IC)
        if self._filter is not None and len(self._filter.state.clones):
            state = self._filter.state
            last = se3.from_rt(state.clones.R_WI[-1], state.clones.p_WI[-1])
            return se3.inv(state.T_WI @ T_IC) @ last @ T_IC
        trusted = self._picture_ns is not None and not self._starter.waits_long
        span = self._imu.segments(self._picture_ns, t_ns) if trusted and self._picture_ns is not None else None
        if span is None:
            return self._foreseen_roll(t_ns)
        R_I0I1 = np.eye(3)
        for step in so3.exp((span.gyro_I - self._bias_g) * span.dt_s[:, None]):
            R_I0I1 = R_I0I1 @ step
        return se3.inv(T_IC) @ se3.from_rt(R_I0I1.T, np.zeros(3)) @ T_IC

    def _moves(self, state: State, t_ns: int) -> bool:
        """Return whether the filter knows of its own that it moves; a tremor comes to nothing and does not count."""
        share = min(1.0, (t_ns - self._v_mean_ns) / REST_MEAN_NS)
        self._v_mean_W, self._v_mean_ns = self._v_mean_W + share * (state.v_W - self._v_mean_W), t_ns
        sigma_v = float(np.sqrt(np.linalg.eigvalsh(state.cov[V, V])[-1]))
        return float(np.linalg.norm(self._v_mean_W)) > REST_SPEED_M_S + sigma_v

    def _foreseen_roll(self, t_ns: int) -> Float:
        """Return T_C1C0 of the gait's roll alone."""
        roll_rad = None if self._picture_ns is None else self._roll.between(self._picture_ns, t_ns)
        return np.eye(4) if roll_rad is None else se3.from_rt(with_roll(np.eye(3), -roll_rad), np.zeros(3))
