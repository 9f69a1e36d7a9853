"""EuRoC and TUM RGB-D folders: what is read, in which order, and every mistake in one line."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from snakeslam.backends.replay.backend import ReplayBackend
from snakeslam.errors import InputError, NotBuiltError
from snakeslam.geometry import se3
from snakeslam.messages import CameraFrame, GroundTruth, ImuSample, Packet
from snakeslam.recording.datasets import find_recordings, open_recording, recording_kind
from snakeslam.recording.datasets.common import nearest_pairs
from snakeslam.recording.settings import ReplaySettings
from tests.small_recordings import EUROC_START_NS, HEIGHT, WIDTH, grey_image, write_euroc, write_tum

SETTINGS = ReplaySettings()


def play(path: Path, settings: ReplaySettings = SETTINGS) -> tuple[list[Packet], list[GroundTruth], ReplayBackend]:
    backend = ReplayBackend(path, settings)
    packets: list[Packet] = []
    truth: list[GroundTruth] = []
    while (step := backend.step(None)) is not None:
        packets += step
        truth += backend.read_ground_truth()
        assert not truth or truth[-1].t_ns <= backend.t_ns
    truth += backend.read_ground_truth()
    backend.close()
    backend.close()
    return packets, truth, backend


def test_euroc_gives_sensors_in_order_and_the_truth_of_the_imu(tmp_path: Path) -> None:
    packets, truth, backend = play(write_euroc(tmp_path / "clip"))
    frames = [packet for packet in packets if isinstance(packet, CameraFrame)]
    imu = [packet for packet in packets if isinstance(packet, ImuSample)]
    assert [packet.t_ns for packet in packets] == sorted(packet.t_ns for packet in packets)
    assert (len(frames), len(imu)) == (4, 31)
    assert isinstance(packets[0], ImuSample), "at equal stamps the IMU comes first"
    assert isinstance(packets[1], CameraFrame)
    assert frames[0].t_ns == EUROC_START_NS
    np.testing.assert_array_equal(frames[2].gray, grey_image(2))
    assert frames[0].rgb is None
    assert frames[0].depth_m is None
    np.testing.assert_allclose(imu[0].gyro_I, [0.01, 0.02, 0.03])
    np.testing.assert_allclose(imu[0].accel_I, [0.1, 0.2, 9.8])
    assert [sample.T_WI[0, 3] for sample in truth] == [0, 1, 2, 3]
    np.testing.assert_allclose(truth[0].v_W, [1, 0, 0])
    np.testing.assert_allclose(truth[0].gyro_bias_I, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(truth[0].accel_bias_I, [0.4, 0.5, 0.6])
    assert backend.model is None
    assert backend.recording.name == "clip"


def test_euroc_extrinsics_are_inverted_to_kalibrs_direction(tmp_path: Path) -> None:
    """T_BS maps the sensor to the body; T_cam_imu the body to the camera."""
    cam0 = open_recording(write_euroc(tmp_path / "clip"), SETTINGS).rig.cam0
    np.testing.assert_allclose(se3.act(cam0.T_IC, np.zeros(3)), [0.1, 0.2, 0.3])
    np.testing.assert_allclose(se3.act(cam0.T_IC, np.array([1.0, 0, 0])), [0.1, 1.2, 0.3])
    assert cam0.distortion_model == "radtan"


def test_euroc_folder_and_its_mav0_are_the_same(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    assert play(folder)[2].recording.name == play(folder / "mav0")[2].recording.name
    assert len(play(folder)[0]) == len(play(folder / "mav0")[0])


def test_a_recording_may_lack_the_truth(tmp_path: Path) -> None:
    euroc, tum = write_euroc(tmp_path / "a"), write_tum(tmp_path / "b")
    (euroc / "mav0/state_groundtruth_estimate0/data.csv").unlink()
    (tum / "groundtruth.txt").unlink()
    assert play(euroc)[1] == []
    assert play(tum)[1] == []


def test_tum_gives_colour_and_depth_at_exact_stamps(tmp_path: Path) -> None:
    packets, truth, _ = play(write_tum(tmp_path / "clip"))
    assert [packet.t_ns for packet in packets] == [1_305_031_229_000_123_000 + 50_000_000 * k for k in range(4)]
    frame = packets[1]
    assert isinstance(frame, CameraFrame)
    assert frame.rgb is not None
    assert frame.depth_m is not None
    np.testing.assert_array_equal(frame.rgb[..., 2], grey_image(1))
    np.testing.assert_array_equal(frame.gray, cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY))
    np.testing.assert_allclose(frame.depth_m, np.ones((HEIGHT, WIDTH)))
    assert frame.depth_m.dtype == np.float32
    assert len(truth) == 4


def test_without_an_imu_the_imu_frame_is_the_cameras(tmp_path: Path) -> None:
    _, truth, backend = play(write_tum(tmp_path / "clip"))
    assert backend.rig.imu0 is None
    np.testing.assert_array_equal(backend.rig.cam0.T_CI, np.eye(4))
    np.testing.assert_array_equal(truth[0].T_WI, np.eye(4))


def test_with_an_imu_the_truth_moves_from_the_camera_to_it(tmp_path: Path) -> None:
    packets, truth, backend = play(write_tum(tmp_path / "clip", imu=True))
    assert sum(isinstance(packet, ImuSample) for packet in packets) == 31
    np.testing.assert_allclose(truth[1].T_WI @ backend.rig.cam0.T_IC, se3.from_rt(np.eye(3), [1.0, 0, 0]), atol=1e-12)


def test_the_time_shift_is_applied_once(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "clip", imu=True)
    calibration = folder / "calibration.yaml"
    calibration.write_text(
        calibration.read_text().replace("  depth_scale", "  timeshift_cam_imu: 0.003\n  depth_scale")
    )
    packets, _, backend = play(folder)
    first = next(packet for packet in packets if isinstance(packet, CameraFrame))
    assert first.t_ns == 1_305_031_229_003_123_000
    assert backend.rig.cam0.timeshift_cam_imu == 0.0


def test_a_frame_without_its_depth_image_has_unknown_depth(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "clip")
    lines = (folder / "depth.txt").read_text().splitlines()
    (folder / "depth.txt").write_text("\n".join(lines[:2] + lines[3:]))
    frame = play(folder)[0][1]
    assert isinstance(frame, CameraFrame)
    assert frame.depth_m is not None
    assert not frame.depth_m.any()


@pytest.mark.parametrize(
    ("name", "fx"), [("rgbd_dataset_freiburg1_xyz", 517.3), ("tum_fr2_desk", 520.9), ("fr3", 535.4)]
)
def test_the_benchmarks_calibration_is_found_by_name(tmp_path: Path, name: str, fx: float) -> None:
    folder = write_tum(tmp_path / name, calibrated=False)
    with pytest.raises(InputError, match=r"64 x 48 px .*640 x 480"):
        open_recording(folder, SETTINGS)
    for image in folder.glob("*/*.png"):
        pixels = cv2.imread(str(image), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(image), cv2.resize(pixels, (640, 480)))
    assert open_recording(folder, SETTINGS).rig.cam0.intrinsics[0] == fx


def test_the_folders_calibration_goes_before_its_name_and_the_setting_before_both(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "fr1")
    assert open_recording(folder, SETTINGS).rig.cam0.intrinsics[0] == 50.0
    other = tmp_path / "other.yaml"
    other.write_text((folder / "calibration.yaml").read_text().replace("intrinsics: [50.0", "intrinsics: [51.0"))
    recording = open_recording(folder, ReplaySettings(calibration=other))
    assert recording.rig.cam0.intrinsics[0] == 51.0
    assert [note for note in recording.notes if "replay.calibration is used instead of" in note]


def test_the_setting_gives_a_calibration_to_a_folder_without(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "clip")
    (folder / "calibration.yaml").rename(tmp_path / "other.yaml")
    with pytest.raises(InputError, match=r"calibration\.yaml: the file is missing.*replay\.calibration"):
        open_recording(folder, SETTINGS)
    rig = open_recording(folder, ReplaySettings(calibration=tmp_path / "other.yaml")).rig
    assert rig.cam0.intrinsics[0] == 50.0


def test_start_leaves_out_the_beginning(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    packets, truth, _ = play(folder, ReplaySettings(start_s=0.06))
    assert packets[0].t_ns >= EUROC_START_NS + 60_000_000
    assert sum(isinstance(packet, CameraFrame) for packet in packets) == 2
    assert len(truth) == 2
    with pytest.raises(InputError, match=r"replay\.start_s"):
        play(folder, ReplaySettings(start_s=9.0))


def test_pairs_are_the_nearest_and_used_once() -> None:
    assert nearest_pairs([0, 10, 20], [9, 19, 40], limit_ns=15) == {1: 0, 2: 1}
    assert nearest_pairs([0, 10], [4, 5], limit_ns=20) == {0: 0, 1: 1}
    assert nearest_pairs([0], [100], limit_ns=20) == {}


def edit(path: str, change: Callable[[str], str]) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        (folder / path).write_text(change((folder / path).read_text()))

    return apply


def remove(path: str) -> Callable[[Path], None]:
    return lambda folder: (folder / path).unlink()


def cut(pattern: str, keep: float) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        image = sorted(folder.glob(pattern))[1]
        image.write_bytes(image.read_bytes()[: int(image.stat().st_size * keep)])

    return apply


def swap_rows(text: str) -> str:
    lines = text.splitlines()
    return "\n".join([*lines[:2], lines[3], lines[2], *lines[4:]])


def repeat_row(text: str) -> str:
    lines = text.splitlines()
    return "\n".join([*lines[:3], *lines[2:]])


IMU, CAM, TRUTH = "mav0/imu0/data.csv", "mav0/cam0/data.csv", "mav0/state_groundtruth_estimate0/data.csv"

EUROC_MISTAKES = {
    "imu table missing": (remove(IMU), r"imu0/data\.csv: the file is missing"),
    "imu calibration missing": (remove("mav0/imu0/sensor.yaml"), r"imu0/sensor\.yaml: the file is missing"),
    "frame table missing": (remove(CAM), r"cam0/data\.csv: the file is missing"),
    "image missing": (remove(f"mav0/cam0/data/{EUROC_START_NS}.png"), r"\.png: the image is missing"),
    "nan": (edit(IMU, lambda s: s.replace("0.02", "nan", 1)), r"data\.csv: line 2: column 3: 'nan' is not a finite"),
    "infinite": (edit(IMU, lambda s: s.replace("9.8", "inf", 1)), r"line 2: column 7: 'inf' is not a finite number"),
    "no number": (edit(IMU, lambda s: s.replace("0.03", "fast", 1)), r"line 2: column 4: 'fast' is not a number"),
    "short row": (edit(IMU, lambda s: s.replace(",9.8\n", "\n", 1)), r"line 2: 6 columns \(allowed: 7 or more\)"),
    "half a row": (edit(IMU, lambda s: s[:-12]), r"line 32: \d columns"),
    "broken stamp": (edit(IMU, lambda s: s.replace("14037", "14x37", 1)), "line 2: the timestamp '14x37"),
    "back in time": (edit(IMU, swap_rows), r"line 4: the timestamp \d+ goes back"),
    "frames back in time": (edit(CAM, swap_rows), r"cam0/data\.csv: line 4: .* goes back"),
    "repeated frame": (edit(CAM, repeat_row), r"cam0/data\.csv: line 4: .* repeats"),
    "truth back in time": (edit(TRUTH, swap_rows), r"state_groundtruth_estimate0/data\.csv: line 4: .* goes back"),
    "truth nan": (edit(TRUTH, lambda s: s.replace(",1,0,0,0,1", ",1,0,nan,0,1", 1)), "line 2: column 7: 'nan'"),
    "truth no rotation": (edit(TRUTH, lambda s: s.replace(",1,0,0,0,1", ",3,0,0,0,1", 1)), "line 2: the quaternion"),
    "no rows": (edit(IMU, lambda s: s.splitlines()[0]), r"data\.csv: has no rows"),
    "truncated": (cut("mav0/cam0/data/*.png", 0.6), r"\.png: the image is truncated"),
    "header only": (cut("mav0/cam0/data/*.png", 0.003), r"\.png: the image is truncated|is not an image"),
    "empty image": (cut("mav0/cam0/data/*.png", 0.0), r"\.png: the image is empty"),
    "no image": (
        lambda folder: (folder / f"mav0/cam0/data/{EUROC_START_NS}.png").write_text("x" * 99),
        "is not an image",
    ),
    "other size": (edit("mav0/cam0/sensor.yaml", lambda s: s.replace("[64", "[65")), r"64 x 48 px \(allowed: 65 x 48"),
    "broken key": (edit("mav0/cam0/sensor.yaml", lambda s: s.replace("[50.0", "[-50.0")), r"sensor\.yaml: intrinsics"),
    "no extrinsics": (edit("mav0/cam0/sensor.yaml", lambda s: s.replace("T_BS", "T_SB")), r"sensor\.yaml: T_BS"),
    "no noise": (edit("mav0/imu0/sensor.yaml", lambda s: s.replace("gyroscope_noise", "x")), "gyroscope_noise_density"),
    "binary table": (lambda folder: (folder / IMU).write_bytes(b"\xff\xfe\x00"), "is not a text file"),
}


@pytest.mark.parametrize("mistake", EUROC_MISTAKES)
def test_a_mistake_in_euroc_is_one_clear_line(tmp_path: Path, mistake: str) -> None:
    break_it, expected = EUROC_MISTAKES[mistake]
    folder = write_euroc(tmp_path / "clip")
    break_it(folder)
    with pytest.raises(InputError, match=expected) as caught:
        ReplayBackend(folder, SETTINGS)
    assert "\n" not in str(caught.value)


TUM_MISTAKES = {
    "no colour list": (remove("rgb.txt"), r"rgb\.txt: the file is missing"),
    "no depth list": (remove("depth.txt"), r"depth\.txt: the file is missing"),
    "bad stamp": (edit("rgb.txt", lambda s: s.replace("1305031229.", "nan.", 1)), "line 2: the timestamp 'nan"),
    "no file name": (
        edit("depth.txt", lambda s: s.replace(" depth/", " #depth/", 1).replace(" #depth", "#depth", 1)),
        r"depth\.txt: line 2: 1 column ",
    ),
    "back in time": (edit("rgb.txt", swap_rows), r"rgb\.txt: line 4: .* goes back"),
    "out of the folder": (edit("rgb.txt", lambda s: s.replace("rgb/", "../rgb/", 1)), "leads out of the folder"),
    "truth": (
        edit("groundtruth.txt", lambda s: s.replace(" 0 0 1", " 0 1", 1)),
        r"groundtruth\.txt: line 2: 7 columns",
    ),
    "no association": (edit("depth.txt", lambda s: s.replace("1305031229.", "1305031239.")), "within 20 ms"),
    "truncated depth": (cut("depth/*.png", 0.9), r"depth/.*\.png: the image is truncated"),
    "8-bit depth": (
        lambda folder: cv2.imwrite(str(sorted(folder.glob("depth/*.png"))[1]), grey_image(1)),
        r"8 bits a sample \(allowed: 16\)",
    ),
    "no depth scale": (edit("calibration.yaml", lambda s: s.replace("  depth_scale: 5000.0\n", "")), "depth_scale"),
    "imu row": (edit("imu.csv", lambda s: s.replace("0.5,", "NaN,", 1)), r"imu\.csv: line 2: column 4: 'NaN'"),
    "imu uncalibrated": (edit("calibration.yaml", lambda s: s.split("imu0:")[0]), r"imu\.csv: .* no imu0"),
}


@pytest.mark.parametrize("mistake", TUM_MISTAKES)
def test_a_mistake_in_tum_is_one_clear_line(tmp_path: Path, mistake: str) -> None:
    break_it, expected = TUM_MISTAKES[mistake]
    folder = write_tum(tmp_path / "clip", imu=True)
    break_it(folder)
    with pytest.raises(InputError, match=expected) as caught:
        ReplayBackend(folder, SETTINGS)
    assert "\n" not in str(caught.value)


def test_damage_inside_an_image_is_found_when_it_is_read(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    image = sorted(folder.glob("mav0/cam0/data/*.png"))[2]
    data = bytearray(image.read_bytes())
    data[len(data) // 2] ^= 0xFF
    image.write_bytes(bytes(data))
    with pytest.raises(InputError, match=f"{image.name}: the image is damaged"):
        play(folder)


def test_jpeg_ends_and_sizes_are_checked(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "clip")
    for image in folder.glob("rgb/*.png"):
        cv2.imwrite(str(image.with_suffix(".jpg")), cv2.imread(str(image)))
    edit("rgb.txt", lambda s: s.replace(".png", ".jpg"))(folder)
    assert len(play(folder)[0]) == 4
    image = sorted(folder.glob("rgb/*.jpg"))[3]
    whole = image.read_bytes()
    image.write_bytes(whole + b"\x00" * 16)
    assert len(play(folder)[0]) == 4, "padding after the end is harmless"
    image.write_bytes(whole[:-40])
    with pytest.raises(InputError, match=f"{image.name}: the image is truncated"):
        ReplayBackend(folder, SETTINGS)
    cv2.imwrite(str(image), np.zeros((HEIGHT, WIDTH + 1), np.uint8))
    with pytest.raises(InputError, match="65 x 48 px"):
        ReplayBackend(folder, SETTINGS)


def test_what_is_no_recording_is_said_to_be_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such recording"):
        open_recording(tmp_path / "nothing", SETTINGS)
    with pytest.raises(InputError, match="is not a recording"):
        open_recording(tmp_path, SETTINGS)
    (tmp_path / "a.mcap").touch()
    with pytest.raises(NotBuiltError, match="not built yet"):
        open_recording(tmp_path / "a.mcap", SETTINGS)


def test_recordings_are_listed_broken_ones_too(tmp_path: Path) -> None:
    write_euroc(tmp_path / "b")
    write_tum(tmp_path / "a")
    remove("rgb.txt")(write_tum(tmp_path / "c"))
    (tmp_path / "notes").mkdir()
    found = find_recordings(tmp_path)
    assert [(one.name, one.kind, one.frames) for one in found] == [
        ("a", "tum_rgbd", 4),
        ("b", "euroc", 4),
        ("c", "tum_rgbd", None),
    ]
    assert found[1].duration_s == pytest.approx(0.15)
    assert find_recordings(tmp_path / "nowhere") == []
    assert recording_kind(tmp_path / "notes") is None


def test_the_real_euroc_clip(shared_data: Path) -> None:
    packets, truth, backend = play(shared_data / "euroc_v101_moving")
    frames = [packet for packet in packets if isinstance(packet, CameraFrame)]
    assert len(frames) == 90
    assert frames[0].gray.shape == (480, 752)
    assert frames[0].t_ns == 1403715285262142976
    assert frames[0].t_ns - packets[0].t_ns == 1_000_000_000
    assert backend.rig.imu0 is not None
    np.testing.assert_allclose(backend.rig.cam0.T_IC[:3, 3], [-0.0216401454975, -0.064676986768, 0.00981073058949])
    speeds = [np.linalg.norm(b.T_WI[:3, 3] - a.T_WI[:3, 3]) / 0.05 for a, b in pairwise(truth)]
    known = [np.linalg.norm(sample.v_W) for sample in truth[1:] if sample.v_W is not None]
    np.testing.assert_allclose(speeds, known, atol=0.08)


def test_the_real_tum_clip(shared_data: Path) -> None:
    backend = ReplayBackend(shared_data / "tum_fr1_rpy_part1", SETTINGS)
    packets = backend.step(None)
    assert packets is not None
    (frame,) = packets
    assert isinstance(frame, CameraFrame)
    assert frame.t_ns == 1305031229528748000
    assert frame.depth_m is not None
    assert frame.depth_m.shape == (480, 640)
    assert 0.4 < float(np.median(frame.depth_m[frame.depth_m > 0])) < 4.0
    assert len(backend.recording.frames) == 200
    assert backend.rig.cam0.intrinsics == (517.3, 516.5, 318.6, 255.3)
