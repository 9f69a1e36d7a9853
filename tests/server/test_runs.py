"""Scripted runs over the API: queue, progress, result, cancel."""

import asyncio
import os
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from server import runs as runs_module
from server.runs import Run, RunRequest, Runs, checked_overrides, config_path
from snakeslam.config import load_config
from snakeslam.errors import InputError
from tests.server.running import Running, children, wait_for

FAKE = """
import json, os, sys, time
out = next(a for a in sys.argv if a.startswith("--out="))[6:]
seed = int(next(a for a in sys.argv if a.startswith("--seed="))[7:])
for k in range(1, 11):
    print(json.dumps({"progress": k / 10}), file=sys.stderr, flush=True)
    time.sleep(0.02 if seed < 100 else 1.0)
if seed == 13:
    sys.exit("snakeslam: the seed is unlucky")
os.makedirs(out)
open(os.path.join(out, "estimate.tum"), "w").write(str(seed))
print(json.dumps({"frames": seed}))
"""


class ShortRuns(Runs):
    """The real queue around a command that only pretends."""

    def _command(self, run: Run) -> tuple[str, ...]:
        return sys.executable, "-c", FAKE, *run.arguments()


@pytest.fixture
def queue(tmp_path: Path) -> Runs:
    return ShortRuns(tmp_path / "runs")


async def until_over(run: Run) -> None:
    async with asyncio.timeout(20):
        while run.state in ("queued", "running"):
            await asyncio.sleep(0.01)


def test_runs_go_one_at_a_time_in_order(queue: Runs) -> None:
    async def go() -> list[Run]:
        made = [queue.submit(RunRequest(seed=seed)) for seed in (1, 2, 3)]
        assert [run.state for run in made] == ["queued"] * 3
        seen = set()
        while made[-1].state in ("queued", "running"):
            assert sum(run.state == "running" for run in made) <= 1
            seen.add(round(made[0].progress, 1))
            await asyncio.sleep(0.01)
        assert len(seen) > 3
        await queue.close()
        return made

    for run, seed in zip(asyncio.run(go()), (1, 2, 3), strict=True):
        assert (run.state, run.progress, run.metrics) == ("done", 1.0, {"frames": seed})
        assert run.answer().artifacts == ["estimate.tum"]
        assert run.artifacts()["estimate.tum"].read_text() == str(seed)


def test_a_failed_run_says_why_and_the_next_one_runs(queue: Runs) -> None:
    async def go() -> list[Run]:
        made = [queue.submit(RunRequest(seed=13)), queue.submit(RunRequest(seed=1))]
        for run in made:
            await until_over(run)
        await queue.close()
        return made

    bad, good = asyncio.run(go())
    assert (bad.state, bad.error, bad.metrics) == ("failed", "the seed is unlucky", None)
    assert good.state == "done"


def test_cancelling_ends_a_running_run_and_forgets_a_queued_one(queue: Runs) -> None:
    async def go() -> tuple[Run, Run, Run]:
        long, waiting, last = (queue.submit(RunRequest(seed=seed)) for seed in (100, 2, 3))
        while long.progress == 0.0:
            await asyncio.sleep(0.01)
        await queue.cancel(waiting)
        await queue.cancel(long)
        await until_over(last)
        await queue.cancel(last)
        await queue.close()
        return long, waiting, last

    long, waiting, last = asyncio.run(go())
    assert [run.state for run in (long, waiting, last)] == ["cancelled", "cancelled", "done"]
    assert long.process is not None
    assert long.process.returncode is not None
    assert waiting.process is None
    assert not waiting.artifacts()


def test_a_run_that_ignores_sigterm_is_killed(queue: Runs, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs_module, "TERMINATE_S", 0.3)
    deaf = "import signal,sys,time; signal.signal(15, signal.SIG_IGN); sys.stderr.write('{\"progress\": 0.5}\\n');"
    deaf += "sys.stderr.flush(); time.sleep(60)"
    monkeypatch.setattr(ShortRuns, "_command", lambda *_: (sys.executable, "-c", deaf))

    async def go() -> Run:
        run = queue.submit(RunRequest())
        while run.progress == 0.0:
            await asyncio.sleep(0.01)
        await queue.cancel(run)
        await queue.close()
        return run

    run = asyncio.run(go())
    assert run.process is not None
    assert run.process.returncode == -9


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        (RunRequest(config="nothing"), "config: 'nothing' is unknown"),
        (RunRequest(config="../../etc/passwd"), "is unknown"),
        (RunRequest(overrides={"gait.period_s": -1}), "overrides.gait.period_s: -1"),
        (RunRequest(overrides={"gait.perod_s": 1}), "did you mean gait.period_s"),
        (RunRequest(overrides={"replay.calibration": "x"}), "names a file"),
        (RunRequest(overrides={"--out": "x"}), "is no key"),
    ],
)
def test_a_wrong_request_is_refused_before_anything_is_written(
    queue: Runs, tmp_path: Path, request_: RunRequest, words: str
) -> None:
    with pytest.raises(InputError) as refused:
        queue.submit(request_)
    assert words in str(refused.value)
    assert not list(tmp_path.iterdir())


def test_every_setting_that_names_a_file_is_closed_to_clients() -> None:
    """Each setting of the tree that holds a path must be refused, those of later rooms too."""
    for key in path_keys():
        with pytest.raises(InputError, match="names a file"):
            checked_overrides({key: "x"})


def path_keys() -> list[str]:
    from snakeslam.config import Config

    def walk(model: type, prefix: str) -> list[str]:
        found: list[str] = []
        for name, info in model.model_fields.items():
            if hasattr(info.annotation, "model_fields"):
                found += walk(info.annotation, f"{prefix}{name}.")
            elif "Path" in str(info.annotation):
                found.append(prefix + name)
        return found

    return walk(Config, "")


def test_over_http_a_wrong_run_is_one_line(client: httpx.Client) -> None:
    for body, words in (
        ({"config": "sim", "duration_s": -1}, "duration_s"),
        ({"config": "sim", "seed": -1}, "seed"),
        ({"config": "sim", "overrides": {"gait.period_s": {"a": 1}}}, "overrides"),
        ({"config": "nothing"}, "config"),
    ):
        answer = client.post("/api/v1/runs", json=body)
        assert answer.status_code == 422
        assert words in answer.json()["detail"]
        assert "\n" not in answer.json()["detail"]
    assert client.get("/api/v1/runs").json() == []


def test_a_whole_number_may_be_written_with_a_fraction() -> None:
    """In JSON 3.0 and 3 are the same number, and the schema says integer."""
    request = RunRequest.model_validate({"seed": 2.0, "overrides": {"mapping.max_points": 3000.0}})
    assert request.seed == 2
    (override,) = checked_overrides(request.overrides)
    assert load_config(overrides=[override]).mapping.max_points == 3000


def test_over_http_artifacts_are_served_by_name_only(server: Running, client: httpx.Client) -> None:
    for name in ("../run.json", "%2e%2e%2frun.json", "/etc/passwd", "estimate.tum"):
        assert client.get(f"/api/v1/runs/abc/artifacts/{name}").status_code == 404


def niceness(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[16])


def test_a_run_over_http_ends_with_the_estimate_of_the_command_line(
    server: Running, client: httpx.Client, tmp_path: Path
) -> None:
    """The same bytes, at low priority, while the live view goes on."""
    body = {"config": "sim", "overrides": {"gait.alpha_pi": 0.1}, "seed": 3, "duration_s": 1.0}
    sent = client.post("/api/v1/runs", json=body)
    assert sent.status_code == 202
    address = sent.headers["location"]
    before = client.get("/api/v1/state").json()["t_s"]
    wait_for(lambda: client.get(address).json()["progress"] > 0.0, 60.0)
    workers = [pid for pid in children(server.process.pid) if b"run_child" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    assert [niceness(pid) for pid in workers] == [os.nice(0) + 10]
    done = wait_for(lambda: (run := client.get(address).json())["state"] not in ("queued", "running") and run, 120.0)
    assert (done["state"], done["error"]) == ("done", None)
    assert done["metrics"]["frames"] == 20
    assert {"estimate.tum", "ground_truth.tum", "run.json", "map.ply"} <= set(done["artifacts"])
    assert client.get("/api/v1/state").json()["t_s"] > before + 1.0
    estimate = client.get(f"{address}/artifacts/estimate.tum").content
    assert client.get(f"{address}/artifacts/..%2frun.json").status_code == 404

    out = tmp_path / "cli"
    command = ["run", str(config_path("sim")), "--set=gait.alpha_pi=0.1", "--seed=3", "--duration=1.0", f"--out={out}"]
    subprocess.run([sys.executable, "-m", "snakeslam", *command], check=True, timeout=120, capture_output=True)
    assert estimate
    assert estimate == (out / "estimate.tum").read_bytes()


def test_a_run_ends_with_its_server(tmp_path: Path) -> None:
    """The leash of a run is its stdin: it closes however the server goes."""
    out = tmp_path / "out"
    arguments = ["run", str(config_path("sim")), "--duration=3600", f"--out={out}", "--progress-json"]
    command = [sys.executable, "-m", "server.run_child", *arguments]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        assert run.stderr is not None
        assert run.stdin is not None
        while b"progress" not in (line := run.stderr.readline()):
            assert line
        run.stdin.close()
        assert run.wait(20) != 0
        run.stderr.read()
    assert not list(tmp_path.iterdir())
