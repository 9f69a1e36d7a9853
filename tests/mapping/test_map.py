"""Keyframe chunks and their export."""

from pathlib import Path

import numpy as np
import pytest

from snakeslam.calibration import CameraCalibration
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.geometry import se3, so3
from snakeslam.mapping.chunks import depth_points, trusted_depth
from snakeslam.mapping.export import write_ply
from snakeslam.mapping.keyframes import KeyframeMapper
from snakeslam.mapping.settings import MappingSettings
from snakeslam.mapping.voxels import Voxels
from snakeslam.messages import CameraFrame, MapChunk

IDENTITY = tuple(tuple(row) for row in np.eye(4).tolist())
CAMERA = CameraCalibration(T_cam_imu=IDENTITY, intrinsics=(400.0, 410.0, 320.0, 240.0), resolution=(640, 480))
SETTINGS = MappingSettings()


def wall(depth_m: float = 2.0, seq: int = 0, t_ns: int = 0) -> CameraFrame:
    """A flat wall across the view, its colour the column's."""
    rgb = np.repeat(np.arange(640, dtype=np.uint8)[None, :, None], 480, axis=0).repeat(3, axis=2)
    return CameraFrame(t_ns, seq, rgb[..., 0], rgb, np.full((480, 640), depth_m, np.float32))


def test_points_lie_where_the_depth_says_in_the_colour_of_their_pixel() -> None:
    points, rgb = depth_points(wall(), PinholeCamera(CAMERA), SETTINGS)
    assert len(points) == 160 * 120
    np.testing.assert_allclose(points[:, 2], 2.0)
    u = points[:, 0] / points[:, 2] * 400.0 + 320.0
    np.testing.assert_array_equal(np.rint(u).astype(np.int64) % 256, rgb[:, 0])


def cells(points: np.ndarray) -> set[tuple[int, ...]]:
    return {tuple(c) for c in np.floor(points / SETTINGS.voxel_m).astype(int).tolist()}


def test_one_point_a_voxel_of_the_world() -> None:
    points = np.random.default_rng(1).uniform(-0.2, 0.2, (2000, 3))
    voxels = Voxels(SETTINGS.voxel_m)
    chosen = voxels.fill(points, 10_000)
    assert len(chosen) == len(cells(points)) == len(cells(points[chosen]))
    again = np.random.default_rng(2).uniform(-0.2, 0.3, (2000, 3))
    assert cells(again[voxels.fill(again, 10_000)]) == cells(again) - cells(points)


def test_too_many_points_are_cut_evenly_and_the_rest_may_come_later() -> None:
    points = np.stack([np.arange(1000) * 0.05, np.zeros(1000), np.zeros(1000)], axis=-1)
    voxels = Voxels(SETTINGS.voxel_m)
    first = voxels.fill(points, 100)
    assert len(first) == 100
    assert np.diff(first).max() <= 11
    rest = voxels.fill(points, 10_000)
    assert sorted([*first.tolist(), *rest.tolist()]) == list(range(1000))


def test_a_view_of_known_space_adds_only_new_points() -> None:
    settings = MappingSettings(max_points=20_000)
    mapper = KeyframeMapper(settings, CAMERA)
    counts = []
    for k in range(6):
        T_WC = se3.from_rt(np.eye(3), np.array([0.2 * k, 0.0, 0.0]))
        counts.append(sum(len(chunk.points_K) for chunk in mapper.update(wall(seq=k, t_ns=k * 10**9), T_WC)))
    assert counts[0] > 8000
    assert all(0 < count < 0.15 * counts[0] for count in counts[1:])


def test_depth_edges_and_what_is_out_of_range_are_left_out() -> None:
    depth = np.full((480, 640), 1.0, np.float32)
    depth[:, 320:] = 2.0
    depth[:100] = 0.0
    trusted = trusted_depth(depth, SETTINGS)
    assert not trusted[:, 318:322].any() or not trusted[200, 319:321].any()
    assert not trusted[:100].any()
    assert trusted[200, 100]
    assert trusted[200, 500]


def test_a_new_view_is_a_keyframe() -> None:
    mapper = KeyframeMapper(SETTINGS, CAMERA)
    poses = [(0.0, 0.0), (0.05, 0.0), (0.2, 0.0), (0.2, 30.0), (0.0, 0.0)]
    taken = []
    for k, (x, yaw_deg) in enumerate(poses):
        T_WC = se3.from_rt(so3.from_yaw(np.deg2rad(yaw_deg)), np.array([x, 0.0, 0.0]))
        taken.append(len(mapper.update(wall(seq=k, t_ns=k * 10**9), T_WC)))
    assert taken == [1, 0, 1, 1, 0]


def test_a_blurred_frame_is_no_keyframe() -> None:
    mapper = KeyframeMapper(SETTINGS, CAMERA)
    assert mapper.update(wall(), np.eye(4))
    turned = se3.from_rt(so3.from_yaw(np.deg2rad(40.0)), np.zeros(3))
    assert not mapper.update(wall(t_ns=50_000_000), turned)
    assert mapper.update(wall(t_ns=100_000_000), turned)


def test_grey_and_monocular_frames() -> None:
    grey = CameraFrame(0, 0, wall().gray, None, wall().depth_m)
    (chunk,) = KeyframeMapper(SETTINGS, CAMERA).update(grey, np.eye(4))
    assert (chunk.rgb[:, 0] == chunk.rgb[:, 1]).all()
    assert KeyframeMapper(SETTINGS, CAMERA).update(CameraFrame(0, 0, wall().gray), np.eye(4)) == ()


def parse_ply(data: bytes) -> tuple[list[str], np.ndarray]:
    """Read the PLY by its own header."""
    head, _, body = data.partition(b"end_header\n")
    lines = head.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    count = int(next(line for line in lines if line.startswith("element vertex")).split()[-1])
    types = {"float": "<f4", "uchar": "u1"}
    fields = [(line.split()[2], types[line.split()[1]]) for line in lines if line.startswith("property")]
    return [name for name, _ in fields], np.frombuffer(body, np.dtype(fields), count=count)


def test_ply_holds_every_point_in_world_coordinates(tmp_path: Path) -> None:
    T_WK = se3.from_rt(so3.from_yaw(np.pi / 2), np.array([1.0, 2.0, 3.0]))
    chunk = MapChunk(0, 0, T_WK, np.array([[1.0, 0.0, 0.5]]), np.array([[10, 20, 30]]))
    write_ply(tmp_path / "map.ply", [chunk, chunk])
    names, vertices = parse_ply((tmp_path / "map.ply").read_bytes())
    assert names == ["x", "y", "z", "red", "green", "blue"]
    assert len(vertices) == 2
    assert vertices[1].tolist() == pytest.approx((1.0, 3.0, 3.5, 10, 20, 30))


def test_an_empty_map_is_a_valid_file(tmp_path: Path) -> None:
    write_ply(tmp_path / "map.ply", [])
    assert len(parse_ply((tmp_path / "map.ply").read_bytes())[1]) == 0
