"""The command line: exit codes, one line for a user's mistake, the last line of --json, the run directory."""

import itertools
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from snakeslam.cli import main
from snakeslam.recording.trajectory import read_trajectory
from tests.small_recordings import write_euroc, write_tum

Cli = Callable[..., tuple[int, str, str]]
ARTIFACTS = ["estimate.tum", "ground_truth.tum", "map.ply", "run.json"]


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cli:
    """Run the command line in an empty folder; return exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> tuple[int, str, str]:
        code = main([str(argument) for argument in arguments])
        said = capsys.readouterr()
        return code, said.out, said.err

    return call


def files(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def assert_one_line(code: int, out: str, err: str, *expected: str) -> None:
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("snakeslam: ")
    for text in expected:
        assert text in err


def test_help_names_every_command(cli: Cli) -> None:
    for arguments in ([], ["--help"]):
        code, out, _ = cli(*arguments)
        assert code == 0
        for command in ("serve", "run", "replay", "export", "study", "report", "hw", "node", "eq"):
            assert f"\n  {command} " in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["node", "robot"], "needs one endpoint"),
        (["node", "slam", "--connect", "tcp/host:7447"], "would be open to all"),
        (["node", "slam", "--connect", "elsewhere"], "is not an endpoint"),
        (["node", "slam", "--connect", "tls/robot.local:7447"], "needs certificates"),
        (["node", "robot", "--listen", "tls/h:1", "--ca", "a", "--cert", "b", "--key", "c"], "no such file"),
        (["serve", "--connect", "tcp/host:7447"], "would be open to all"),
    ],
)
def test_a_bus_that_cannot_be_is_refused(cli: Cli, arguments: list[str], words: str) -> None:
    assert_one_line(*cli(*arguments), words)


def test_version(cli: Cli) -> None:
    code, out, _ = cli("--version")
    assert (code, out.split()[0]) == (0, "snakeslam")


@pytest.mark.parametrize(
    "arguments",
    [
        ["export", "x", "--format", "tum", "--out", "y"],
        ["report"],
        ["hw", "scan"],
    ],
    ids=lambda arguments: arguments[0],
)
def test_commands_of_later_versions_say_so(cli: Cli, arguments: list[str]) -> None:
    assert_one_line(*cli(*arguments), f"{arguments[0]!r} is not built yet")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["bogus"], "No such command 'bogus'"),
        (["run"], "Missing argument"),
        (["run", "--bogus"], "No such option"),
        (["run", "{configs}/sim.yaml", "--seed", "x"], "--seed"),
        (["run", "{configs}/sim.yaml", "--seed", "-1"], "--seed: -1 is not possible (allowed: >= 0)"),
        (["run", "{configs}/sim.yaml", "--duration", "-3"], "--duration: -3.0 is not possible (allowed: > 0)"),
        (["run", "{configs}/sim.yaml", "--duration", "nan"], "--duration: nan is not possible"),
        (["run", "{configs}/sim.yaml", "--set", "gait.period_s=-4"], "--set gait.period_s: -4 is not possible"),
        (["run", "{configs}/sim.yaml", "--set", "gait.perod_s=4"], "did you mean gait.period_s?"),
        (["run", "{configs}/sim.yaml", "--set", "gait.name=moonwalk"], "--set gait.name: 'moonwalk' is not possible"),
        (["run", "{configs}/sim.yaml", "--set", "gait.period_s=0.5"], "gait.period_s"),
        (["run", "{configs}/sim.yaml", "--set", "head.neck_joints=1"], "--set head.neck_joints: 1 is not possible"),
        (
            ["run", "{configs}/sim.yaml", "--set", "head.controller=position", "--set", "head.neck_joints=2"],
            "head.neck_joints: 2 yaw joints would bend",
        ),
        (["run", "{configs}/sim.yaml", "--set", "sim.world=moon"], "sim.world: 'moon' is not possible"),
        (["run", "none.yaml"], "none.yaml: no such configuration file"),
        (["replay", "nothing"], "nothing: no such recording"),
        (["replay", "{configs}"], "is not a recording"),
        (["eq", "99"], "eq: 99 (allowed: 1 to 41)"),
        (["eq", "one"], "Invalid value"),
        (["serve", "none.yaml"], "none.yaml: no such configuration file"),
        (["serve", "--port", "70000"], "--port: 70000 (allowed: 0 to 65535)"),
        (["serve", "--recordings", "nowhere"], "--recordings nowhere: no such folder"),
    ],
    ids=lambda value: " ".join(value).replace("{configs}/", "") if isinstance(value, list) else None,
)
def test_a_mistake_is_one_line_and_nothing_is_written(
    cli: Cli, tmp_path: Path, checkout: Path, arguments: list[str], expected: str
) -> None:
    filled = [argument.replace("{configs}", str(checkout / "configs")) for argument in arguments]
    assert_one_line(*cli(*filled), expected)
    assert files(tmp_path) == []


def test_eq_prints_formula_home_and_test(cli: Cli) -> None:
    code, out, _ = cli("eq", 1)
    assert code == 0
    for text in ("alpha(n, t) = beta_o", "home: snakeslam.gaits.parametric", "test: tests/gaits/"):
        assert text in out


def test_replay_of_a_recording_that_has_a_mistake_writes_nothing(cli: Cli, tmp_path: Path) -> None:
    clip = write_euroc(tmp_path / "data" / "clip")
    image = sorted(clip.glob("mav0/cam0/data/*.png"))[1]
    image.write_bytes(image.read_bytes()[:-30])
    assert_one_line(*cli("replay", clip, "--json", "--out", "out"), f"{image.name}: the image is truncated")
    imu = clip / "mav0/imu0/data.csv"
    imu.write_text(imu.read_text().replace("0.02", "nan", 1))
    assert_one_line(*cli("replay", clip, "--json"), "imu0/data.csv: line 2: column 3: 'nan' is not a finite number")
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_damage_found_halfway_leaves_nothing(cli: Cli, tmp_path: Path) -> None:
    clip = write_tum(tmp_path / "data" / "clip")
    image = sorted(clip.glob("depth/*.png"))[2]
    data = bytearray(image.read_bytes())
    data[len(data) // 2] ^= 0xFF
    image.write_bytes(bytes(data))
    code, out, err = cli("replay", clip, "--set", "estimator.mode=visual", "--out", "o/p")
    running, error = err.splitlines(keepends=True)
    assert running.startswith("running: ")
    assert_one_line(code, out, error, "the image is damaged")
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_an_output_folder_in_use_is_kept(cli: Cli, tmp_path: Path) -> None:
    clip = write_euroc(tmp_path / "data" / "clip")
    assert_one_line(*cli("replay", clip, "--out", tmp_path / "data"), "data: exists already")
    (tmp_path / "note").touch()
    assert_one_line(*cli("replay", clip, "--out", "note/run"), "the output folder cannot be made")


def test_vio_needs_an_imu(cli: Cli, tmp_path: Path) -> None:
    assert_one_line(*cli("replay", write_tum(tmp_path / "clip"), "--set", "estimator.mode=vio"), "IMU")


@pytest.mark.parametrize("kind", ["euroc", "tum"])
def test_replay_writes_a_run_directory_and_prints_the_metrics_last(cli: Cli, tmp_path: Path, kind: str) -> None:
    clip = write_euroc(tmp_path / "clip") if kind == "euroc" else write_tum(tmp_path / "clip")
    mode = "vio" if kind == "euroc" else "visual"
    code, out, err = cli("replay", clip, "--set", f"estimator.mode={mode}", "--json", "--out", "run", "--progress-json")
    assert code == 0, err
    metrics = json.loads(out.splitlines()[-1])
    assert metrics["frames"] == 4
    assert metrics["duration_s"] == pytest.approx(0.15)
    assert set(metrics["head"].values()) == {None}
    assert files(tmp_path / "run") == ARTIFACTS
    facts = json.loads((tmp_path / "run/run.json").read_text())
    assert facts["metrics"] == metrics
    assert facts["config"]["estimator"]["mode"] == mode
    assert facts["versions"]["numpy"]
    t_ns, Ts = read_trajectory(tmp_path / "run/ground_truth.tum")
    assert len(t_ns) == 4
    assert Ts[3, 0, 3] == 3.0
    lines = [json.loads(line) for line in err.splitlines() if line.startswith("{")]
    shares = [line["progress"] for line in lines]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert "written: run" in err


def test_without_out_the_run_is_written_below_runs(cli: Cli, tmp_path: Path) -> None:
    clip = write_euroc(tmp_path / "clip")
    (clip / "mav0/state_groundtruth_estimate0/data.csv").unlink()
    code, out, err = cli("replay", clip, "--duration", "0.08")
    assert code == 0, err
    (folder,) = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("-clip")
    assert str(folder.name) in err
    assert files(folder) == [name for name in ARTIFACTS if name != "ground_truth.tum"]
    assert "tracked_fraction" in out
    assert "ate_m             posyaw -, se3 -" in out
    assert json.loads((folder / "run.json").read_text())["metrics"]["frames"] == 2


def test_the_same_seed_gives_the_same_bytes(cli: Cli, tmp_path: Path, checkout: Path) -> None:
    """Another seed does not: the comparison can fail."""
    config = checkout / "configs" / "sim.yaml"
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        options = ("--set", "sim.camera.rate_hz=10", "--duration", 1.2, "--json")
        code, out, err = cli("run", config, "--seed", seed, "--out", name, *options)
        assert code == 0, err
        metrics = json.loads(out.splitlines()[-1])
        assert metrics["duration_s"] == pytest.approx(1.2, abs=0.02)
        assert metrics["ms_per_frame"]["mean"] > 0.0
        assert files(tmp_path / name) == sorted([*ARTIFACTS, "joints.csv"])
    for artifact in ("estimate.tum", "ground_truth.tum", "map.ply", "joints.csv"):
        assert (tmp_path / "a" / artifact).read_bytes() == (tmp_path / "b" / artifact).read_bytes(), artifact
    assert (tmp_path / "a/estimate.tum").read_bytes() != (tmp_path / "c/estimate.tum").read_bytes()
    assert len((tmp_path / "a/estimate.tum").read_text().splitlines()) > 4


def test_a_cancelled_run_leaves_nothing(tmp_path: Path, checkout: Path) -> None:
    command = [sys.executable, "-m", "snakeslam", "run", str(checkout / "configs/sim.yaml"), "--duration", "600"]
    with subprocess.Popen(
        [*command, "--out", "deep/run", "--progress-json"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(checkout)},
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stderr is not None
            # PyBullet greets on stderr before the first step.
            said = list(itertools.takewhile(lambda line: not line.startswith("{"), process.stderr))
            assert process.poll() is None, "".join(said)
            assert (tmp_path / "deep").exists()
            process.send_signal(signal.SIGTERM)
            out, err = process.communicate(timeout=120)
        finally:
            process.kill()
    assert process.returncode == 143, err
    assert out == ""
    assert files(tmp_path) == []


BOMB = "a0: &a0 [x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 8)}]\n" for k in range(1, 12)
)


@pytest.mark.parametrize("data", [BOMB.encode(), b"[" * 100_000, b"a: " * 1000, b"\x00", b"\xff\xfe", b"a: !!x 1"])
@pytest.mark.parametrize("command", ["run", "study", "serve"])
def test_whatever_a_file_holds_is_one_line(cli: Cli, tmp_path: Path, command: str, data: bytes) -> None:
    (tmp_path / "odd.yaml").write_bytes(data)
    assert_one_line(*cli(command, "odd.yaml"), "odd.yaml: ")


def test_names_of_any_bytes_are_one_line(tmp_path: Path) -> None:
    """In a process of its own: its arguments are bytes."""
    for arguments in (
        [b"run", b"\xff.yaml"],
        [b"study", b"\xff.yaml"],
        [b"replay", b"\xff"],
        [b"run", b"sim.yaml", b"--set", b"\xff=1"],
        [b"run", b"sim.yaml", b"--set", b"sim.world=\xff"],
        [b"serve", b"--recordings", b"\xff"],
        [b"\xff"],
    ):
        (tmp_path / "sim.yaml").write_text("")
        command = [sys.executable, "-m", "snakeslam", *arguments]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, check=False)
        assert done.returncode == 2, done.stderr
        assert done.stderr.count(b"\n") == 1
        assert done.stderr.startswith(b"snakeslam: ")
