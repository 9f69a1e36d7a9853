"""The visual mode on drawn frames: a textured wall in front of a camera that moves and rotates."""

import cv2
import numpy as np
import pytest

from snakeslam.calibration import CameraCalibration, SensorRig
from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.health import NEW_MAP
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.visual.odometry import R_LEVEL_WC, VisualOdometry
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame, ImuSample, Verdict

T_CI = se3.from_rt(R_LEVEL_WC.T, np.array([0.02, -0.03, 0.05]))
K = np.array([[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]])
RIG = SensorRig(
    cam0=CameraCalibration(
        T_cam_imu=tuple(tuple(row) for row in T_CI.tolist()),
        intrinsics=(300.0, 300.0, 160.0, 120.0),
        resolution=(320, 240),
    )
)
SETTINGS = EstimatorSettings.model_validate({"mode": "visual", "visual": {"features": 500}})
STEP_NS = 50_000_000
WALL_M = 2.0
PX_PER_M = 250.0
SIZE_PX = 1500


def texture(seed: int) -> np.ndarray:
    """Patches of several sizes, like a wall with posters on it."""
    rng = np.random.default_rng(seed)
    image = np.zeros((SIZE_PX, SIZE_PX))
    for side in (6, 15, 50):
        patches = rng.uniform(0, 85, (SIZE_PX // side, SIZE_PX // side))
        image += cv2.resize(patches, (SIZE_PX, SIZE_PX), interpolation=cv2.INTER_NEAREST)
    return cv2.GaussianBlur(image, (0, 0), 1.0).astype(np.uint8)


WALL = texture(0)


def draw(k: int, T_C0C: np.ndarray, wall: np.ndarray = WALL) -> CameraFrame:
    """Frame ``k`` of a camera at ``T_C0C``, the wall being the plane z = 2 m of C0."""
    # Texture (u, v, 1) to the wall's plane in C0, then into the image.
    half = SIZE_PX / 2 / PX_PER_M
    M = np.array([[1 / PX_PER_M, 0.0, -half], [0.0, 1 / PX_PER_M, -half], [0.0, 0.0, WALL_M]])
    T_CC0 = se3.inv(T_C0C)
    H = K @ (T_CC0[:3, :3] + np.outer(T_CC0[:3, 3], [0.0, 0.0, 1.0 / WALL_M])) @ M
    gray = cv2.warpPerspective(wall, H, (320, 240), flags=cv2.INTER_LINEAR)
    noise = np.random.default_rng([9, k]).normal(0.0, 2.0, gray.shape)
    u, v = np.meshgrid(np.arange(320.0), np.arange(240.0))
    rays = np.stack([(u - 160.0) / 300.0, (v - 120.0) / 300.0, np.ones_like(u)], axis=-1)
    depth = (WALL_M - T_C0C[2, 3]) / (rays @ T_C0C[2, :3])
    return CameraFrame(k * STEP_NS, k, np.clip(gray + noise, 0, 255).astype(np.uint8), None, depth.astype(np.float32))


def path(k: int) -> np.ndarray:
    """A weaving path T_C0C with rotations of up to 40 deg/s."""
    t = k * STEP_NS / 1e9
    rho = np.array([0.3 * np.sin(t), 0.1 * np.sin(2 * t), 0.2 * np.sin(1.5 * t)])
    theta = np.array([0.1 * np.sin(1.3 * t), 0.3 * np.sin(2.0 * t), 0.2 * np.sin(t)])
    return se3.from_rt(so3.exp(theta), rho)


def run(frames: list[CameraFrame], seed: int = 0) -> list[FrameEstimate]:
    estimator = VisualOdometry(SETTINGS.visual, SETTINGS.noise, SETTINGS.health.max_blind_s, RIG, seed)
    estimates = [estimator.process(frame) for frame in frames]
    return [estimate for estimate in estimates if estimate is not None]


@pytest.fixture(scope="module")
def walk() -> list[FrameEstimate]:
    return run([draw(k, path(k)) for k in range(60)])


def true_T_WI(k: int) -> np.ndarray:
    T_WC0 = se3.from_rt(R_LEVEL_WC, -R_LEVEL_WC @ T_CI[:3, 3])
    return T_WC0 @ path(k) @ T_CI


def test_the_pose_is_that_of_the_imu(walk: list[FrameEstimate]) -> None:
    assert walk[0].pose is not None
    np.testing.assert_allclose(walk[0].pose.T_WI, np.eye(4), atol=1e-9)
    assert walk[0].events == ("initialised",)
    for k, estimate in enumerate(walk):
        assert estimate.health.verdict.tracked, (k, estimate.health)
        assert estimate.pose is not None
        error = se3.log(se3.inv(true_T_WI(k)) @ estimate.pose.T_WI)
        assert np.linalg.norm(error[:3]) < 0.02
        assert np.rad2deg(np.linalg.norm(error[3:])) < 0.5


def test_velocity_and_covariance_are_in_the_world(walk: list[FrameEstimate]) -> None:
    k = 20
    pose = walk[k].pose
    assert pose is not None
    v_true = (true_T_WI(k)[:3, 3] - true_T_WI(k - 1)[:3, 3]) / (STEP_NS / 1e9)
    np.testing.assert_allclose(pose.v_W, v_true, atol=0.1)
    assert np.linalg.eigvalsh(pose.cov)[0] > 0.0
    assert np.sqrt(np.trace(pose.cov[3:6, 3:6])) < 0.05


def test_tracks_keep_their_ids(walk: list[FrameEstimate]) -> None:
    a, b = walk[10], walk[11]
    assert len(a.tracks_px) == len(a.track_ids) == len(a.track_inliers)
    both = np.intersect1d(a.track_ids[a.track_inliers], b.track_ids[b.track_inliers])
    assert len(both) > 50


def test_the_same_seed_gives_the_same_bytes() -> None:
    frames = [draw(k, path(k)) for k in range(15)]
    first, again = ([e.pose.T_WI.tobytes() for e in run(frames, 3) if e.pose is not None] for _ in range(2))
    assert len(first) == 15
    assert first == again


def test_imu_samples_are_ignored() -> None:
    estimator = VisualOdometry(SETTINGS.visual, SETTINGS.noise, SETTINGS.health.max_blind_s, RIG, 0)
    assert estimator.process(ImuSample(0, np.zeros(3), np.zeros(3))) is None


def test_frames_without_depth_are_refused_in_one_line() -> None:
    estimator = VisualOdometry(SETTINGS.visual, SETTINGS.noise, SETTINGS.health.max_blind_s, RIG, 0)
    with pytest.raises(InputError, match=r"estimator\.mode: 'visual' needs depth") as error:
        estimator.process(CameraFrame(0, 0, np.zeros((240, 320), np.uint8)))
    assert error.value.exit_code == 2


def test_it_waits_for_an_image_with_features() -> None:
    dark = CameraFrame(0, 0, np.zeros((240, 320), np.uint8), None, np.full((240, 320), 2.0, np.float32))
    (estimate,) = run([dark])
    assert estimate.pose is None
    assert estimate.health.verdict is Verdict.INITIALISING
    assert estimate.health.reasons == ("few features with depth: 0",)


def dark_frame(k: int) -> CameraFrame:
    gray = np.random.default_rng(k).integers(0, 3, (240, 320), dtype=np.uint8)
    return CameraFrame(k * STEP_NS, k, gray, None, np.zeros((240, 320), np.float32))


def test_after_a_blind_time_the_map_is_recognised_though_the_camera_moved() -> None:
    frames = [draw(k, path(k)) for k in range(10)]
    frames += [dark_frame(k) for k in range(10, 30)]
    frames += [draw(k, path(k)) for k in range(30, 33)]
    estimates = run(frames)
    for estimate in estimates[10:30]:
        assert estimate.health.verdict is Verdict.BLIND
        assert estimate.health.reasons
    assert estimates[30].events == ("relocalised",)
    for k in (30, 31, 32):
        pose = estimates[k].pose
        assert pose is not None
        assert np.linalg.norm(pose.T_WI[:3, 3] - true_T_WI(k)[:3, 3]) < 0.03


def test_uncertainty_grows_in_a_blind_time() -> None:
    estimates = run([draw(k, path(k)) for k in range(5)] + [dark_frame(k) for k in range(5, 12)])
    sigmas = [np.trace(e.pose.cov[3:6, 3:6]) for e in estimates[4:] if e.pose is not None]
    assert len(sigmas) == 8
    assert np.all(np.diff(sigmas) > 0)


def test_another_scene_is_a_new_start_and_no_wrong_pose() -> None:
    frames = [draw(k, path(k)) for k in range(5)]
    elsewhere = texture(1)
    late = 5 + int(SETTINGS.health.max_blind_s * 1e9 / STEP_NS) + 1
    frames += [draw(k, path(k), elsewhere) for k in [*range(5, 9), late, late + 1]]
    estimates = run(frames)
    assert all(e.health.verdict is Verdict.BLIND for e in estimates[5:9])
    assert estimates[9].events == ("reset", NEW_MAP)
    assert estimates[10].health.verdict.tracked
    assert estimates[10].pose is not None


def test_a_frozen_image_is_reported() -> None:
    frames = [draw(k, path(k)) for k in range(4)]
    same = CameraFrame(4 * STEP_NS, 4, frames[3].gray, None, frames[3].depth_m)
    estimate = run([*frames, same])[-1]
    assert estimate.health.verdict is Verdict.BLIND
    assert estimate.health.reasons == ("the image does not change",)


def test_an_implausible_motion_is_rejected() -> None:
    leap = se3.from_rt(np.eye(3), np.array([0.35, 0.0, 0.0]))
    settings = SETTINGS.model_copy(update={"visual": SETTINGS.visual.model_copy(update={"max_speed_m_s": 1.0})})
    estimator = VisualOdometry(settings.visual, settings.noise, settings.health.max_blind_s, RIG, 0)
    estimator.process(draw(0, np.eye(4)))
    estimate = estimator.process(draw(1, leap))
    assert estimate is not None
    assert estimate.health.verdict is Verdict.BLIND
    assert "implausible speed" in estimate.health.reasons[0]


def test_noise_is_not_mistaken_for_the_map() -> None:
    """Images of random corners with a good depth: no pose may follow from them."""
    frames = [draw(k, path(k)) for k in range(10)]
    depth = frames[0].depth_m
    for k in range(10, 30):
        rng = np.random.default_rng([4, k])
        noise = cv2.GaussianBlur(rng.integers(0, 255, (240, 320), dtype=np.uint8), (0, 0), 1.0 + 0.2 * (k % 5))
        frames.append(CameraFrame(k * STEP_NS, k, noise, None, depth))
    assert all(estimate.health.verdict is Verdict.BLIND for estimate in run(frames)[10:])


@pytest.mark.parametrize("contrast", [0.15, 0.06])
def test_poses_from_images_of_low_contrast_are_right_or_missing(contrast: float) -> None:
    frames = [draw(k, path(k)) for k in range(8)]
    for k in range(8, 40):
        frame = draw(k, path(k), (128 + contrast * (WALL.astype(float) - 128)).astype(np.uint8))
        frames.append(frame)
    for k, estimate in enumerate(run(frames)):
        if estimate.health.verdict.tracked:
            assert estimate.pose is not None
            assert np.linalg.norm(estimate.pose.T_WI[:3, 3] - true_T_WI(k)[:3, 3]) < 0.1, (k, estimate.health)
