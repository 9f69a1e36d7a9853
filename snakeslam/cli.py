"""The command line: exit 0 good, 2 bad input with one clear line, 1 failure."""

import itertools
import json
import math
import os
import signal
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from snakeslam.errors import InputError, NotBuiltError, SnakeslamError
from snakeslam.paths import configs_dir
from snakeslam.threads import use_one_thread

if TYPE_CHECKING:
    from snakeslam.config import Config
    from snakeslam.runtime.bus.link import Link
    from snakeslam.studies.experiment import RunResult
    from snakeslam.studies.rows import Row

BUILT = "serve, run, replay, study, node, eq"
INTERRUPTED, TERMINATED = 130, 143
MOST_WORKERS = 1024
LINE_S = 2.0
"""Progress lines are not closer than this."""

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)

SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a setting; may be given many times.")
]
OutOption = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Run directory [runs/<time>-<name>].")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the metrics as one JSON object, the last line.")]
SeedOption = Annotated[int | None, typer.Option("--seed", metavar="N", help="Seed of everything random.")]
DurationOption = Annotated[float | None, typer.Option("--duration", metavar="S", help="Seconds of simulated time.")]
ConnectOption = Annotated[
    str | None, typer.Option("--connect", metavar="ENDPOINT", help="unixsock-stream/PATH, or tls/HOST:PORT.")
]
CaOption = Annotated[Path | None, typer.Option("--ca", metavar="PEM", help="TLS: who signs the certificates.")]
CertOption = Annotated[Path | None, typer.Option("--cert", metavar="PEM", help="TLS: this side's certificate.")]
KeyOption = Annotated[Path | None, typer.Option("--key", metavar="PEM", help="TLS: its key.")]
ProgressOption = Annotated[bool, typer.Option("--progress-json", hidden=True)]


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"snakeslam {version('snakeslam')}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[bool, typer.Option("--version", callback=_print_version, is_eager=True)] = False,
) -> None:
    """Gait control, SLAM and a dashboard for snake robots."""


@app.command()
def serve(
    config: Annotated[Path | None, typer.Argument(help="Configuration [configs/sim.yaml].")] = None,
    host: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0 takes a free one.")] = 8000,
    settings: SetOption = None,
    recordings: Annotated[
        list[Path] | None, typer.Option("--recordings", metavar="DIR", help="Folder of recordings to offer.")
    ] = None,
    connect: ConnectOption = None,
    authority: CaOption = None,
    certificate: CertOption = None,
    key: KeyOption = None,
) -> None:
    """Start the dashboard; with --connect for nodes that run already, else with nodes of its own."""
    from snakeslam.config import Config, load_config

    loaded = load_config(config or configs_dir() / "sim.yaml", settings or ())
    for folder in recordings or ():
        if not folder.is_dir():
            raise InputError(f"--recordings {folder}", "no such folder")
    if not 0 <= port <= 65535:
        raise InputError("--port", str(port), "0 to 65535")
    from server.main import serve as start
    from snakeslam.runtime.assembly.build import recording_of
    from snakeslam.runtime.assembly.spec import SessionSpec

    # The page can go from the recording to a simulator, which then has these settings.
    recording = recording_of(loaded)
    if recording is not None:
        loaded = loaded.model_copy(update={"backend": Config().backend})

    link = None if connect is None else _link(connect, None, authority, certificate, key)
    autostart = loaded.run.autostart and link is None and recording is None
    spec = SessionSpec(loaded, recording=recording, autostart=autostart, link=link)
    start(loaded, host=host, port=port, recordings=recordings or [], spec=spec)


@app.command()
def run(
    config: Annotated[Path, typer.Argument(help="Configuration, such as configs/sim.yaml.")],
    settings: SetOption = None,
    seed: SeedOption = None,
    duration: DurationOption = None,
    out: OutOption = None,
    as_json: JsonOption = False,
    progress_json: ProgressOption = False,
) -> None:
    """Run an experiment with the backend of the settings, a simulator by default."""
    loaded = _load(config, settings, seed, duration)
    from snakeslam.runtime.assembly.build import recording_of

    recording = recording_of(loaded)
    to_its_end = recording is not None and "duration_s" not in loaded.run.model_fields_set
    _experiment(loaded, recording, None if to_its_end else loaded.run.duration_s, out, as_json, progress_json)


@app.command()
def replay(
    path: Annotated[Path, typer.Argument(help="EuRoC folder or TUM RGB-D folder.")],
    config: Annotated[Path | None, typer.Argument(help="Configuration [configs/replay.yaml].")] = None,
    settings: SetOption = None,
    seed: SeedOption = None,
    duration: Annotated[float | None, typer.Option("--duration", metavar="S", help="Stop after S seconds.")] = None,
    out: OutOption = None,
    as_json: JsonOption = False,
    progress_json: ProgressOption = False,
) -> None:
    """Run the estimator over a recording."""
    loaded = _load(config or configs_dir() / "replay.yaml", settings, seed, duration)
    _experiment(loaded, path, duration, out, as_json, progress_json)


@app.command()
def study(
    path: Annotated[
        Path, typer.Argument(metavar="STUDY.yaml", help="Study, such as configs/studies/head_stability.yaml.")
    ],
    workers: Annotated[
        int | None, typer.Option("--workers", metavar="N", help="Runs at a time [one for each core].")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Study directory [runs/<time>-<name>].")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the study in --out DIR.")] = False,
    scheduler: Annotated[str | None, typer.Option("--scheduler", hidden=True)] = None,
) -> None:
    """Run a study: many runs, a table and figures."""
    if scheduler is not None:
        raise NotBuiltError("--scheduler", scheduler, "--workers N on this machine")
    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise InputError("--workers", str(workers), f"1 to {MOST_WORKERS}")
    if resume and out is None:
        raise InputError("--resume", "needs the folder to go on with", "--out DIR")
    from snakeslam.studies.study import load_study
    from snakeslam.studies.sweep import run_study

    loaded = load_study(path)
    with _terminable(), _study_progress(loaded.row_count) as report:
        result = run_study(loaded, out, workers or os.cpu_count() or 1, resume, report)
    typer.echo(result.table)
    typer.echo(f"written: {result.out}", err=True)
    if result.failed:
        raise SnakeslamError(f"{result.failed} of {len(result.rows)} runs failed, see {result.out / 'results.csv'}")


@app.command()
def eq(number: Annotated[int, typer.Argument(metavar="N", help="Number of the equation in the paper.")]) -> None:
    """Print an equation of the paper, corrected, with its home in the code and its test."""
    from snakeslam.equations import equation

    typer.echo(equation(number).describe())


class NodeName(StrEnum):
    """The nodes that run on their own."""

    ROBOT = "robot"
    SLAM = "slam"
    CHECK = "check"
    CHECK_ROBOT = "check-robot"
    CHECK_SLAM = "check-slam"


@app.command()
def node(
    name: Annotated[
        NodeName, typer.Argument(help="robot, slam; check, check-robot, check-slam: whether both, or one, are alive.")
    ],
    config: Annotated[Path | None, typer.Argument(help="Configuration [configs/sim.yaml].")] = None,
    connect: ConnectOption = None,
    listen: Annotated[str | None, typer.Option(metavar="ENDPOINT", help="Be where the others connect to.")] = None,
    settings: SetOption = None,
    authority: CaOption = None,
    certificate: CertOption = None,
    key: KeyOption = None,
) -> None:
    """Run one node of the live system, until SIGINT or SIGTERM; one of all connected nodes listens."""
    from snakeslam.config import load_config

    loaded = load_config(config or configs_dir() / "sim.yaml", settings or ())
    link = _link(connect, listen, authority, certificate, key)
    from snakeslam.runtime.assembly.spec import SessionSpec
    from snakeslam.runtime.nodes.robot import run_robot
    from snakeslam.runtime.nodes.slam import run_slam
    from snakeslam.runtime.process.logs import log_to_stderr
    from snakeslam.runtime.process.node import Life, end_at_signals

    if name not in (NodeName.ROBOT, NodeName.SLAM):
        from snakeslam.runtime.bus.probe import NODES, check

        _, _, one = name.partition("-")
        typer.echo(check(link, (one,) if one else NODES))
        return
    life = Life()
    end_at_signals(life)
    log_to_stderr()
    if name is NodeName.ROBOT:
        run_robot(SessionSpec(loaded), link, life)
    else:
        run_slam(loaded, link, life)


def _link(
    connect: str | None, listen: str | None, authority: Path | None, certificate: Path | None, key: Path | None
) -> "Link":
    from snakeslam.runtime.bus.link import Certificates, Link

    endpoint = connect or listen
    if endpoint is None or (connect is not None and listen is not None):
        raise InputError("node", "needs one endpoint", "--connect or --listen")
    certificates = None
    if authority is not None and certificate is not None and key is not None:
        certificates = Certificates(authority, certificate, key)
    return Link(endpoint, listens=listen is not None, certificates=certificates)


def _add_later_command(name: str, help_text: str) -> None:
    """Add a command of the contract that a later version brings; it takes any arguments and says so."""

    def later(context: typer.Context) -> NoReturn:
        raise NotBuiltError("command", str(context.info_name), BUILT)

    settings = {"allow_extra_args": True, "ignore_unknown_options": True}
    app.command(name, context_settings=settings, help=f"{help_text} (not built yet).")(later)


for _name, _help in (
    ("export", "Write a run in another format"),
    ("report", "Figures and an HTML page of a run"),
    ("hw", "The real robot's tools"),
):
    _add_later_command(_name, _help)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; a user's mistake is one line on stderr, never a traceback."""
    use_one_thread()
    try:
        given = list(sys.argv[1:] if arguments is None else arguments)
        code: Any = app(args=given or ["--help"], prog_name="snakeslam", standalone_mode=False)
    except SnakeslamError as error:
        return _fail(str(error), error.exit_code)
    except typer.TyperException as error:
        return _fail(error.format_message(), 2)
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted", INTERRUPTED)
    except OSError as error:
        return _fail(str(error), 1)
    return int(code) if isinstance(code, int) else 0


def _fail(text: str, code: int) -> int:
    typer.echo(f"snakeslam: {' '.join(text.split())}", err=True)
    return code


def _load(path: Path, settings: list[str] | None, seed: int | None, duration: float | None) -> "Config":
    from snakeslam.config import Override, load_config

    overrides: list[str | Override] = list(settings or ())
    if seed is not None:
        overrides.append(Override("run.seed", seed, "--seed"))
    if duration is not None:
        overrides.append(Override("run.duration_s", duration, "--duration"))
    return load_config(path, overrides)


def _experiment(
    config: "Config", recording: Path | None, duration_s: float | None, out: Path | None, as_json: bool, report: bool
) -> None:
    """Run, report the progress, print the result."""
    from snakeslam.studies.experiment import run_experiment

    what = _what(config, recording, duration_s)

    def began(folder: Path) -> None:
        typer.echo(f"running: {what}; goes to {folder}", err=True)

    with _terminable(), _progress(report) as progress:
        result = run_experiment(config, recording, duration_s, out, progress, None if report else began)
    for note in result.notes:
        typer.echo(f"snakeslam: note: {' '.join(note.split())}", err=True)
    typer.echo(f"written: {result.out}", err=True)
    typer.echo(json.dumps(result.metrics.as_dict(), allow_nan=False) if as_json else _summary(result))


def _what(config: "Config", recording: Path | None, duration_s: float | None) -> str:
    """Return in words what is going to run, and for how long."""
    estimator = f"estimator {config.estimator.mode}, seed {config.run.seed}"
    if recording is not None:
        return f"{recording}, {estimator}, {'to its end' if duration_s is None else f'{duration_s:g} s of it'}"
    gait, head = config.gait.name, config.head.controller
    seconds = duration_s or config.run.duration_s
    return f"{gait} in the {config.sim.world} world, head control {head}, {estimator}, {seconds:g} s of simulated time"


@contextmanager
def _terminable() -> Generator[None]:
    """Let SIGTERM leave through the ``finally`` blocks, so that a cancelled run leaves nothing behind."""
    leaving = False

    def leave(signal_number: int, stack: object) -> NoReturn:
        nonlocal leaving
        del signal_number, stack
        leaving = True
        sys.exit(TERMINATED)

    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    except Exception as error:
        # Compiled code that is interrupted may give an error of its own instead.
        if leaving:
            raise SystemExit(TERMINATED) from error
        raise
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def _progress(as_json: bool) -> Generator[Callable[[float], None] | None]:
    """Yield what shows the progress on stderr: lines of JSON, a bar on a terminal, or a line now and then."""
    if as_json:
        last = [-1]

        def line(fraction: float) -> None:
            if math.floor(fraction * 100) > last[0]:
                last[0] = math.floor(fraction * 100)
                typer.echo(json.dumps({"progress": round(fraction, 4)}), err=True)

        yield line
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import Progress

        with Progress(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("running", total=1.0)
            yield lambda fraction: bar.update(task, completed=fraction)
    else:
        yield _progress_lines()


def _progress_lines() -> Callable[[float], None]:
    """Return what shows the progress where there is no terminal: a line each tenth, LINE_S apart or more."""
    shown, at_s = 0, monotonic()

    def line(fraction: float) -> None:
        nonlocal shown, at_s
        tenth = math.floor(fraction * 10)
        if shown < tenth < 10 and monotonic() - at_s >= LINE_S:
            shown, at_s = tenth, monotonic()
            typer.echo(f"{10 * tenth} % done", err=True)

    return line


@contextmanager
def _study_progress(total: int) -> Generator[Callable[["Row"], None]]:
    """Yield what shows a study's progress on stderr: a line for each run, and a bar on a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    columns = TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task, ended = bar.add_task("runs", total=total), itertools.count(1)

        def show(row: "Row") -> None:
            said = row.reason or ", ".join(f"{name} {value:.4g}" for name, value in row.known.items())
            console.print(f"{next(ended)}/{total} {row.words}: {row.status}: {said}")
            bar.advance(task)

        yield show


def _summary(result: "RunResult") -> str:
    """Return the metrics in words; what is unknown is a dash."""
    lines: list[str] = []
    for name, value in result.metrics.as_dict().items():
        values = value.items() if isinstance(value, dict) else [("", value)]
        words = [f"{key} {'-' if item is None else f'{item:.4g}'}".strip() for key, item in values]
        lines.append(f"{name:<18}{', '.join(words)}")
    return "\n".join(lines)
