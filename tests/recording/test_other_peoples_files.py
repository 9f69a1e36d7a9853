"""Recordings as other tools write them: what they accept is read, what cannot be right is refused in one line."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from snakeslam.backends.replay.backend import ReplayBackend
from snakeslam.errors import InputError
from snakeslam.messages import CameraFrame, GroundTruth, ImuSample, Packet
from snakeslam.recording.datasets import open_recording
from snakeslam.recording.recording import Recording
from snakeslam.recording.settings import ReplaySettings
from tests.small_recordings import CALIBRATION, EUROC_START_NS, HEIGHT, WIDTH, grey_image, write_euroc, write_tum

IMU, CAM, TRUTH = "mav0/imu0/data.csv", "mav0/cam0/data.csv", "mav0/state_groundtruth_estimate0/data.csv"
CAM_YAML, IMU_YAML = "mav0/cam0/sensor.yaml", "mav0/imu0/sensor.yaml"
Change = Callable[[str], str]


def edit(folder: Path, name: str, change: Change) -> None:
    (folder / name).write_bytes(change((folder / name).read_text()).encode())


def rows(change: Callable[[list[str]], list[str]], separator: str = ",") -> Change:
    """A change of the cells of each row that is no comment."""

    def apply(text: str) -> str:
        lines = (
            line if line.startswith("#") else separator.join(change(line.split(","))) for line in text.splitlines()
        )
        return "\n".join(lines) + "\n"

    return apply


def read(folder: Path, **settings: Any) -> Recording:
    return open_recording(folder, ReplaySettings(**settings))


def refusal(folder: Path, **settings: Any) -> str:
    with pytest.raises(InputError) as caught:
        read(folder, **settings)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def packets_of(folder: Path) -> list[Packet]:
    return list(read(folder).packets())


def frames_of(folder: Path) -> list[CameraFrame]:
    return [packet for packet in packets_of(folder) if isinstance(packet, CameraFrame)]


FORMS: dict[str, Change] = {
    "exponents": rows(lambda c: [c[0], *(f"{float(v):+.18e}" for v in c[1:])]),
    "stamps as floats": rows(lambda c: [f"{int(c[0])}.0", *c[1:]]),
    "spaces": rows(lambda c: c, " "),
    "tabs": rows(lambda c: c, "\t"),
    "commas and spaces": rows(lambda c: c, " ,  "),
    "semicolons": rows(lambda c: c, ";"),
    "comma then tabs": rows(lambda c: [f"{c[0]},{c[1]}", *c[2:]], "\t"),
    "quoted": rows(lambda c: [f'"{cell}"' for cell in c]),
    "trailing comma": rows(lambda c: [*c, ""]),
    "trailing spaces": rows(lambda c: [*c[:-1], c[-1] + "  \t"]),
    "extra columns": rows(lambda c: [*c, "7", "a word"]),
    "windows": lambda text: "\ufeff" + text.replace("\n", "\r\n"),
    "comments": lambda text: "# one\n\n#two\n" + text.replace("\n", "  # said\n") + "\n\n",
    "title without a hash": lambda text: text.removeprefix("#"),
    "title below a comment": lambda text: "# from a tool\n" + text.removeprefix("#"),
    "no end of line": lambda text: text.rstrip("\n"),
}


@pytest.mark.parametrize(("table", "form"), [*((IMU, form) for form in FORMS), *((TRUTH, form) for form in FORMS)])
def test_numbers_are_read_as_other_tools_write_them(tmp_path: Path, table: str, form: str) -> None:
    plain, changed = write_euroc(tmp_path / "plain"), write_euroc(tmp_path / "changed")
    edit(changed, table, FORMS[form])
    expected, found = read(plain), read(changed)
    assert expected.imu is not None
    assert found.imu is not None
    np.testing.assert_array_equal(found.imu.t_ns, expected.imu.t_ns)
    np.testing.assert_array_equal(found.imu.gyro_I, expected.imu.gyro_I)
    np.testing.assert_array_equal(found.imu.accel_I, expected.imu.accel_I)
    assert [sample.t_ns for sample in found.truth] == [sample.t_ns for sample in expected.truth]
    np.testing.assert_array_equal([s.T_WI for s in found.truth], [s.T_WI for s in expected.truth])


@pytest.mark.parametrize(
    "form", ["spaces", "tabs", "semicolons", "quoted", "trailing comma", "extra columns", "windows", "comments"]
)
def test_image_lists_are_read_as_other_tools_write_them(tmp_path: Path, form: str) -> None:
    euroc, tum = write_euroc(tmp_path / "euroc"), write_tum(tmp_path / "tum")
    if form != "comments":
        edit(euroc, CAM, FORMS[form])
        for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
            edit(tum, name, lambda text: FORMS[form](text.replace(" ", ",")))
    assert [frame.t_ns for frame in frames_of(euroc)] == [EUROC_START_NS + 50_000_000 * k for k in range(4)]
    assert len(frames_of(tum)) == 4
    assert len(read(tum).truth) == 4


def test_what_evo_writes_is_the_same_trajectory(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "clip")
    plain = read(folder).truth
    np.savetxt(folder / "groundtruth.txt", np.loadtxt(folder / "groundtruth.txt"))
    found = read(folder).truth
    assert "e+09 " in (folder / "groundtruth.txt").read_text()
    np.testing.assert_allclose([s.t_ns for s in found], [s.t_ns for s in plain], rtol=0, atol=500)
    np.testing.assert_array_equal([s.T_WI for s in found], [s.T_WI for s in plain])


BROKEN_ROWS: dict[str, tuple[str, Change, str]] = {
    "empty cell": (IMU, lambda s: s.replace(",0.02,", ",,", 1), "data.csv: line 2: column 3: '' is not a number"),
    "word": (IMU, lambda s: s.replace("9.8", "9.8x", 1), "line 2: column 7: '9.8x' is not a number"),
    "minus infinite": (IMU, lambda s: s.replace("9.8", "-inf", 1), "line 2: column 7: '-inf' is not a finite number"),
    "overflow": (IMU, lambda s: s.replace("9.8", "1e999", 1), "line 2: column 7: '1e999' is not a finite number"),
    "negative stamp": (IMU, lambda s: s.replace("14037", "-14037", 1), "line 2: the timestamp -14037"),
    "beyond 64 bits": (IMU, lambda s: s.replace("140371", "9403715", 1), "is beyond 64 bits of nanoseconds"),
    "huge exponent": (IMU, lambda s: s.replace("14037", "1e9999999,", 1), "is not a whole number"),
    "half a row of truth": (TRUTH, lambda s: s[:-20], "data.csv: line 5: 10 columns (allowed: 17 or more, as in the"),
    "three columns of truth": (TRUTH, rows(lambda c: c[:3]), "line 2: 3 columns (allowed: 4, 8 or more)"),
    "out of the folder": (CAM, lambda s: s.replace(f",{EUROC_START_NS}", ",../../x", 1), "leads out of the folder"),
}


@pytest.mark.parametrize("mistake", BROKEN_ROWS)
def test_a_broken_row_is_refused_with_its_line(tmp_path: Path, mistake: str) -> None:
    table, change, expected = BROKEN_ROWS[mistake]
    folder = write_euroc(tmp_path / "clip")
    edit(folder, table, change)
    assert expected in refusal(folder)


def restamped(change: Callable[[int], int | float | str]) -> Change:
    return rows(lambda c: [str(change(int(c[0]))), *c[1:]])


CLOCKS: dict[str, tuple[dict[str, Change], str]] = {
    "all in us": (
        {name: restamped(lambda t: t // 1000) for name in (IMU, CAM, TRUTH)},
        "cam0/data.csv: the timestamps are 0.05 ms apart, 20000 Hz, the calibration says 20 Hz (allowed: timestamps in",
    ),
    "frames in ms": ({CAM: restamped(lambda t: t // 10**6)}, "cam0/data.csv: the timestamps are 5e-05 ms apart"),
    "imu in us": ({IMU: restamped(lambda t: t // 1000)}, "imu0/data.csv: the timestamps are 0.005 ms apart, 200000 Hz"),
    "imu in seconds": ({IMU: restamped(lambda t: f"{t / 1e9:.9f}")}, "is not a whole number of nanoseconds; are these"),
    "imu since boot": (
        {IMU: restamped(lambda t: t - EUROC_START_NS + 5 * 10**9)},
        "imu0/data.csv: no sample lies within the frames' time (samples 5.000 to 5.150 s, frames 1403715285.262",
    ),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_another_clock_or_unit_is_refused(tmp_path: Path, clock: str) -> None:
    changes, expected = CLOCKS[clock]
    folder = write_euroc(tmp_path / "clip")
    for name, change in changes.items():
        edit(folder, name, change)
    assert expected in refusal(folder)


@pytest.mark.parametrize(
    ("factor", "epoch", "said"),
    [(10**9, 0, "beyond 64 bits"), (1000, 0, "beyond 64 bits"), (1000, 1305031229, "50000 ms apart, 0.02 Hz")],
)
def test_a_tum_folder_with_another_unit_is_refused(tmp_path: Path, factor: int, epoch: int, said: str) -> None:
    folder = write_tum(tmp_path / "clip")
    for name in ("rgb.txt", "depth.txt"):
        lines = [line.split(" ", 1) for line in (folder / name).read_text().splitlines()[1:]]
        scaled = [f"{(float(t) - epoch) * factor:.6f} {image}" for t, image in lines]
        (folder / name).write_text("\n".join(scaled) + "\n")
    (folder / "depth.txt").write_text((folder / "rgb.txt").read_text())
    assert said in refusal(folder)


def test_a_rate_that_is_merely_odd_is_noted(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    edit(folder, CAM_YAML, lambda s: s.replace("rate_hz: 20", "rate_hz: 60"))
    assert [n for n in read(folder).notes if "20 Hz, the calibration says 60 Hz" in n]


def test_frames_without_imu_and_gaps_are_noted(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip", frames=12)
    edit(folder, IMU, lambda s: "\n".join([*s.splitlines()[:1], *s.splitlines()[12:40], *s.splitlines()[80:]]) + "\n")
    notes = read(folder).notes
    assert [n for n in notes if "of 12 frames 2 lie before its first sample, 0 after its last" in n]
    assert [n for n in notes if "no sample for 0.205 s from 0.190 s after the first frame" in n]


def test_a_truth_of_another_time_is_noted(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    edit(folder, TRUTH, restamped(lambda t: t - 10**18))
    (note,) = read(folder).notes
    assert f"{TRUTH}: the ground truth does not overlap the frames in time" in note


def test_a_plain_recording_has_no_notes(tmp_path: Path) -> None:
    assert read(write_euroc(tmp_path / "a")).notes == ()
    assert read(write_tum(tmp_path / "b", imu=True)).notes == ()


def rewrite_images(folder: Path, change: Callable[[np.ndarray], np.ndarray], suffix: str = ".png") -> None:
    for path in sorted((folder / "mav0/cam0/data").glob("*.png")):
        image = change(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
        assert cv2.imwrite(str(path.with_suffix(suffix)), image)
        if suffix != ".png":
            path.unlink()


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_16_bit_images_are_scaled_by_the_bits_that_they_use(tmp_path: Path, bits: int) -> None:
    folder = write_euroc(tmp_path / "clip")
    brightest = max(int(grey_image(k).max()) for k in range(4))
    assert brightest >= 128
    rewrite_images(folder, lambda image: image.astype(np.uint16) << (bits - 8))
    np.testing.assert_array_equal(frames_of(folder)[2].gray, grey_image(2))
    said = [note for note in read(folder).notes if f"the images use {bits} of their 16 bits" in note]
    assert len(said) == (bits < 16)


def test_a_later_brighter_image_saturates_instead_of_wrapping(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip", frames=40)
    rewrite_images(folder, lambda image: image.astype(np.uint16))
    bright = sorted((folder / "mav0/cam0/data").glob("*.png"))[1]
    cv2.imwrite(str(bright), np.full((HEIGHT, WIDTH), 5000, np.uint16))
    assert frames_of(folder)[1].gray.min() == 255


IMAGE_KINDS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "grey": lambda image: image,
    "colour": lambda image: cv2.merge([image] * 3),
    "colour with alpha": lambda image: cv2.merge([image] * 3 + [np.full_like(image, 9)]),
    "16-bit colour": lambda image: cv2.merge([image.astype(np.uint16) << 8] * 3),
}


@pytest.mark.parametrize("kind", IMAGE_KINDS)
def test_colour_and_alpha_become_grey(tmp_path: Path, kind: str) -> None:
    folder = write_euroc(tmp_path / "clip")
    rewrite_images(folder, IMAGE_KINDS[kind])
    frame = frames_of(folder)[1]
    np.testing.assert_allclose(frame.gray.astype(int), grey_image(1).astype(int), atol=1)
    assert (frame.rgb is None) == (kind == "grey")


def test_a_palette_is_looked_up(tmp_path: Path) -> None:
    """A PNG of one bit with a palette, as the standard lays it out."""
    import struct
    import zlib

    folder = write_euroc(tmp_path / "clip")

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 1, 3, 0, 0, 0)
    pixels = zlib.compress((b"\x00" + b"\x0f" * (WIDTH // 8)) * HEIGHT)
    parts = chunk(b"IHDR", header) + chunk(b"PLTE", bytes([200, 0, 0, 0, 100, 0])) + chunk(b"IDAT", pixels)
    (folder / f"mav0/cam0/data/{EUROC_START_NS}.png").write_bytes(b"\x89PNG\r\n\x1a\n" + parts + chunk(b"IEND", b""))
    rgb = frames_of(folder)[0].rgb
    assert rgb is not None
    assert rgb[0, 0].tolist() == [200, 0, 0]
    assert rgb[0, 4].tolist() == [0, 100, 0]


TAILS = {"ff": b"\xff" * 4, "newline": b"\n", "zeros": b"\0" * 16, "long": b"x" * 9000}


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("tail", TAILS)
def test_bytes_after_the_end_are_harmless(tmp_path: Path, tail: str, suffix: str) -> None:
    folder = write_euroc(tmp_path / "clip")
    rewrite_images(folder, lambda image: image, suffix)
    edit(folder, CAM, lambda s: s.replace(".png", suffix))
    for path in (folder / "mav0/cam0/data").iterdir():
        path.write_bytes(path.read_bytes() + TAILS[tail])
    np.testing.assert_allclose(frames_of(folder)[3].gray.astype(int), grey_image(3).astype(int), atol=40)


def jpegs(folder: Path) -> list[Path]:
    rewrite_images(folder, lambda image: image, ".jpg")
    edit(folder, CAM, lambda s: s.replace(".png", ".jpg"))
    return sorted((folder / "mav0/cam0/data").iterdir())


def test_fill_bytes_and_thumbnails_in_a_jpeg_are_harmless(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    thumbnail = b"\xff\xe1" + (2 + 8).to_bytes(2, "big") + b"\xff\xd8..\xff\xd9.."
    for path in jpegs(folder):
        data = path.read_bytes()
        at = data.index(b"\xff\xdb")
        path.write_bytes(data[:2] + thumbnail + data[2:at] + b"\xff\xff\xff" + data[at:])
    assert len(frames_of(folder)) == 4


@pytest.mark.parametrize("keep", [0.98, 0.7, 0.4, 0.1])
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_truncated_image_is_refused_with_its_name(tmp_path: Path, suffix: str, keep: float) -> None:
    folder = write_euroc(tmp_path / "clip")
    images = jpegs(folder) if suffix == ".jpg" else sorted((folder / "mav0/cam0/data").iterdir())
    images[2].write_bytes(images[2].read_bytes()[: int(images[2].stat().st_size * keep)])
    assert f"{images[2].name}: the image is truncated" in refusal(folder)


@pytest.mark.parametrize(("suffix", "coded"), [(".PNG", ".png"), (".jpg", ".jpg"), (".JPG", ".jpg"), (".bmp", ".bmp")])
def test_an_image_of_another_extension_is_found_and_noted(tmp_path: Path, suffix: str, coded: str) -> None:
    folder = write_euroc(tmp_path / "clip")
    for path in list((folder / "mav0/cam0/data").iterdir()):
        data = cv2.imencode(coded, cv2.imread(str(path), cv2.IMREAD_UNCHANGED))[1].tobytes()
        path.unlink()
        path.with_suffix(suffix).write_bytes(data)
    assert len(frames_of(folder)) == 4
    (note,) = read(folder).notes
    assert f"{EUROC_START_NS}.png: is read from {EUROC_START_NS}{suffix}, 3 more likewise" in note


def test_other_formats_that_opencv_decodes_are_read(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    rewrite_images(folder, lambda image: image, ".pgm")
    edit(folder, CAM, lambda s: s.replace(".png", ".pgm"))
    np.testing.assert_array_equal(frames_of(folder)[1].gray, grey_image(1))


@pytest.mark.parametrize("what", ["folder", "empty", "text", "other size", "missing"])
def test_what_is_no_image_of_this_camera_is_refused(tmp_path: Path, what: str) -> None:
    folder = write_euroc(tmp_path / "clip")
    path = folder / f"mav0/cam0/data/{EUROC_START_NS}.png"
    path.unlink()
    if what == "folder":
        path.mkdir()
    elif what == "other size":
        cv2.imwrite(str(path), np.zeros((HEIGHT + 1, WIDTH), np.uint8))
    elif what != "missing":
        path.write_bytes(b"" if what == "empty" else b"no image " * 9)
    expected = {"folder": "is not a file", "empty": "is empty", "text": "is not an image", "missing": "is missing"}
    assert f"{path.name}: " in refusal(folder)
    assert expected.get(what, f"{WIDTH} x {HEIGHT + 1} px (allowed: {WIDTH} x {HEIGHT}") in refusal(folder)


def tum_vi(folder: Path) -> Path:
    """A folder in TUM-VI's layout: no sensor.yaml, the truth of a motion capture system."""
    write_euroc(folder)
    for name in (CAM_YAML, IMU_YAML):
        (folder / name).unlink()
    (folder / "mav0/state_groundtruth_estimate0").rename(folder / "mav0/mocap0")
    edit(folder, "mav0/mocap0/data.csv", rows(lambda c: c[:8]))
    return folder


CHAIN = CALIBRATION.split("imu0:")[0].replace("  depth_scale: 5000.0\n", "")
IMU_ALONE = CALIBRATION.split("imu0:\n")[1].replace("  ", "")


def test_a_tum_vi_folder_uses_the_settings_calibration(tmp_path: Path) -> None:
    folder = tum_vi(tmp_path / "clip")
    (tmp_path / "rig.yaml").write_text(CALIBRATION)
    recording = read(folder, calibration=tmp_path / "rig.yaml")
    assert recording.rig.imu0 is not None
    assert recording.rig.cam0.intrinsics[0] == 50.0
    assert [sample.T_WI[0, 3] for sample in recording.truth] == [0, 1, 2, 3]
    assert [note for note in recording.notes if "mocap0/data.csv: is the ground truth" in note]


def test_a_tum_vi_folder_has_its_calibration_beside_it(tmp_path: Path) -> None:
    folder = tum_vi(tmp_path / "clip")
    assert "cam0/sensor.yaml: the file is missing (allowed: --set replay.calibration=FILE" in refusal(folder)
    (folder / "dso").mkdir()
    (folder / "dso/camchain.yaml").write_text(CHAIN)
    assert "imu0/sensor.yaml: the file is missing" in refusal(folder)
    (folder / "dso/imu_config.yaml").write_text(IMU_ALONE)
    recording = read(folder)
    assert recording.rig.imu0 is not None
    assert recording.rig.imu0.update_rate == 200.0
    assert [note for note in recording.notes if "dso/camchain.yaml: is the calibration" in note]


@pytest.mark.parametrize("write", [write_euroc, write_tum])
def test_the_settings_calibration_is_used_or_refused(tmp_path: Path, write: Callable[[Path], Path]) -> None:
    folder = write(tmp_path / "clip")
    assert "rig.yaml: the file is missing" in refusal(folder, calibration=tmp_path / "rig.yaml")
    (tmp_path / "rig.yaml").write_text(CALIBRATION.replace("intrinsics: [50.0", "intrinsics: [51.0"))
    recording = read(folder, calibration=tmp_path / "rig.yaml")
    assert recording.rig.cam0.intrinsics[0] == 51.0
    assert [note for note in recording.notes if "replay.calibration is used instead of" in note]


def test_a_prism_has_positions_only(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    (folder / "mav0/state_groundtruth_estimate0").rename(folder / "mav0/leica0")
    edit(folder, "mav0/leica0/data.csv", rows(lambda c: c[:4]))
    recording = read(folder)
    assert [sample.orientation_known for sample in recording.truth] == [False] * 4
    assert [sample.T_WI[0, 3] for sample in recording.truth] == [0, 1, 2, 3]
    assert [note for note in recording.notes if "has positions only" in note]


def test_a_markers_pose_on_the_body_is_removed(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    (folder / "mav0/state_groundtruth_estimate0").rename(folder / "mav0/vicon0")
    edit(folder, "mav0/vicon0/data.csv", rows(lambda c: c[:8]))
    (folder / "mav0/vicon0/sensor.yaml").write_text("T_BS: {data: [1, 0, 0, .5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}\n")
    assert [sample.T_WI[0, 3] for sample in read(folder).truth] == [-0.5, 0.5, 1.5, 2.5]


@pytest.mark.parametrize(
    ("name", "known"), [("fr3_cam", True), ("TUM-fr3", True), ("myfr3cam", False), ("fr3cam", False)]
)
def test_a_benchmarks_camera_is_a_word_of_the_name(tmp_path: Path, name: str, known: bool) -> None:
    said = refusal(write_tum(tmp_path / name, calibrated=False))
    assert ("640 x 480" in said) == known
    assert ("calibration.yaml: the file is missing" in said) != known


def test_the_truths_kind_survives_the_backend(tmp_path: Path) -> None:
    backend = ReplayBackend(write_euroc(tmp_path / "clip"), ReplaySettings())
    truth: list[GroundTruth] = []
    count = 0
    while (packets := backend.step(None)) is not None:
        truth += backend.read_ground_truth()
        count += sum(isinstance(packet, ImuSample) for packet in packets)
    assert count == 31
    assert all(sample.orientation_known for sample in truth)


def test_latin_1_in_a_title_is_harmless(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    (folder / IMU).write_bytes((folder / IMU).read_bytes().replace(b"wx", b"w [\xb0/s]", 1))
    assert len(packets_of(folder)) == 35


def test_depth_settings_for_a_folder_without_depth_are_noted(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    (tmp_path / "rig.yaml").write_text(CALIBRATION)
    recording = read(folder, calibration=tmp_path / "rig.yaml", association_ms=30)
    assert next(recording.packets(EUROC_START_NS)).t_ns == EUROC_START_NS
    assert recording.read_frame(0).depth_m is None
    said = [note.split(":")[0] for note in recording.notes if "an EuRoC folder has no depth images" in note]
    assert said == ["replay.association_ms", "cam0.depth_scale"]


@pytest.mark.parametrize("shift_s", ["1e12", "-1e300", "nan"])
def test_a_time_shift_beyond_reason_is_refused(tmp_path: Path, shift_s: str) -> None:
    folder = write_euroc(tmp_path / "clip")
    edit(folder, CAM_YAML, lambda s: s + f"timeshift_cam_imu: {shift_s}\n")
    assert "sensor.yaml: timeshift_cam_imu: Input should be" in refusal(folder)


def test_a_name_that_no_file_can_have_is_refused(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    edit(folder, CAM, lambda s: s.replace(f",{EUROC_START_NS}", "," + "x" * 400, 1))
    assert "cam0/data.csv: line 2: 'xxx" in refusal(folder)
