"""A session's sensors written as a TUM RGB-D folder: what is read back is what went in."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import yaml
from evo.tools import file_interface

from snakeslam.backends.replay.backend import ReplayBackend
from snakeslam.calibration import CameraCalibration, ImuCalibration, SensorRig
from snakeslam.cli import main
from snakeslam.config import load_config
from snakeslam.errors import InputError
from snakeslam.estimation.settings import Mode
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame, GroundTruth, ImuSample, JointState, Packet
from snakeslam.recording.datasets import find_recordings
from snakeslam.recording.settings import ReplaySettings
from snakeslam.recording.trajectory import read_trajectory
from snakeslam.recording.tum_writer import TumWriter, depth_units
from snakeslam.robot.model import PRESETS
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.commands import Start
from snakeslam.runtime.bus.topics import Ended, Report, Started, Tick
from snakeslam.runtime.session.recording import Session
from tests.small_recordings import write_tum

MODEL = PRESETS["orthogonal24"]
T_CI = se3.inv(se3.from_rt(so3.exp(np.array([0.3, -1.2, 0.7])), np.array([0.1, 0.2, -0.3])))
RIG = SensorRig(
    cam0=CameraCalibration(
        T_cam_imu=tuple(tuple(row) for row in T_CI.tolist()),
        intrinsics=(51.3, 52.7, 31.5, 23.5),
        resolution=(64, 48),
    ),
    imu0=ImuCalibration(
        gyroscope_noise_density=1.7e-4,
        gyroscope_random_walk=1e-5,
        accelerometer_noise_density=2e-3,
        accelerometer_random_walk=3e-4,
        update_rate=200.0,
        sample_kind="mean",
    ),
)
START_NS = 1_305_031_229_000_000_007


def packets(frames: int = 3, colour: bool = True) -> list[Packet]:
    """Odd nanoseconds; at the frames' stamps there are an IMU sample and a joint state too."""
    rng = np.random.default_rng(3)
    found: list[Packet] = []
    for k in range(10 * frames - 9):
        t_ns = START_NS + 5_000_001 * k
        found.append(ImuSample(t_ns, rng.normal(size=3), rng.normal(size=3) * 1e-7))
        if k % 2 == 0:
            q, dq = rng.normal(size=(2, MODEL.joint_count))
            found.append(JointState(t_ns, q, dq, np.zeros_like(q), np.zeros_like(q)))
        if k % 10 == 0:
            rgb = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
            gray = (rgb @ [0.299, 0.587, 0.114]).round().astype(np.uint8)
            depth_m = (rng.integers(0, 65536, (48, 64)) * np.float32(1.0 / 5000.0)).astype(np.float32)
            found.append(CameraFrame(t_ns, k // 10, gray, rgb if colour else None, depth_m, 8_000_000 + k))
    return found


def pose(k: int) -> np.ndarray:
    return se3.exp(np.array([0.1 * k, -0.2, 0.3, 0.5 * k, 0.1, -0.7]))


def write(folder: Path, sent: list[Packet], truth: int = 3) -> Path:
    writer = TumWriter(folder, RIG, MODEL, seed=11)
    for packet in sent:
        writer.add(packet)
    writer.finish([GroundTruth(START_NS + 50_000_010 * k, pose(k)) for k in range(truth)])
    return folder


def play(folder: Path) -> tuple[list[Packet], ReplayBackend]:
    backend = ReplayBackend(folder, ReplaySettings())
    got: list[Packet] = []
    while (step := backend.step(None)) is not None:
        got += step
    return got, backend


def same(sent: Packet, got: Packet) -> bool:
    if isinstance(sent, CameraFrame) and isinstance(got, CameraFrame):
        return (
            (sent.t_ns, sent.seq, sent.exposure_ns) == (got.t_ns, got.seq, got.exposure_ns)
            and sent.depth_m is not None
            and got.depth_m is not None
            and np.array_equal(sent.depth_m, got.depth_m)
            and (sent.rgb is None) == (got.rgb is None)
            and (np.array_equal(sent.gray, got.gray) if sent.rgb is None else np.array_equal(sent.rgb, got.rgb))
        )
    if isinstance(sent, ImuSample) and isinstance(got, ImuSample):
        return sent.t_ns == got.t_ns and bool(np.all(sent.gyro_I == got.gyro_I) and np.all(sent.accel_I == got.accel_I))
    if isinstance(sent, JointState) and isinstance(got, JointState):
        equal = bool(np.all(sent.q_rad == got.q_rad) and np.all(sent.dq_rad_s == got.dq_rad_s))
        return sent.t_ns == got.t_ns and equal and bool(np.all(np.isnan(got.current_a)))
    return False


@pytest.mark.parametrize("colour", [True, False])
def test_every_packet_comes_back_to_the_bit_and_in_order(tmp_path: Path, colour: bool) -> None:
    sent = packets(colour=colour)
    got, backend = play(write(tmp_path / "sensors", sent))
    assert len(got) == len(sent)
    assert all(same(a, b) for a, b in zip(sent, got, strict=True))
    assert backend.model == MODEL
    assert backend.recording.seed == 11
    assert backend.rig.imu0 == RIG.imu0
    assert backend.rig.cam0 == RIG.cam0.model_copy(update={"depth_scale": 5000.0})


def test_the_truth_is_written_for_the_camera_and_read_for_the_imu(tmp_path: Path) -> None:
    folder = write(tmp_path / "sensors", packets())
    t_ns, Ts_WC = read_trajectory(folder / "groundtruth.txt")
    assert t_ns[1] == START_NS + 50_000_010
    np.testing.assert_allclose(Ts_WC[1], pose(1) @ RIG.cam0.T_IC, atol=1e-8)
    truth = ReplayBackend(folder, ReplaySettings()).recording.truth
    np.testing.assert_allclose(truth[2].T_WI, pose(2), atol=1e-8)


def test_a_runs_sensors_are_listed_by_the_runs_name(tmp_path: Path) -> None:
    write(tmp_path / "runs" / "first" / "sensors", packets())
    write(tmp_path / "runs" / "second", packets())
    assert [(one.name, one.frames) for one in find_recordings(tmp_path / "runs")] == [("first", 3), ("second", 3)]


def test_the_live_view_plays_it_with_its_robot_which_nothing_moves(tmp_path: Path) -> None:
    reports: list[Report] = []
    folder = write(tmp_path / "sensors", packets())
    session = Session(SessionSpec(load_config(), recording=folder, autostart=True), reports.append)
    started = reports[0]
    assert isinstance(started, Started)
    assert started.robot is not None
    assert (started.robot.model, started.gait, started.estimator_mode) == ("orthogonal24", None, "fused")
    session.on_command(Start())
    while not any(isinstance(report, Ended) for report in reports):
        session.step()
    tick = next(report for report in reversed(reports) if isinstance(report, Tick))
    assert not tick.moving
    assert tick.q_target_rad is None
    assert tick.q_measured_rad is not None


@pytest.mark.parametrize("mode", get_args(Mode))
def test_the_live_view_accepts_every_mode_where_its_sensors_are(tmp_path: Path, mode: Mode) -> None:
    """A robot's own recording bears them all; a camera alone only one, and says what else is missing."""
    reports: list[Report] = []
    folder = write(tmp_path / "sensors", packets())
    session = Session(SessionSpec(load_config(), recording=folder, estimator_mode=mode), reports.append)
    assert isinstance(reports[0], Started)
    assert reports[0].estimator_mode == mode
    while not any(isinstance(report, Ended) for report in reports):
        session.step()
    spec = SessionSpec(load_config(), recording=write_tum(tmp_path / "camera"), estimator_mode=mode)
    if mode == "visual":
        Session(spec, reports.append)
        return
    missing = "a robot's joints" if mode in ("gait", "fused") else "an IMU"
    with pytest.raises(InputError, match=rf"^estimator\.mode: '{mode}' needs {missing}, .* \(allowed: visual"):
        Session(spec, reports.append)


def test_other_tools_find_the_benchmarks_form(tmp_path: Path) -> None:
    """Two columns of seconds and file, eight of the truth, 16-bit depth, 5000 a metre: read without our code."""
    folder = write(tmp_path / "sensors", packets())
    for name, columns in (("rgb.txt", 2), ("depth.txt", 2), ("groundtruth.txt", 8)):
        rows = [line.split() for line in (folder / name).read_text().splitlines() if not line.startswith("#")]
        assert len(rows) == 3, name
        assert {len(row) for row in rows} == {columns}, name
        assert float(rows[0][0]) == pytest.approx(START_NS / 1e9, abs=1e-6)
        if columns == 2:
            assert (folder / rows[0][1]).is_file()
    assert file_interface.read_tum_trajectory_file(folder / "groundtruth.txt").num_poses == 3
    with (folder / "imu.csv").open(newline="") as file:
        titles, first, *_ = csv.reader(file)
    assert (titles[0], len(titles), len(first)) == ("t_ns", 7, 7)
    calibration = yaml.safe_load((folder / "calibration.yaml").read_text())
    assert calibration["cam0"]["depth_scale"] == 5000.0
    assert calibration["imu0"]["update_rate"] == 200.0


def test_depth_beyond_16_bits_is_unknown() -> None:
    depth_m = np.array([[0.0, 0.00009, 0.0002, 1.0, 13.107, 13.2, 500.0]], np.float32)
    assert depth_units(depth_m, 5000.0).tolist() == [[0, 0, 1, 5000, 65535, 0, 0]]


def test_a_camera_without_depth_is_refused(tmp_path: Path) -> None:
    frame = CameraFrame(0, 0, np.zeros((48, 64), np.uint8))
    with pytest.raises(InputError, match=r"recording\.enabled: the camera has no depth"):
        TumWriter(tmp_path / "sensors", RIG, None, 1).add(frame)


def edit(name: str, change: Callable[[list[str]], list[str]]) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        (folder / name).write_text("\n".join(change((folder / name).read_text().splitlines())) + "\n")

    return apply


def text(name: str, content: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(content)


def cells(row: str, change: Callable[[list[str]], list[str]]) -> str:
    return ",".join(change(row.split(",")))


MISTAKES: dict[str, tuple[Callable[[Path], object], str]] = {
    "imu nan row": (
        edit("imu.csv", lambda s: [*s[:3], cells(s[3], lambda c: [c[0], *["nan"] * 6]), *s[4:]]),
        r"imu\.csv: line 4: column 2: 'nan' is not a finite number",
    ),
    "imu back in time": (
        edit("imu.csv", lambda s: [*s[:3], s[4], s[3], *s[5:]]),
        r"imu\.csv: line 5: the timestamp \d+ goes back",
    ),
    "imu repeats": (edit("imu.csv", lambda s: [*s[:3], s[2], *s[3:]]), r"imu\.csv: line 4: the timestamp \d+ repeats"),
    "imu without accelerometer": (
        edit("imu.csv", lambda s: [cells(row, lambda c: c[:4]) for row in s]),
        r"imu\.csv: line 2: 4 columns \(allowed: 7 or more\)",
    ),
    "imu one cell short": (
        edit("imu.csv", lambda s: [*s[:5], cells(s[5], lambda c: c[:-1]), *s[6:]]),
        r"imu\.csv: line 6: 6 columns \(allowed: 7 or more\)",
    ),
    "imu in seconds": (
        edit("imu.csv", lambda s: [s[0], *(cells(row, lambda c: [f"{int(c[0]) / 1e9:.9f}", *c[1:]]) for row in s[1:])]),
        r"imu\.csv: line \d: the timestamp .* is not a whole number of nanoseconds; are these seconds\?",
    ),
    "imu empty": (text("imu.csv", ""), r"imu\.csv: has no rows"),
    "imu titles only": (edit("imu.csv", lambda s: s[:1]), r"imu\.csv: has no rows"),
    "imu of another time": (
        edit("imu.csv", lambda s: [s[0], *(cells(r, lambda c: [str(int(c[0]) + 10**12), *c[1:]]) for r in s[1:])]),
        r"imu\.csv: no sample lies within the frames' time",
    ),
    "joint nan": (
        edit("joints.csv", lambda s: [*s[:2], cells(s[2], lambda c: [*c[:5], "nan", *c[6:]]), *s[3:]]),
        r"joints\.csv: line 3: column 6: 'nan'",
    ),
    "too few joints": (
        edit("joints.csv", lambda s: [cells(row, lambda c: c[:24]) for row in s]),
        r"joints\.csv: line 2: 24 columns \(allowed: 25, 49 or more\)",
    ),
    "some rates": (
        edit("joints.csv", lambda s: [*s[:3], cells(s[3], lambda c: c[:25]), *s[4:]]),
        r"joints\.csv: some rows have rates",
    ),
    "no robot": (text("session.yaml", "run: {seed: 1}\n"), r"joints\.csv: session\.yaml does not say of which robot"),
    "other robot": (text("session.yaml", "robot: {model: cobra}\n"), r"session\.yaml: robot\.model"),
    "broken session": (text("session.yaml", "robot: [\n"), r"session\.yaml: line 2: expected"),
    "exposure": (text("exposure.csv", "t_ns,exposure_ns\n1,fast\n"), r"exposure\.csv: line 2: column 2: 'fast'"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_clear_line(tmp_path: Path, mistake: str) -> None:
    break_it, expected = MISTAKES[mistake]
    folder = write(tmp_path / "sensors", packets())
    break_it(folder)
    with pytest.raises(InputError, match=expected) as caught:
        ReplayBackend(folder, ReplaySettings())
    assert "\n" not in str(caught.value)


def test_joints_without_rates_get_them_from_their_differences(tmp_path: Path) -> None:
    folder = write(tmp_path / "sensors", packets())
    edit("joints.csv", lambda s: [cells(row, lambda c: c[:25]) for row in s])(folder)
    states = [packet for packet in play(folder)[0] if isinstance(packet, JointState)]
    assert not states[0].dq_rad_s.any()
    step_s = (states[3].t_ns - states[2].t_ns) / 1e9
    np.testing.assert_allclose(states[3].dq_rad_s, (states[3].q_rad - states[2].q_rad) / step_s)


def test_a_replay_of_a_runs_own_sensors_gives_the_same_bytes(
    tmp_path: Path, checkout: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mode and seed come from the recording; one IMU sample changed by 1 mm/s^2 shows that the comparison can fail."""
    monkeypatch.chdir(tmp_path)
    settings = ["--set", "recording.enabled=true", "--set", "run.rest_s=0.1", "--set", "gait.name=sidewinding"]
    run = ["run", str(checkout / "configs/sim.yaml"), "--seed", "5", "--duration", "1.5", *settings, "--out", "run"]
    assert main(run) == 0
    assert main(["replay", "run/sensors", "--out", "again"]) == 0
    edit("imu.csv", lambda s: [*s[:99], cells(s[99], lambda c: [*c[:-1], str(float(c[-1]) + 1e-3)]), *s[100:]])(
        Path("run/sensors")
    )
    assert main(["replay", "run/sensors", "--out", "other"]) == 0
    for name in ("estimate.tum", "map.ply"):
        assert Path("run", name).read_bytes() == Path("again", name).read_bytes(), name
    assert Path("run/estimate.tum").read_bytes() != Path("other/estimate.tum").read_bytes()
    facts = json.loads(Path("again/run.json").read_text())
    assert (facts["seed"], facts["config"]["estimator"]["mode"]) == (5, "fused")
    assert facts["metrics"]["frames"] == 30
    assert facts["metrics"]["head"]["sway_pp_m"] is None, "what the head should do is not known of a recording"


@pytest.mark.parametrize(("imu", "mode"), [(True, "vio"), (False, "visual")])
def test_the_mode_is_what_the_sensors_allow_unless_it_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, imu: bool, mode: str
) -> None:
    monkeypatch.chdir(tmp_path)
    clip = str(write_tum(tmp_path / "clip", imu=imu))
    assert main(["replay", clip, "--out", "left"]) == 0
    assert main(["replay", clip, "--set", "estimator.mode=visual", "--seed", "4", "--out", "given"]) == 0
    facts = [json.loads(Path(name, "run.json").read_text()) for name in ("left", "given")]
    assert [one["config"]["estimator"]["mode"] for one in facts] == [mode, "visual"]
    assert [one["seed"] for one in facts] == [1, 4]


def test_a_replay_is_not_recorded_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "sensors", packets())
    assert main(["replay", "sensors", "--set", "recording.enabled=true", "--out", "x"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["sensors"]


def test_joints_of_another_clock_are_refused(tmp_path: Path) -> None:
    folder = write(tmp_path / "sensors", packets())
    edit("joints.csv", lambda s: [s[0], *(cells(r, lambda c: [str(int(c[0]) + 10**12), *c[1:]]) for r in s[1:])])(
        folder
    )
    with pytest.raises(InputError, match=r"joints\.csv: no sample lies within the frames' time"):
        ReplayBackend(folder, ReplaySettings())
