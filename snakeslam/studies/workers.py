"""A few processes that work through a list of jobs; one that dies fails its job and no other."""

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from snakeslam.errors import SnakeslamError
from snakeslam.threads import use_one_thread

Job = TypeVar("Job")
Result = TypeVar("Result")
GIVEN_S = 5.0
"""How long a worker may take to leave."""


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a job has no result, in one line."""

    reason: str


@dataclass(frozen=True, slots=True)
class _Worker:
    process: BaseProcess
    pipe: Connection


def work_through(
    jobs: Iterable[Job], work: Callable[[Job], Result], count: int
) -> Generator[tuple[Job, Result | Failure]]:
    """Yield each job with its result or failure as soon as it is there, ``count`` at a time, each in its own process.

    ``work`` and the jobs must be importable and picklable: workers are spawned, with one thread for each numerical
    library. They end with the iteration, also with one that is left early.
    """
    use_one_thread()
    waiting = deque(jobs)
    busy: dict[Connection, tuple[_Worker, Job]] = {}
    idle: list[_Worker] = []
    try:
        while waiting or busy:
            while waiting and len(busy) < count:
                worker = idle.pop() if idle else _start(work)
                busy[worker.pipe] = worker, waiting.popleft()
                worker.pipe.send(busy[worker.pipe][1])
            for pipe in wait(list(busy)):
                worker, job = busy[pipe]  # type: ignore[index]
                result = _receive(worker)
                del busy[worker.pipe]
                if worker.process.is_alive():
                    idle.append(worker)
                yield job, result
    finally:
        for worker in [*idle, *(worker for worker, _ in busy.values())]:
            _end(worker)


def _start(work: Callable[[Any], Any]) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, work), daemon=True)
    process.start()
    # With the child's end open here too, its death would not be noticed.
    theirs.close()
    return _Worker(process, ours)


def _serve(pipe: Connection, work: Callable[[Any], Any]) -> None:
    """Do the jobs that come through ``pipe`` until it is closed; an interruption is the parent's to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        while True:
            pipe.send(_attempt(work, pipe.recv()))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


def _attempt(work: Callable[[Any], Any], job: object) -> object:
    try:
        return work(job)
    except SnakeslamError as error:
        return Failure(" ".join(str(error).split()))
    except Exception as error:  # noqa: BLE001  whatever it is stands in the job's row
        return Failure(" ".join(f"{type(error).__name__}: {error}".split()))


def _receive(worker: _Worker) -> Any:
    """Return what the worker sent, a Failure when it died instead."""
    try:
        return worker.pipe.recv()
    except (EOFError, ConnectionResetError):
        worker.process.join(GIVEN_S)
        worker.pipe.close()
        return Failure(f"its process ended with code {worker.process.exitcode}")


def _end(worker: _Worker) -> None:
    worker.pipe.close()
    worker.process.terminate()
    worker.process.join(GIVEN_S)
    if worker.process.is_alive():
        worker.process.kill()
        worker.process.join()
