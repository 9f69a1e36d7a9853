"""Where the head is after a time without sight: found again in pictures that were kept on the way.

A kept picture (keyframe) costs nothing until it is needed: only then are ORB features sought in it and in the newest
one, matched, and the pose taken that most of them agree with, as ``estimator.mode=visual`` does [Rublee11].

With I0 the IMU at the keyframe's time, p_WI = p_WI0 + R_WI0 p_I0I. A turn and a way sideways look much alike, and the
turn since the keyframe is better known by the gyro: it is taken as a prior of the fit. What the attitude of both is
wrong by is the same, so that only the position is told.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from snakeslam.calibration import CameraCalibration
from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import PlainRows
from snakeslam.estimation.filter.state import P, State
from snakeslam.estimation.frontend.tracking import FrontendFrame
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.estimation.orb_map.keyframe_map import VisualMap
from snakeslam.estimation.orb_map.matching import NOTHING, Matcher
from snakeslam.estimation.orb_map.orb import OrbExtractor
from snakeslam.estimation.orb_map.pnp import PoseFit
from snakeslam.estimation.orb_map.view import Match, View, look
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame, Float, MapTie

MOST_KEYFRAMES = 24
MOST_SHELVED = 48
"""Keyframes of maps that are not connected to the present one, kept to tie it to them."""
TIE_EVERY_FRAMES, TIE_CANDIDATES = 10, 4
"""While the present map is not connected, every so many frames so many of them are tried, in turn."""
APART_M, APART_RAD = 0.15, np.deg2rad(15.0)
"""A picture is kept when none that is kept was taken so near and turned so alike."""
MOST_SMEAR_PX = 3.0
MOST_CANDIDATES = 3
LEAST_SHARE = 0.5
"""Of the matched features so many must agree."""
TURN_RAD, TURN_RAD_S = 0.001, 0.0005
"""What the gyro's turn is wrong by: at once, and for each second."""
BLIND_S = 0.3
"""Nothing seen for so long, and it is looked where the head has come to."""
TRIES, FRAMES_PER_TRY = 4, 5
LESS_CERTAIN = 2.0
"""By so much must the reckoning's variance exceed the keyframe's: both hold the error of the way up to it."""


@dataclass(slots=True)
class ImageKeyframe:
    """A kept picture, the pose (4, 4) of the IMU as the filter had it, and the covariance (3, 3) of its position.

    The pose is in map ``island``.
    """

    frame: CameraFrame
    T_WI: Float
    cov_p: Float
    island: int = 0
    view: View | None = field(default=None)


@dataclass(slots=True)
class MeasuredPosition(PlainRows):
    """Rows p = p_m of a position that was found: ``T_WI`` (4, 4), the covariance (3, 3) of its position."""

    T_WI: Float
    cov_p: Float
    keyframe_cov_p: Float
    """(3, 3), of the keyframe in which it was found."""
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
        """Return how far it is from what the state foresees."""
        H = self.jacobian(state)
        return Innovation.of(self.residual(state)[None], (H @ state.cov @ H.T)[None], np.array([len(H)]))

    def tells_more(self, state: State) -> bool:
        """Return whether the reckoning has become much less certain than the keyframe is."""
        return bool(np.trace(state.cov[P, P]) > LESS_CERTAIN * np.trace(self.keyframe_cov_p))


class Keyframes:
    """Images of the present map ``island``, the last MOST_KEYFRAMES, and of maps that nothing ties it to yet."""

    def __init__(self, settings: EstimatorSettings, cam0: CameraCalibration, seed: int) -> None:
        self._settings = settings
        self._camera = PinholeCamera(cam0)
        self._T_IC = cam0.T_IC
        self.focal_px = self._camera.focal_px
        self._orb = OrbExtractor(settings.relocalisation)
        self._matcher = Matcher(settings.relocalisation, self._camera, seed)
        self._kept: list[ImageKeyframe] = []
        self._shelved: list[ImageKeyframe] = []
        self._tried = 0
        self.island = 0

    def add(self, frame: CameraFrame, features: FrontendFrame, state: State) -> None:
        """Keep a picture with depth, sharp and of another view than those that are kept."""
        if frame.depth_m is None or features.smear * self._camera.focal_px > MOST_SMEAR_PX:
            return
        if self._kept and self._apart(state.T_WI).min() < 1.0:
            return
        self._kept.append(ImageKeyframe(replace(frame, rgb=None), state.T_WI, state.cov[P, P].copy(), self.island))
        del self._kept[:-MOST_KEYFRAMES]

    def begin(self, island: int) -> None:
        """Begin a map to which nothing ties the keyframes so far: they are shelved."""
        self._shelved = [*self._shelved, *self._kept][-MOST_SHELVED:]
        self._kept, self.island = [], island

    def tie(self, tie: MapTie) -> None:
        """The present map is part of an earlier one: its keyframes go there, and those there are of use again."""
        moved = [replace(k, T_WI=tie.T @ k.T_WI, island=tie.into) for k in self._kept]
        again = [k for k in self._shelved if k.island == tie.into]
        self._shelved = [k for k in self._shelved if k.island != tie.into]
        self._kept, self.island = [*again, *moved][-MOST_KEYFRAMES:], tie.into

    def find(self, frame: CameraFrame, foreseen_WI: Float | None) -> MeasuredPosition | None:
        """Return where the picture was taken, sought about a foreseen pose, or in the newest; None if nowhere."""
        if frame.depth_m is None or not self._kept:
            return None
        candidates = self._kept[::-1]
        if foreseen_WI is not None:
            candidates = [self._kept[k] for k in np.argsort(self._apart(foreseen_WI), kind="stable")]
        return self._first_match(candidates[:MOST_CANDIDATES], frame, foreseen_WI)

    def find_shelved(self, frame: CameraFrame) -> MeasuredPosition | None:
        """Return where the next few keyframes of other maps put the image, by descriptors alone; None if nowhere."""
        if frame.depth_m is None or not self._shelved:
            return None
        count = min(TIE_CANDIDATES, len(self._shelved))
        candidates = [self._shelved[(self._tried + k) % len(self._shelved)] for k in range(count)]
        self._tried += count
        return self._first_match(candidates, frame, None)

    def _first_match(
        self, candidates: list[ImageKeyframe], frame: CameraFrame, foreseen_WI: Float | None
    ) -> MeasuredPosition | None:
        view = self._look(frame)
        for keyframe in candidates:
            fit = self._match(keyframe, view, frame.t_ns, foreseen_WI)
            if fit is not None:
                T_WI = keyframe.T_WI @ fit.T_WC
                cov_p = keyframe.cov_p + T_WI[:3, :3] @ fit.cov[:3, :3] @ T_WI[:3, :3].T
                return MeasuredPosition(T_WI, cov_p, keyframe.cov_p, keyframe.island)
        return None

    def _apart(self, T_WI: Float) -> Float:
        """Return how far the keyframes' views are from one, (K,), 1 where one of the two need not be kept."""
        Ts = np.stack([keyframe.T_WI for keyframe in self._kept])
        moved_m = np.linalg.norm(Ts[:, :3, 3] - T_WI[:3, 3], axis=1)
        cosine = 0.5 * (np.einsum("kij,ij->k", Ts[:, :3, :3], T_WI[:3, :3]) - 1.0)
        return np.asarray(np.maximum(moved_m / APART_M, np.arccos(np.clip(cosine, -1.0, 1.0)) / APART_RAD))

    def _look(self, frame: CameraFrame) -> View:
        return look(frame, self._orb, self._camera, self._settings.noise, 0.0)

    def _match(self, keyframe: ImageKeyframe, view: View, t_ns: int, foreseen_WI: Float | None) -> PoseFit | None:
        """Return T_I0I and its covariance, sought near a foreseen pose, or by descriptors alone without one."""
        if keyframe.view is None:
            keyframe.view = self._look(keyframe.frame)
        known = VisualMap(self._settings.relocalisation)
        known.add_keyframe(np.eye(4), np.zeros((6, 6)), keyframe.view, NOTHING.feature, NOTHING.point)
        if foreseen_WI is None:
            return self._agreed(self._matcher.anywhere(view, known), self._settings.relocalisation.relocalise_inliers)
        T_I0I = se3.inv(keyframe.T_WI) @ foreseen_WI
        match = self._matcher.near(view, known, se3.inv(self._T_IC) @ T_I0I @ self._T_IC)
        fit = self._agreed(match, self._settings.relocalisation.min_inliers)
        return None if fit is None else _with_turn(fit, T_I0I[:3, :3], t_ns - keyframe.frame.t_ns)

    def _agreed(self, match: Match | None, least: int) -> PoseFit | None:
        """Return the motion of the IMU by a match of which enough agree."""
        if match is None or match.agreeing < max(least, LEAST_SHARE * len(match.fit.inliers)):
            return None
        Ad = se3.adjoint(self._T_IC)
        T_I0I = self._T_IC @ match.fit.T_WC @ se3.inv(self._T_IC)
        return PoseFit(T_I0I, Ad @ match.fit.cov @ Ad.T, match.fit.inliers)


def _with_turn(fit: PoseFit, R_I0I: Float, since_ns: int) -> PoseFit:
    """Return a fit with the turn since the keyframe as the gyro has it for a prior."""
    sigma_rad = TURN_RAD + TURN_RAD_S * since_ns * 1e-9
    prior = np.zeros((6, 6))
    prior[3:, 3:] = np.eye(3) / sigma_rad**2
    cov = np.linalg.inv(np.linalg.inv(fit.cov) + prior)
    turn = np.concatenate([np.zeros(3), so3.log(fit.T_WC[:3, :3].T @ R_I0I)])
    return PoseFit(fit.T_WC @ se3.exp(cov @ prior @ turn), np.asarray(cov, dtype=np.float64), fit.inliers)


class Relocaliser:
    """Keeps pictures while the camera supports the state, and looks for the head in them after a time without sight."""

    def __init__(self, settings: EstimatorSettings, cam0: CameraCalibration, seed: int) -> None:
        self._keyframes = Keyframes(settings, cam0, seed)
        self._tries = 0
        self._frames = 0
        self._maps = 0
        self._since_tie = 0

    def update(
        self, frame: CameraFrame, features: FrontendFrame, state: State, blind_s: float
    ) -> MeasuredPosition | None:
        """Take a frame that supports the state after ``blind_s`` without one; return a place that tells more."""
        if blind_s >= BLIND_S:
            self._tries, self._frames = TRIES, 0
        if not self._tries:
            self._keyframes.add(frame, features, state)
            return None
        self._frames += 1
        if self._frames % FRAMES_PER_TRY != 1:
            return None
        self._tries -= 1
        place = self._keyframes.find(frame, state.T_WI)
        return place if place is not None and place.tells_more(state) else None

    def succeeded(self) -> None:
        """Look no further."""
        self._tries = 0

    def restart(self, frame: CameraFrame) -> MeasuredPosition | None:
        """Return where the newest pictures put the first frame after a reset; None begins a map of its own."""
        self._tries = 0
        place = self._keyframes.find(frame, None)
        if place is None:
            self._keyframes.begin(self._maps)
            self._maps += 1
        return place

    @property
    def island(self) -> int:
        """The map that the state is in: 0 is the first, and whatever is tied to it."""
        return self._keyframes.island

    def find_old_map(self, frame: CameraFrame, features: FrontendFrame) -> MeasuredPosition | None:
        """Return where a frame of a map that is not connected lies in an earlier one; None mostly."""
        self._since_tie += 1
        sharp = features.smear * self._keyframes.focal_px <= MOST_SMEAR_PX
        if self.island == 0 or self._since_tie < TIE_EVERY_FRAMES or not sharp:
            return None
        self._since_tie = 0
        return self._keyframes.find_shelved(frame)

    def tie(self, tie: MapTie) -> None:
        """The present map is part of an earlier one."""
        self._tries = 0
        self._keyframes.tie(tie)
