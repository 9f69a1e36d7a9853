"""What is known of the session that runs, or ran last: its newest reports, its map and its paths."""

from dataclasses import dataclass, field

from server.models import SessionPhase, SourceKind
from server.timed_path import TimedPath
from snakeslam.config import Config
from snakeslam.messages import MapChunk
from snakeslam.runtime.bus.topics import Ended, Report, Restarting, Silence, Started, Tick

NS = 1e-9


@dataclass(slots=True)
class View:
    """All that is known of the session that runs, or ran last."""

    kind: SourceKind
    name: str
    config: Config
    number: int = 0
    """Counts the sessions of this server: another number, another session."""
    phase: SessionPhase = "starting"
    message: str | None = None
    started: Started | None = None
    tick: Tick | None = None
    chunks: dict[int, MapChunk] = field(default_factory=dict)
    map_revision: int = 0
    """Grows with every change of ``chunks``."""
    estimate: TimedPath = field(default_factory=TimedPath)
    truth: TimedPath = field(default_factory=TimedPath)
    new_map: TimedPath = field(default_factory=TimedPath)
    """The part of the estimate that lies in a map which is not connected to the first one; empty once it is."""

    def t_s(self, t_ns: int) -> float:
        """Seconds since the session's start."""
        return 0.0 if self.started is None else (t_ns - self.started.t_start_ns) * NS

    def on_report(self, report: Report) -> None:
        """Update what is known from a report."""
        if isinstance(report, Started):
            self._begin(report)
        elif isinstance(report, Restarting):
            self.phase, self.message, self.tick = "starting", report.reason, None
        elif isinstance(report, Silence):
            self.message = report.reason
        elif isinstance(report, Tick):
            self._on_tick(report)
        elif isinstance(report, MapChunk):
            known = self.chunks.get(report.key)
            if known is None or known.revision <= report.revision:
                self.chunks[report.key] = report
                self.map_revision += 1
        elif isinstance(report, Ended):
            self.phase, self.message = ("ended", None) if report.error is None else ("failed", report.error)

    def _begin(self, started: Started) -> None:
        """Begin; after a restart of the robot node forget what was known, as its time and world begin anew."""
        self.phase, self.message = "running", None
        if self.started is not None:
            self.tick, self.chunks = None, {}
            self.estimate, self.truth, self.new_map = TimedPath(), TimedPath(), TimedPath()
            self.map_revision += 1
        self.started = started

    def _on_tick(self, tick: Tick) -> None:
        for path, T in ((self.estimate, tick.T_WI), (self.truth, tick.T_WI_truth)):
            if T is not None:
                path.add(self.t_s(tick.t_ns), T)
        if tick.playback is None or tick.playback.position_s == tick.playback.computed_s:
            self._follow_new_map(tick)  # Not where a part of a recording is played again.
        self.tick = tick
        if tick.playback is not None and self.phase in ("running", "ended"):
            self.phase = "ended" if tick.playback.at_end else "running"

    def _follow_new_map(self, tick: Tick) -> None:
        """Keep the path in a map that is not connected; once it is, its positions were moved with the map."""
        if tick.health.map_connected and tick.T_WI is not None and self.new_map.rows:
            self.new_map = TimedPath()
        elif tick.T_WI is not None and not tick.health.map_connected:
            self.new_map.add(self.t_s(tick.t_ns), tick.T_WI)
