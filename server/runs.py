"""Scripted runs over the API: the command line in a subprocess of low priority, one at a time, in order.

Whatever goes wrong with one run is recorded as its failure, and the next one is started.
"""

import asyncio
import contextlib
import json
import re
import secrets
import sys
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from http import HTTPStatus
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

from server import strict_json
from server.background import Say, keep_on, note, reason
from server.models import Answer
from server.problem import Problem
from server.run_store import RunRecord, RunState, RunStore
from snakeslam.config import Override, load_config
from snakeslam.errors import InputError
from snakeslam.paths import configs_dir

Scalar = bool | int | float | Annotated[str, Field(max_length=1000)] | None
TERMINATE_S, CLOSE_S = 10.0, 2.0
MAX_QUEUED = 100
KEY = re.compile(r"[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)*")
# Keys whose value is a file's name: those stay with who runs the server.
PATH_KEYS = ("replay.calibration", "replay.recording")
LAST_LINES = 5
LONGEST_LINE = 64 * 1024
FROM_REQUEST = {"run.seed": "seed", "run.duration_s": "duration_s"}


def or_null(model: str) -> dict[str, Any]:
    """Return the schema of a component of the API or null, for what was written by another version of this program."""
    return {"anyOf": [{"$ref": f"#/components/schemas/{model}"}, {"type": "null"}]}


def whole(value: Any) -> Any:
    """Return a float without a fraction as an integer: in JSON 3.0 and 3 are the same number."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


class RunRequest(BaseModel):
    """POST /runs."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

    config: str = Field("sim", max_length=64)
    overrides: dict[str, Scalar] = Field(default_factory=dict, max_length=64)
    seed: Annotated[int, BeforeValidator(whole)] = Field(1, ge=0, lt=2**32)
    duration_s: float = Field(20.0, gt=0, le=86400)


class RunAnswer(Answer):
    """A run of the API, of this server or of one before it."""

    id: str
    name: str
    """Gait and seed."""
    config: str | None
    gait: str | None
    world: str | None
    seed: int | None
    when: str | None
    """When it was requested: UTC, ISO 8601."""
    request: Annotated[dict[str, Any] | None, WithJsonSchema(or_null("RunRequest"))]
    """Null for a run directory without the request."""
    state: RunState
    progress: float
    """0 to 1."""
    metrics: Annotated[dict[str, Any] | None, WithJsonSchema(or_null("RunMetrics"))]
    """Null until it is done."""
    artifacts: list[str]
    """Names of the files that it left."""
    error: str | None


def checked_overrides(overrides: Mapping[str, Scalar]) -> list[Override]:
    """Return overrides that may come from a client; InputError names the key."""
    for key, value in overrides.items():
        if not KEY.fullmatch(key):
            shown = key[:60] if key.isprintable() else repr(key[:60])
            raise InputError(f"overrides.{shown}", "is no key", "dotted names such as gait.period_s")
        if any(key == path or path.startswith(f"{key}.") for path in PATH_KEYS):
            raise InputError(f"overrides.{key}", "cannot be set here: it names a file")
        if isinstance(value, str) and not value.isprintable():
            raise InputError(f"overrides.{key}", f"{value[:40]!r} is not possible", "text that can be printed")
    return [Override(key, whole(value), f"overrides.{key}") for key, value in overrides.items()]


def config_path(name: str) -> Path:
    """Return the file of the configuration ``name``, one of those that come with the project."""
    known = {path.stem: path for path in sorted(configs_dir().glob("*.yaml"))}
    if name not in known:
        raise InputError("config", f"{name[:60]!r} is unknown", ", ".join(known))
    return known[name]


@dataclass(slots=True, eq=False)
class Run:
    """One run of this server and all that is known of it."""

    id: str
    request: RunRequest
    config: Path
    out: Path
    record: RunRecord
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
        return RunStore(self.out.parent).artifacts(self.id) if self.state == "done" else {}

    def as_record(self) -> RunRecord:
        """The run as it is written down now."""
        return self.record.model_copy(update={"state": self.state, "metrics": self.metrics, "error": self.error})

    def answer(self) -> RunAnswer:
        """Return the answer of GET /runs/{id}."""
        return run_answer(self.as_record(), list(self.artifacts()), self.progress)


def run_answer(record: RunRecord, artifacts: list[str], progress: float) -> RunAnswer:
    """Return a run as the API shows it."""
    shown = record.model_dump(exclude={"owner"})
    return RunAnswer(**shown, progress=round(progress, 4), artifacts=artifacts)


def _record(run_id: str, request: RunRequest, overrides: list[Override], path: Path) -> RunRecord:
    """Return the record of a request; InputError when its settings are wrong."""
    for key, name in FROM_REQUEST.items():
        if key in request.overrides:
            raise InputError(f"overrides.{key}", "is given beside the run's own", f"{name} of the request")
    config = load_config(path, overrides)
    return RunRecord(
        id=run_id,
        name=f"{config.gait.name}-s{request.seed}",
        config=request.config,
        gait=config.gait.name,
        world=config.sim.world,
        seed=request.seed,
        when=f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S.%fZ}",
        request=request.model_dump(),
    )


class Runs:
    """The queue and its one worker; ``say`` writes on the timeline."""

    def __init__(self, folder: Path, say: Say | None = None) -> None:
        self._store, self._say = RunStore(folder.absolute()), say
        self._runs: dict[str, Run] = {}
        self._waiting: asyncio.Queue[Run] = asyncio.Queue()
        self._worker: asyncio.Task[None] | None = None
        self._store.open()

    def submit(self, request: RunRequest) -> Run:
        """Queue a run; InputError when its settings are wrong, Problem when it cannot be written down."""
        path, run_id = config_path(request.config), secrets.token_hex(6)
        record = _record(run_id, request, checked_overrides(request.overrides), path)
        if sum(run.state == "queued" for run in self._runs.values()) >= MAX_QUEUED:
            raise Problem(
                HTTPStatus.TOO_MANY_REQUESTS, f"{MAX_QUEUED} runs are waiting; submit more when some are over"
            )
        run = Run(run_id, request, path, self._store.folder / run_id, record)
        try:
            self._store.save(run.as_record())
        except OSError as error:
            raise Problem(HTTPStatus.SERVICE_UNAVAILABLE, f"the run cannot be written: {error.strerror}") from error
        self._runs[run_id] = run
        self._waiting.put_nowait(run)
        if self._worker is None:
            self._worker = asyncio.create_task(keep_on("the queue of runs", self._work, self._say))
        return run

    def all(self) -> list[RunAnswer]:
        """Every run on disk, those of servers before this one too, oldest first; may be called from any thread."""
        mine = dict(self._runs)
        disk = [record for record in self._store.load() if record.id not in mine]
        return [self._shown(record) for record in disk] + [run.answer() for run in mine.values()]

    def get(self, run_id: str) -> RunAnswer | None:
        """One run."""
        run = self._runs.get(run_id)
        if run is not None:
            return run.answer()
        return next((self._shown(record) for record in self._store.load() if record.id == run_id), None)

    def artifact(self, run_id: str, name: str) -> Path | None:
        """One file that a run left."""
        shown = self.get(run_id)
        return None if shown is None or shown.state != "done" else self._store.artifacts(run_id).get(name)

    def own(self, run_id: str) -> Run | None:
        """One run of this server."""
        return self._runs.get(run_id)

    async def cancel(self, run: Run, patience_s: float | None = None) -> None:
        """Take a run out of the queue, or end it; nothing for one that is over."""
        if run.state not in ("queued", "running"):
            return
        run.state = "cancelled"
        self._save(run)
        if run.process is not None:
            await _end(run.process, TERMINATE_S if patience_s is None else patience_s)

    async def close(self) -> None:
        """End everything."""
        if self._worker is not None:
            self._worker.cancel()
            await asyncio.gather(self._worker, return_exceptions=True)
        await asyncio.gather(*(self.cancel(run, CLOSE_S) for run in self._runs.values()))
        self._store.close()

    def _shown(self, record: RunRecord) -> RunAnswer:
        done = record.state == "done"
        return run_answer(record, list(self._store.artifacts(record.id)) if done else [], float(done))

    def _save(self, run: Run) -> None:
        try:
            self._store.save(run.as_record())
        except OSError as error:
            note(f"writing down run {run.id}", error, self._say)

    def _command(self, run: Run) -> tuple[str, ...]:
        return sys.executable, "-m", "server.run_child", *run.arguments()

    async def _work(self) -> None:
        """Do the next run; one that cannot be done is recorded as failed."""
        run = await self._waiting.get()
        if run.state != "queued":
            return
        try:
            run.state = "running"
            self._save(run)
            await self._execute(run)
        except Exception as error:  # noqa: BLE001  whatever it is stands in the run
            note(f"run {run.id}", error, self._say)
            if not run.cancelled:
                run.state, run.error = "failed", reason(error)
            if run.process is not None:
                await _end(run.process, TERMINATE_S)
        finally:
            self._save(run)

    async def _execute(self, run: Run) -> None:
        pipe = asyncio.subprocess.PIPE
        run.process = process = await asyncio.create_subprocess_exec(
            *self._command(run), stdin=pipe, stdout=pipe, stderr=pipe
        )
        if run.cancelled:  # While the process was being made.
            await _end(process, TERMINATE_S)
        assert process.stdout is not None
        assert process.stderr is not None
        out: deque[str] = deque(maxlen=1)
        await asyncio.gather(
            _lines(process.stdout, out.append), _lines(process.stderr, lambda line: _follow(run, line))
        )
        code = await process.wait()
        _conclude(run, code, out[0] if out else "")


async def _lines(stream: asyncio.StreamReader, on_line: Callable[[str], None]) -> None:
    """Pass on each line that is not empty; of a line that is too long, its end."""
    rest = b""
    while data := await stream.read(LONGEST_LINE):
        *lines, rest = (rest + data).split(b"\n")
        rest = rest[-LONGEST_LINE:]
        for line in lines:
            if text := _text(line):
                on_line(text)
    if text := _text(rest):
        on_line(text)


def _text(line: bytes) -> str:
    return line[-LONGEST_LINE:].decode(errors="replace").strip()


def _follow(run: Run, line: str) -> None:
    """Note the progress, or keep the line among the last others."""
    progress = _progress(line)
    if progress is not None:
        run.progress = progress
    else:
        run.said.append(line[:1000])


def _progress(line: str) -> float | None:
    try:
        message: Any = strict_json.parse(line)
        return min(max(float(message["progress"]), 0.0), 1.0)
    except (ValueError, TypeError, KeyError, OverflowError):
        return None


def _conclude(run: Run, code: int, last: str) -> None:
    if run.cancelled:
        return
    metrics: Any = None
    if code == 0:
        with contextlib.suppress(ValueError):
            metrics = strict_json.parse(last)
    if isinstance(metrics, dict):
        run.state, run.progress, run.metrics = "done", 1.0, metrics
    else:
        run.state = "failed"
        run.error = run.said[-1].removeprefix("snakeslam: ") if run.said else f"the run ended with exit code {code}"


async def _end(process: asyncio.subprocess.Process, patience_s: float) -> None:
    """Terminate a process, and kill it if it does not end in time."""
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
