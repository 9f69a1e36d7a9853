"""Relocalisation: after a blind time the head's position is measured against keyframes.

A keyframe costs nothing until it is needed. Only then are ORB features extracted from it and from the newest frame,
matched, and a pose fitted by RANSAC and PnP, as ``estimator.mode=visual`` does [Rublee11].

With I0 the IMU at the keyframe's time the measured position is p_WI = p_WI0 + R_WI0 p_I0I. A rotation and a sideways
displacement move an image alike, and the gyro knows the rotation since the keyframe better: it is a prior of the fit.
The orientation is not measured, because that of the keyframe and that of the state have the same error.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from snakeslam.calibration import CameraCalibration
from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import DirectMeasurement
from snakeslam.estimation.filter.state import P, State
from snakeslam.estimation.frontend.tracking import TrackedFeatures
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.estimation.orb_map.keyframe_map import OrbMap
from snakeslam.estimation.orb_map.matching import NO_PAIRS, Matcher
from snakeslam.estimation.orb_map.orb import OrbExtractor
from snakeslam.estimation.orb_map.pnp import PoseFit
from snakeslam.estimation.orb_map.view import Match, OrbView, extract_view
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame, Float, MapTie

MAX_KEYFRAMES = 24
MAX_OLD_KEYFRAMES = 48
"""Keyframes of earlier maps to which the present one is not connected yet."""
TIE_EVERY_FRAMES, TIE_CANDIDATES = 10, 4
"""While the present map is not connected, the next few old keyframes are tried once in so many frames."""
APART_M, APART_RAD = 0.15, np.deg2rad(15.0)
"""A keyframe is added when every other one is farther away than this, or rotated against it by more."""
MAX_BLUR_PX = 3.0
"""A frame with more motion blur than this is not used: ORB features move along the blur."""
MAX_CANDIDATES = 3
MIN_INLIER_SHARE = 0.5
"""Share of the matches that must agree with the fitted pose."""
SIGMA_RAD, SIGMA_RAD_PER_S = 0.001, 0.0005
"""Sigma of the gyro's rotation since the keyframe: a constant, and its growth with time."""
BLIND_S = 0.3
"""After so long without support from the camera the position is measured against the keyframes."""
TRIES, FRAMES_PER_TRY = 4, 5
"""So many tries after a blind time, one in so many frames."""
MIN_VARIANCE_RATIO = 2.0
"""The state's variance must exceed the keyframe's by this factor: both contain the drift up to the keyframe."""


@dataclass(slots=True)
class ImageKeyframe:
    """A frame, the pose (4, 4) of the IMU at its time in map ``island``, and the covariance (3, 3) of its position."""

    frame: CameraFrame
    T_WI: Float
    cov_p: Float
    island: int = 0
    view: OrbView | None = field(default=None)


@dataclass(slots=True)
class MeasuredPosition(DirectMeasurement):
    """Rows p_WI = p of a position measured against a keyframe: ``T_WI`` (4, 4), the position's covariance (3, 3)."""

    T_WI: Float
    cov_p: Float
    keyframe_cov_p: Float
    """(3, 3), that of the keyframe's own position."""
    island: int = 0
    """The map that the keyframe is in."""

    def residual(self, state: State) -> Float:
        """Return the whitened residual, (3,)."""
        return self._whitening() @ (self.T_WI[:3, 3] - state.p_WI)

    def jacobian(self, state: State) -> Float:
        """Return the whitened Jacobian, (3, size)."""
        H = np.zeros((3, state.size))
        H[:, P] = self._whitening()
        return H

    def _whitening(self) -> Float:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.cov_p)), dtype=np.float64)

    def innovation(self, state: State) -> Innovation:
        """Return the innovation and its covariance."""
        H = self.jacobian(state)
        return Innovation.of(self.residual(state)[None], (H @ state.cov @ H.T)[None], np.array([len(H)]))

    def is_informative(self, state: State) -> bool:
        """Return whether the state has become much less certain than the keyframe is."""
        return bool(np.trace(state.cov[P, P]) > MIN_VARIANCE_RATIO * np.trace(self.keyframe_cov_p))


class Keyframes:
    """The last MAX_KEYFRAMES of the present map, number ``island``, and those of maps that it is not tied to yet."""

    def __init__(self, settings: EstimatorSettings, cam0: CameraCalibration, seed: int) -> None:
        self._settings = settings
        self._camera = PinholeCamera(cam0)
        self._T_IC = cam0.T_IC
        self.focal_px = self._camera.focal_px
        self._orb = OrbExtractor(settings.relocalisation)
        self._matcher = Matcher(settings.relocalisation, self._camera, seed)
        self._present: list[ImageKeyframe] = []
        self._old: list[ImageKeyframe] = []
        self._tried = 0
        self.island = 0

    def add(self, frame: CameraFrame, features: TrackedFeatures, state: State) -> None:
        """Add a frame with depth and little motion blur whose pose differs from those of all keyframes."""
        if frame.depth_m is None or features.motion_blur_rad * self._camera.focal_px > MAX_BLUR_PX:
            return
        if self._present and self._apart(state.T_WI).min() < 1.0:
            return
        self._present.append(ImageKeyframe(replace(frame, rgb=None), state.T_WI, state.cov[P, P].copy(), self.island))
        del self._present[:-MAX_KEYFRAMES]

    def begin(self, island: int) -> None:
        """Begin a map to which the keyframes so far are not connected: they become those of an old map."""
        self._old = [*self._old, *self._present][-MAX_OLD_KEYFRAMES:]
        self._present, self.island = [], island

    def tie(self, tie: MapTie) -> None:
        """Move the keyframes of the present map into an earlier one, whose own keyframes are used again."""
        moved = [replace(k, T_WI=tie.T @ k.T_WI, island=tie.into) for k in self._present]
        earlier = [k for k in self._old if k.island == tie.into]
        self._old = [k for k in self._old if k.island != tie.into]
        self._present, self.island = [*earlier, *moved][-MAX_KEYFRAMES:], tie.into

    def measure(self, frame: CameraFrame, predicted_WI: Float | None) -> MeasuredPosition | None:
        """Return the position of a frame, near a predicted pose or against the newest keyframes, or None."""
        if frame.depth_m is None or not self._present:
            return None
        candidates = self._present[::-1]
        if predicted_WI is not None:
            candidates = [self._present[k] for k in np.argsort(self._apart(predicted_WI), kind="stable")]
        return self._first_match(candidates[:MAX_CANDIDATES], frame, predicted_WI)

    def measure_in_old_maps(self, frame: CameraFrame) -> MeasuredPosition | None:
        """Return the position of a frame in an old map, from its next few keyframes and descriptors alone, or None."""
        if frame.depth_m is None or not self._old:
            return None
        count = min(TIE_CANDIDATES, len(self._old))
        candidates = [self._old[(self._tried + k) % len(self._old)] for k in range(count)]
        self._tried += count
        return self._first_match(candidates, frame, None)

    def _first_match(
        self, candidates: list[ImageKeyframe], frame: CameraFrame, predicted_WI: Float | None
    ) -> MeasuredPosition | None:
        view = self._extract(frame)
        for keyframe in candidates:
            fit = self._match(keyframe, view, frame.t_ns, predicted_WI)
            if fit is not None:
                T_WI = keyframe.T_WI @ fit.T_WC
                cov_p = keyframe.cov_p + T_WI[:3, :3] @ fit.cov[:3, :3] @ T_WI[:3, :3].T
                return MeasuredPosition(T_WI, cov_p, keyframe.cov_p, keyframe.island)
        return None

    def _apart(self, T_WI: Float) -> Float:
        """Return the distances of the keyframes from a pose, (K,), in units of APART_M or APART_RAD, the larger one."""
        Ts = np.stack([keyframe.T_WI for keyframe in self._present])
        moved_m = np.linalg.norm(Ts[:, :3, 3] - T_WI[:3, 3], axis=1)
        cosine = 0.5 * (np.einsum("kij,ij->k", Ts[:, :3, :3], T_WI[:3, :3]) - 1.0)
        return np.asarray(np.maximum(moved_m / APART_M, np.arccos(np.clip(cosine, -1.0, 1.0)) / APART_RAD))

    def _extract(self, frame: CameraFrame) -> OrbView:
        return extract_view(frame, self._orb, self._camera, self._settings.noise, 0.0)

    def _match(self, keyframe: ImageKeyframe, view: OrbView, t_ns: int, predicted_WI: Float | None) -> PoseFit | None:
        """Return T_I0I and its covariance, searched near a predicted pose, or by descriptors alone without one."""
        if keyframe.view is None:
            keyframe.view = self._extract(keyframe.frame)
        known = OrbMap(self._settings.relocalisation)
        known.add_keyframe(np.eye(4), np.zeros((6, 6)), keyframe.view, NO_PAIRS.feature, NO_PAIRS.point)
        if predicted_WI is None:
            return self._fit(self._matcher.anywhere(view, known), self._settings.relocalisation.relocalise_inliers)
        T_I0I = se3.inv(keyframe.T_WI) @ predicted_WI
        match = self._matcher.near(view, known, se3.inv(self._T_IC) @ T_I0I @ self._T_IC)
        fit = self._fit(match, self._settings.relocalisation.min_inliers)
        return None if fit is None else _with_gyro_prior(fit, T_I0I[:3, :3], t_ns - keyframe.frame.t_ns)

    def _fit(self, match: Match | None, min_inliers: int) -> PoseFit | None:
        """Return the motion T_I0I of the IMU, T_IC T_C0C T_CI, by a match with enough inliers."""
        if match is None or match.inlier_count < max(min_inliers, MIN_INLIER_SHARE * len(match.fit.inliers)):
            return None
        Ad = se3.adjoint(self._T_IC)
        T_I0I = self._T_IC @ match.fit.T_WC @ se3.inv(self._T_IC)
        return PoseFit(T_I0I, Ad @ match.fit.cov @ Ad.T, match.fit.inliers)


def _with_gyro_prior(fit: PoseFit, R_I0I: Float, since_ns: int) -> PoseFit:
    """Return a fit with the gyro's rotation since the keyframe as a prior.

    With information A of the fit and B of the prior: T [+] (A + B)^-1 B log(R^T R_I0I), covariance (A + B)^-1.
    """
    sigma_rad = SIGMA_RAD + SIGMA_RAD_PER_S * since_ns * 1e-9
    prior = np.zeros((6, 6))
    prior[3:, 3:] = np.eye(3) / sigma_rad**2
    cov = np.linalg.inv(np.linalg.inv(fit.cov) + prior)
    rotation = np.concatenate([np.zeros(3), so3.log(fit.T_WC[:3, :3].T @ R_I0I)])
    return PoseFit(fit.T_WC @ se3.exp(cov @ prior @ rotation), np.asarray(cov, dtype=np.float64), fit.inliers)


class Relocaliser:
    """Adds keyframes while the camera supports the state, and measures against them after a blind time."""

    def __init__(self, settings: EstimatorSettings, cam0: CameraCalibration, seed: int) -> None:
        self._keyframes = Keyframes(settings, cam0, seed)
        self._tries = 0
        self._frames = 0
        self._maps = 0
        self._since_tie = 0

    def update(
        self, frame: CameraFrame, features: TrackedFeatures, state: State, blind_s: float
    ) -> MeasuredPosition | None:
        """Take a frame that supports the state after ``blind_s`` without support; return an informative position."""
        if blind_s >= BLIND_S:
            self._tries, self._frames = TRIES, 0
        if not self._tries:
            self._keyframes.add(frame, features, state)
            return None
        self._frames += 1
        if self._frames % FRAMES_PER_TRY != 1:
            return None
        self._tries -= 1
        position = self._keyframes.measure(frame, state.T_WI)
        return position if position is not None and position.is_informative(state) else None

    def succeeded(self) -> None:
        """Stop trying until the next blind time."""
        self._tries = 0

    def restart(self, frame: CameraFrame) -> MeasuredPosition | None:
        """Return the position of the first frame after a reset in the newest keyframes; None begins a new map."""
        self._tries = 0
        position = self._keyframes.measure(frame, None)
        if position is None:
            self._keyframes.begin(self._maps)
            self._maps += 1
        return position

    @property
    def island(self) -> int:
        """Number of the map that the state is in: 0 for the first one and all that is tied to it."""
        return self._keyframes.island

    def find_old_map(self, frame: CameraFrame, features: TrackedFeatures) -> MeasuredPosition | None:
        """Return the position of a frame of an unconnected map in an earlier map; None for most frames."""
        self._since_tie += 1
        sharp = features.motion_blur_rad * self._keyframes.focal_px <= MAX_BLUR_PX
        if self.island == 0 or self._since_tie < TIE_EVERY_FRAMES or not sharp:
            return None
        self._since_tie = 0
        return self._keyframes.measure_in_old_maps(frame)

    def tie(self, tie: MapTie) -> None:
        """Move the keyframes of the present map into the earlier one."""
        self._tries = 0
        self._keyframes.tie(tie)
