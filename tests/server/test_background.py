"""Work beside the requests outlives its failures, and says them."""

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from server.background import attempt, first_of, keep_on
from server.live import Live
from server.runs import Run, RunRequest
from server.view import View
from server.viewer import Viewer
from snakeslam.config import Config
from snakeslam.messages import MapChunk
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.topics import Event, Opening, Report
from tests.server.running import wait_for
from tests.server.test_runs import ShortRuns, until_over


@pytest.mark.parametrize(
    ("command", "error"),
    [
        (("/no/such/program",), "FileNotFoundError: [Errno 2] No such file or directory: '/no/such/program'"),
        (("/dev/null",), "PermissionError"),
        (("/bin/true", "x" * 4_000_000), "OSError: [Errno 7] Argument list too long"),
    ],
)
def test_a_run_that_cannot_be_started_has_failed_and_the_next_one_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...], error: str
) -> None:
    """The worker ended with the first of these, and every later run waited for ever."""
    said: list[tuple[str, str]] = []
    queue = ShortRuns(tmp_path / "runs", lambda level, text: said.append((level, text)))
    real = ShortRuns._command
    monkeypatch.setattr(ShortRuns, "_command", lambda self, run: command if run.request.seed == 7 else real(self, run))

    async def go() -> list[Run]:
        made = [queue.submit(RunRequest(seed=seed)) for seed in (7, 7, 1)]
        for run in made:
            await until_over(run)
        await queue.close()
        return made

    bad, again, good = asyncio.run(go())
    assert [run.state for run in (bad, again, good)] == ["failed", "failed", "done"]
    assert error in (bad.error or "")
    assert [level for level, _ in said] == ["error", "error"]
    assert f"run {bad.id} failed" in said[0][1]


@pytest.mark.parametrize(
    "printed",
    [
        "sys.stderr.write('x' * 3_000_000); sys.exit(1)",
        "sys.stderr.write('[' * 60_000 + chr(10)); sys.exit(1)",
        "sys.stderr.write('{\"progress\": NaN}' + chr(10) + '{\"progress\": 1' + '0' * 400 + '}'); sys.exit(1)",
        "sys.stdout.write('{\"frames\": NaN}')",
        "sys.stdout.write('{\"frames\": ' * 20_000)",
        "sys.stdout.write('[1]')",
        "sys.stdout.buffer.write(b'\\xff\\xfe' * 1000)",
    ],
)
def test_whatever_a_run_prints_is_no_more_than_its_own_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, printed: str
) -> None:
    import sys

    queue = ShortRuns(tmp_path / "runs")
    real = ShortRuns._command
    odd = (sys.executable, "-c", f"import sys; {printed}")
    monkeypatch.setattr(ShortRuns, "_command", lambda self, run: odd if run.request.seed == 7 else real(self, run))

    async def go() -> list[Run]:
        made = [queue.submit(RunRequest(seed=seed)) for seed in (7, 1)]
        for run in made:
            await until_over(run)
        await queue.close()
        return made

    bad, good = asyncio.run(go())
    assert (bad.state, good.state) == ("failed", "done")
    assert bad.error
    assert "\n" not in bad.error


def test_a_loop_goes_on_after_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.background.AFTER_FAILURE_S", 0.0)
    said: list[str] = []
    steps: list[int] = []

    async def step() -> None:
        steps.append(len(steps))
        if len(steps) % 2:
            raise ValueError("odd\nstep")
        await asyncio.sleep(0)

    def say(level: str, text: str) -> None:
        said.append(text)
        raise RuntimeError("nobody listens")

    async def go() -> None:
        task = asyncio.create_task(keep_on("a loop", step, say))
        while len(steps) < 6:
            await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(go())
    assert said[0] == "a loop failed (ValueError: odd step) and goes on"


def test_of_a_sockets_two_sides_the_first_to_end_ends_both() -> None:
    ended: list[str] = []

    async def fails() -> None:
        raise ValueError("broken")

    async def waits() -> None:
        try:
            await asyncio.sleep(60)
        finally:
            ended.append("other")

    asyncio.run(first_of("a socket", fails(), waits()))
    assert ended == ["other"]


def test_a_listener_that_fails_keeps_no_report_from_the_others() -> None:
    received: list[Report] = []

    def bad(report: Report, view: View) -> None:
        raise KeyError(report)

    async def start() -> None:
        live = Live(Config(), lambda *_: StillHost())
        live.subscribe(bad)
        live.subscribe(lambda report, _: received.append(report))
        await live.start(SessionSpec(Config()), "sim", "it")
        await live.stop()

    asyncio.run(start())
    assert [type(report) for report in received] == [Opening, Event]


class StillHost:
    """A host without a session, whose pulse fails."""

    def start(self, put: object) -> None: ...
    def send(self, _command: object) -> int:
        return 0

    def pulse(self) -> None:
        raise OSError("no bus")

    def stop(self) -> None: ...


def test_a_chunk_that_cannot_be_drawn_does_not_end_the_drawing(tmp_path: Path) -> None:
    """A key that is no whole number ended the drawing thread: the view was frozen from then on."""
    view = View("sim", "it", Config())
    viewer = Viewer(tmp_path / "viewer.sock")
    try:
        drawn: list[Any] = []
        show = viewer._scene.show_chunk

        def noted(chunk: MapChunk) -> None:
            drawn.append(chunk.key)
            show(chunk)

        viewer._scene.show_chunk = noted  # type: ignore[method-assign]
        bad: Any = "a key"
        for key in (bad, 3):
            viewer.on_report(MapChunk(key, 0, np.eye(4), np.zeros((5, 3)), np.zeros((5, 3), np.uint8)), view)
        wait_for(lambda: drawn == ["a key", 3])
        viewer.on_report(MapChunk(4, 0, np.eye(4), np.zeros((5, 3)), np.zeros((5, 3), np.uint8)), view)
        wait_for(lambda: drawn == ["a key", 3, 4])
        assert viewer._thread.is_alive()
    finally:
        viewer.close()


def test_an_attempt_that_fails_is_noted() -> None:
    said: list[str] = []

    def fail() -> None:
        raise OSError("full")

    attempt("writing", fail, lambda _, text: said.append(text))
    assert said == ["writing failed (OSError: full) and goes on"]
