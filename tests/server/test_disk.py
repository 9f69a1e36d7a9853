"""What lies on disk reaches the API as it is, or as one line: nothing there takes a list from everybody."""

import asyncio
import json
import os
import re
import signal
import tempfile
from pathlib import Path

import pytest

from server.recordings import Library, recording_answer
from server.run_store import INTERRUPTED, RunStore
from server.runs import RunRequest
from tests.server.running import is_ready, start, wait_for
from tests.server.test_runs import ShortRuns, until_over

FACTS = {
    "written": "2026-01-02T03:04:05Z",
    "seed": 5,
    "config": {"gait": {"name": "pedal"}, "sim": {"world": "office"}},
    "metrics": {"frames": 9},
}


def tum(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "rgb.txt").write_text("1.0 rgb/1.png\n2.0 rgb/2.png\n")
    (folder / "depth.txt").write_text("1.0 depth/1.png\n2.0 depth/2.png\n")
    return folder


def test_odd_folders_hide_no_recording(tmp_path: Path) -> None:
    tum(tmp_path / "good")
    tum(Path(os.fsdecode(os.fsencode(tmp_path) + b"/bad-\xff\xfe")))
    tum(tmp_path / "line\nbreak")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "gone").symlink_to("nowhere")
    tum(tmp_path / "closed").chmod(0)
    (tmp_path / "binary").mkdir()
    (tmp_path / "binary" / "rgb.txt").write_bytes(b"\x00\xff" * 1000)
    (tmp_path / "pipe").mkdir()
    os.mkfifo(tmp_path / "pipe" / "rgb.txt")
    (tmp_path / "folder" / "rgb.txt").mkdir(parents=True)
    try:
        found = [recording_answer(key, summary).model_dump() for key, summary in Library((tmp_path,)).all().items()]
    finally:
        (tmp_path / "closed").chmod(0o700)
    text = json.dumps(found, ensure_ascii=False).encode().decode()
    assert "\n" not in text
    names = {entry["name"]: entry["frames"] for entry in found}
    assert names["good"] == 2
    assert names["bad-\N{REPLACEMENT CHARACTER}\N{REPLACEMENT CHARACTER}"] == 2
    assert names["line\N{REPLACEMENT CHARACTER}break"] == 2
    assert names["binary"] is None


def test_runs_on_disk_are_shown_after_a_restart(tmp_path: Path) -> None:
    async def go() -> None:
        queue = ShortRuns(tmp_path / "runs")
        made = [queue.submit(RunRequest(seed=seed, overrides={"gait.name": "pedal"})) for seed in (1, 13)]
        for run in made:
            await until_over(run)
        await queue.close()

    asyncio.run(go())
    again = ShortRuns(tmp_path / "runs")
    done, failed = again.all()
    assert (done.state, done.artifacts, done.metrics) == ("done", ["estimate.tum"], {"frames": 1})
    named = [done.name, done.config, done.gait, done.world, done.seed]
    assert named == ["pedal-s1", "sim", "pedal", "corridor", 1]
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z", done.when or "")
    assert (failed.state, failed.error) == ("failed", "the seed is unlucky")
    path = again.artifact(done.id, "estimate.tum")
    assert path is not None
    assert path.read_text() == "1"


def test_odd_files_hide_no_run(tmp_path: Path) -> None:
    def folder(k: int) -> Path:
        path = tmp_path / f"{k:012x}"
        path.mkdir()
        return path

    (folder(1) / "run.json").write_text(json.dumps(FACTS))
    for k, data in enumerate(
        [
            b"\x00\xff",
            b"[" * 100_000,
            b"[1, 2]",
            b'{"seed": NaN}',
            json.dumps(FACTS | {"metrics": {"a": float("nan")}}).encode(),
            json.dumps(FACTS | {"seed": "5"}).encode(),
            json.dumps(FACTS | {"config": None}).encode(),
            json.dumps(FACTS | {"written": "\ud800"}).encode(),
            b'{"a": "' + b"x" * 5_000_000 + b'"}',
            b'{"seed": 1' + b"0" * 5000 + b"}",
        ],
        start=2,
    ):
        (folder(k) / "run.json").write_bytes(data)
        (tmp_path / f"{k + 100:012x}.json").write_bytes(data)
    (tmp_path / f"{200:012x}").symlink_to(tmp_path)
    (tmp_path / f"{201:012x}.json").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / f"{202:012x}.json")
    os.mkfifo(folder(203) / "run.json")
    folder(204)
    (tmp_path / "another").mkdir()
    runs = ShortRuns(tmp_path).all()
    json.dumps([run.model_dump() for run in runs], allow_nan=False, ensure_ascii=False).encode()
    states = {int(run.id, 16): run.state for run in runs}
    assert states.pop(1) == "done"
    assert set(states.values()) == {"failed"}
    assert set(range(2, 12)) | {203, 204} <= set(states)
    assert not {200, 201, 202} & set(states)


def test_odd_artifacts_are_left_out(tmp_path: Path) -> None:
    out = tmp_path / f"{1:012x}"
    out.mkdir()
    (out / "good.csv").touch()
    (out / "link").symlink_to("/etc/passwd")
    os.mkfifo(out / "pipe")
    Path(os.fsdecode(os.fsencode(out) + b"/\xff")).touch()
    assert list(RunStore(tmp_path).artifacts(f"{1:012x}")) == ["good.csv"]


@pytest.mark.parametrize("number", [signal.SIGKILL])
def test_after_kill_9_nothing_is_left_and_the_runs_are_listed_as_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    # Short: the sockets in it have a path of 107 bytes at most.
    temporary = Path(tempfile.mkdtemp(prefix="t-", dir="/tmp"))
    monkeypatch.setenv("TMPDIR", str(temporary))
    folder = tmp_path / "server"
    folder.mkdir()
    living = start(folder)
    body = {"overrides": {"sim.world": "office"}, "seed": 4, "duration_s": 3600.0}
    try:
        server = start(folder)
        with server.client() as client:
            wait_for(lambda: is_ready(client), 120.0)
            sent = [client.post("/api/v1/runs", json=body).json()["id"] for _ in range(2)]
            wait_for(lambda: client.get(f"/api/v1/runs/{sent[0]}").json()["state"] == "running")
        with living.client() as client:
            states = {run["id"]: run["state"] for run in client.get("/api/v1/runs").json()}
            assert [states[run_id] for run_id in sent] == ["running", "queued"]
            assert client.delete(f"/api/v1/runs/{sent[0]}").status_code == 409
        server.stop(number)
        left = {path.name for path in temporary.iterdir()}
        again = start(folder)
        try:
            with again.client() as client:
                shown = {run["id"]: run for run in client.get("/api/v1/runs").json()}
            for run_id in sent:
                assert (shown[run_id]["state"], shown[run_id]["error"]) == ("interrupted", INTERRUPTED)
                assert (shown[run_id]["world"], shown[run_id]["seed"]) == ("office", 4)
            with living.client() as client:
                assert client.get("/api/v1/state").status_code == 200
            now = {path.name for path in temporary.iterdir()}
            assert len(left & now) == 2  # Those of the server that lives, and its bus.
            assert len(left) == 4
        finally:
            assert again.stop() == 0
    finally:
        assert living.stop() == 0
    assert list(temporary.iterdir()) == []
    temporary.rmdir()
