"""The simulated camera's sensor: blur, noise, range and holes."""

import numpy as np
import pytest

from snakeslam.backends.sim.camera import Camera, camera_calibration
from snakeslam.backends.sim.renderer import HEIGHT_PX, WIDTH_PX, Render
from snakeslam.backends.sim.settings import CameraSettings
from snakeslam.robot.model import PRESETS

CALIBRATION = camera_calibration(CameraSettings(), PRESETS["sim35"])
FX, FY, CX, CY = CALIBRATION.intrinsics
CLEAN = CameraSettings(noise_grey_levels=0, depth_noise_m=0, depth_noise_per_m=0)


def _expose(render, settings, w_C=(0, 0, 0), seed=0):
    sensor = Camera(settings, CALIBRATION.intrinsics, np.random.default_rng(seed))
    return sensor.expose(0, 0, render, np.array(w_C, dtype=float))


def _flat_render(z_m, rgb=None):
    picture = np.full((HEIGHT_PX, WIDTH_PX, 3), 120, np.uint8) if rgb is None else rgb
    return Render(
        np.dstack([picture, np.full_like(picture[..., 0], 255)]), np.full((HEIGHT_PX, WIDTH_PX), 1.0 / z_m, np.float32)
    )


@pytest.mark.parametrize("z_m", [0.5, 2.0, 5.0])
def test_depth_noise_is_a_plus_b_z_squared(z_m):
    settings = CameraSettings(depth_noise_m=0.002, depth_noise_per_m=0.003)
    depth_m = _expose(_flat_render(z_m), settings).depth_m
    assert depth_m.std() == pytest.approx(0.002 + 0.003 * z_m**2, rel=0.03)
    assert depth_m.mean() == pytest.approx(z_m, abs=0.001)


@pytest.mark.parametrize(("z_m", "known"), [(0.2, False), (0.3, True), (5.5, True), (6.5, False)])
def test_depth_is_unknown_out_of_range(z_m, known):
    depth_m = _expose(_flat_render(z_m), CLEAN).depth_m
    assert np.all(depth_m > 0) if known else np.all(depth_m == 0)


def test_a_step_in_depth_leaves_a_hole_and_a_slanted_plane_does_not():
    rows = np.arange(HEIGHT_PX, dtype=np.float32)[:, None]
    ground = np.tile(np.maximum(rows - CY, 4.0) / (0.1 * FY), (1, WIDTH_PX)).astype(np.float32)
    seen = _expose(Render(_flat_render(1).rgba, ground), CLEAN).depth_m
    in_range = (1.0 / ground > 0.25) & (1.0 / ground < 6.0)
    in_range[: int(CY) + 7] = False
    assert np.all(seen[in_range] > 0)
    step = np.full((HEIGHT_PX, WIDTH_PX), 1.0, np.float32)
    step[:, 300:] = 0.5
    seen = _expose(Render(_flat_render(1).rgba, step), CLEAN).depth_m
    assert np.all(seen[:, 299:301] == 0)
    assert np.all(seen[:, :298] > 0)
    assert np.all(seen[:, 302:] > 0)


def _line():
    rgb = np.zeros((HEIGHT_PX, WIDTH_PX, 3), np.uint8)
    rgb[:, 318:322] = 250
    return rgb


def test_blur_is_as_long_as_the_turn_and_centred_on_the_stamp():
    w_rad_s = 2.0
    length_px = FX * w_rad_s * CLEAN.exposure_ms * 1e-3
    gray = _expose(_flat_render(2, _line()), CLEAN, (0, w_rad_s, 0)).gray[240].astype(float)
    columns = np.arange(WIDTH_PX)
    centre = (gray * columns).sum() / gray.sum()
    variance = (gray * (columns - centre) ** 2).sum() / gray.sum()
    assert centre == pytest.approx(319.5, abs=0.1)
    assert variance == pytest.approx((4**2 + length_px**2) / 12.0, rel=0.2)


def test_a_turn_about_the_line_does_not_blur_it_and_a_small_turn_changes_nothing():
    render = _flat_render(2, _line())
    still = _expose(render, CLEAN).gray
    np.testing.assert_array_equal(_expose(render, CLEAN, (0, 0.1, 0)).gray, still)
    turned = _expose(render, CLEAN, (2.0, 0, 0)).gray[60:420].astype(int)
    assert np.abs(turned[:, 319] - 250).max() <= 2
    np.testing.assert_allclose(turned[:, 310], 0, atol=2)


def test_image_noise_has_its_deviation_and_differs_from_frame_to_frame():
    sensor = Camera(CameraSettings(noise_grey_levels=3.0), CALIBRATION.intrinsics, np.random.default_rng(1))
    first, second = (sensor.expose(0, k, _flat_render(2), np.zeros(3)).rgb.astype(float) for k in range(2))
    assert first.std() == pytest.approx(3.0, rel=0.05)
    assert (first - second).std() == pytest.approx(3.0 * np.sqrt(2), rel=0.05)


def test_a_frame_is_what_the_calibration_says():
    frame = _expose(_flat_render(2), CameraSettings())
    width, height = CALIBRATION.resolution
    assert frame.gray.shape == (height, width)
    assert frame.rgb.shape == (height, width, 3)
    assert frame.depth_m.dtype == np.float32
    assert frame.exposure_ns == 8_000_000
    units = frame.depth_m * np.float32(CALIBRATION.depth_scale)
    np.testing.assert_allclose(units, np.rint(units), atol=1e-3, err_msg="depth comes in whole units")
    np.testing.assert_allclose(2 * np.rad2deg(np.arctan(320 / FX)), 80.0)
    np.testing.assert_allclose(CALIBRATION.T_CI, PRESETS["sim35"].T_CI)
