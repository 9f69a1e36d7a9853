"""Scripted runs over the API: the command line in a subprocess of low priority, one at a time, in order."""

import asyncio
import contextlib
import json
import re
import secrets
import sys
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from snakeslam.config import Override, load_config
from snakeslam.errors import InputError
from snakeslam.paths import configs_dir

RunState = Literal["queued", "running", "done", "failed", "cancelled"]
Scalar = bool | int | float | str | None
TERMINATE_S, CLOSE_S = 10.0, 2.0
MAX_QUEUED = 100
KEY = re.compile(r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)*")
# Keys whose value is a file's name: those stay with who runs the server.
PATH_KEYS = ("replay.calibration",)
LAST_LINES = 5


class RunRequest(BaseModel):
    """POST /runs."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    config: str = Field("sim", max_length=64)
    overrides: dict[str, Scalar] = Field(default_factory=dict, max_length=64)
    seed: int = Field(1, ge=0, lt=2**32)
    duration_s: float = Field(20.0, gt=0, le=86400)


def checked_overrides(overrides: Mapping[str, Scalar]) -> list[Override]:
    """Return overrides that may come from a client; InputError names the key."""
    for key in overrides:
        if not KEY.fullmatch(key):
            raise InputError(f"overrides.{key[:60]}", "is no key", "dotted names such as gait.period_s")
        if any(key == path or path.startswith(f"{key}.") for path in PATH_KEYS):
            raise InputError(f"overrides.{key}", "cannot be set here: it names a file")
    return [Override(key, value, f"overrides.{key}") for key, value in overrides.items()]


def config_path(name: str) -> Path:
    """Return the file of the configuration ``name``, one of those that come with the project."""
    known = {path.stem: path for path in sorted(configs_dir().glob("*.yaml"))}
    if name not in known:
        raise InputError("config", f"{name[:60]!r} is unknown", ", ".join(known))
    return known[name]


@dataclass(slots=True, eq=False)
class Run:
    """One run and all that is known of it."""

    id: str
    request: RunRequest
    config: Path
    out: Path
    state: RunState = "queued"
    progress: float = 0.0
    metrics: dict[str, Any] | None = None
    error: str | None = None
    process: asyncio.subprocess.Process | None = None
    said: deque[str] = field(default_factory=lambda: deque(maxlen=LAST_LINES))

    @property
    def cancelled(self) -> bool:
        """Whether somebody took it back."""
        return self.state == "cancelled"

    def arguments(self) -> list[str]:
        """The command line's arguments."""
        request = self.request
        sets = [f"--set={key}={json.dumps(value)}" for key, value in request.overrides.items()]
        ends = [f"--seed={request.seed}", f"--duration={request.duration_s!r}", f"--out={self.out}"]
        return ["run", str(self.config), *sets, *ends, "--json", "--progress-json"]

    def artifacts(self) -> dict[str, Path]:
        """Files that the run left, by name."""
        if self.state != "done" or not self.out.is_dir():
            return {}
        return {path.name: path for path in sorted(self.out.iterdir()) if path.is_file() and not path.is_symlink()}

    def as_json(self) -> dict[str, Any]:
        """GET /runs/{id}."""
        return {
            "id": self.id,
            "state": self.state,
            "progress": round(self.progress, 4),
            "metrics": self.metrics,
            "artifacts": list(self.artifacts()),
            "error": self.error,
            "request": self.request.model_dump(),
        }


class Runs:
    """The queue and its one worker."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._runs: dict[str, Run] = {}
        self._waiting: asyncio.Queue[Run] = asyncio.Queue()
        self._worker: asyncio.Task[None] | None = None

    def submit(self, request: RunRequest) -> Run:
        """Queue a run; InputError when its settings are wrong."""
        path = config_path(request.config)
        overrides = checked_overrides(request.overrides)
        load_config(path, overrides)
        if sum(run.state == "queued" for run in self._runs.values()) >= MAX_QUEUED:
            raise InputError("runs", "too many are waiting", f"{MAX_QUEUED}")
        run_id = secrets.token_hex(6)
        run = Run(run_id, request, path, (self._folder / run_id).absolute())
        self._runs[run_id] = run
        self._waiting.put_nowait(run)
        if self._worker is None:
            self._worker = asyncio.create_task(self._work())
        return run

    def all(self) -> list[Run]:
        """Every run since the server started, oldest first."""
        return list(self._runs.values())

    def get(self, run_id: str) -> Run | None:
        """One run."""
        return self._runs.get(run_id)

    async def cancel(self, run: Run, patience_s: float | None = None) -> None:
        """Take a run out of the queue, or end it; nothing for one that is over."""
        if run.state not in ("queued", "running"):
            return
        run.state = "cancelled"
        if run.process is not None:
            await _end(run.process, TERMINATE_S if patience_s is None else patience_s)

    async def close(self) -> None:
        """End everything."""
        if self._worker is not None:
            self._worker.cancel()
            await asyncio.gather(self._worker, return_exceptions=True)
        await asyncio.gather(*(self.cancel(run, CLOSE_S) for run in self._runs.values()))

    def _command(self, run: Run) -> tuple[str, ...]:
        return sys.executable, "-m", "server.run_child", *run.arguments()

    async def _work(self) -> None:
        while True:
            run = await self._waiting.get()
            if run.state == "queued":
                await self._execute(run)

    async def _execute(self, run: Run) -> None:
        run.state = "running"
        pipe = asyncio.subprocess.PIPE
        run.process = process = await asyncio.create_subprocess_exec(
            *self._command(run), stdin=pipe, stdout=pipe, stderr=pipe
        )
        if run.cancelled:  # While the process was being made.
            await _end(process, TERMINATE_S)
        assert process.stdout is not None
        assert process.stderr is not None
        out, _ = await asyncio.gather(process.stdout.read(), _follow(run, process.stderr))
        code = await process.wait()
        _conclude(run, code, out.decode(errors="replace"))


async def _follow(run: Run, stderr: asyncio.StreamReader) -> None:
    """Read progress, keep the last other lines."""
    async for raw in stderr:
        line = raw.decode(errors="replace").strip()
        progress = _progress(line)
        if progress is not None:
            run.progress = progress
        elif line:
            run.said.append(line)


def _progress(line: str) -> float | None:
    try:
        message: Any = json.loads(line)
        return min(max(float(message["progress"]), 0.0), 1.0)
    except (ValueError, TypeError, KeyError):
        return None


def _conclude(run: Run, code: int, out: str) -> None:
    if run.cancelled:
        return
    lines = out.strip().splitlines()
    if code == 0 and lines:
        with contextlib.suppress(ValueError):
            run.metrics = json.loads(lines[-1])
    if run.metrics is not None:
        run.state, run.progress = "done", 1.0
    else:
        run.state = "failed"
        run.error = run.said[-1].removeprefix("snakeslam: ") if run.said else f"the run ended with exit code {code}"


async def _end(process: asyncio.subprocess.Process, patience_s: float) -> None:
    """Ask a process to end, then insist."""
    if process.returncode is not None:
        return
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        await asyncio.wait_for(process.wait(), patience_s)
    except TimeoutError:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()
