"""Figures for Prometheus."""

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, generate_latest

from snakeslam.messages import Verdict
from snakeslam.runtime.bus.topics import Tick

PHASES = ("starting", "running", "ended", "failed")
SECONDS = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


class Metrics:
    """Session, link, estimator and control, in a registry of its own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        self._session()
        self._estimator()
        self._control()
        self._link()

    def _gauge(self, name: str, text: str) -> Gauge:
        return Gauge(f"snakeslam_{name}", text, registry=self.registry)

    def _counter(self, name: str, text: str, *labels: str) -> Counter:
        return Counter(f"snakeslam_{name}", text, labels, registry=self.registry)

    def _histogram(self, name: str, text: str, *labels: str) -> Histogram:
        return Histogram(f"snakeslam_{name}", text, labels, registry=self.registry, buckets=SECONDS)

    def _session(self) -> None:
        self.phase = Gauge("snakeslam_session", "1 for the session's phase", ["phase"], registry=self.registry)
        self.realtime = self._gauge("realtime_factor", "Backend time over wall time")
        self.frame_rate = self._gauge("frame_rate_hz", "Camera frames a second")
        self.ticks = self._counter("ticks", "Ticks from the session")
        self.images = self._counter("pictures", "Camera images from the session")

    def _estimator(self) -> None:
        self.verdict = Gauge("snakeslam_verdict", "1 for the estimator's verdict", ["verdict"], registry=self.registry)
        self.tracks = self._gauge("tracks", "Features tracked")
        self.tracked = self._gauge("tracked", "1 while the camera supports the pose")
        self.points = self._gauge("map_points", "Points in the map")
        self.error = self._gauge("error_m", "Distance from the simulator's truth, NaN where there is none")
        self.yaw_rms = self._gauge("head_yaw_rms_deg", "RMS of the head's yaw over a period, NaN where not known")

    def _control(self) -> None:
        self.moving = self._gauge("moving", "1 while the robot is commanded to move")
        self.governed = self._gauge("governed_pace", "Share of the pace that the governor allows, NaN without")
        self.drive_now = self._gauge("drive", "Drive in force, -1 to 1")
        self.estop = self._gauge("estop_latched", "1 while the E-stop is latched")
        self.leased = self._gauge("lease_held", "1 while somebody has control")
        self.leases = self._counter("leases", "Changes of the lease", "how")
        self.drive = self._counter("drive_inputs", "Messages of drive input by what became of them", "outcome")
        self.command_s = self._histogram("drive_seconds", "From drive input to the session's answer that it was obeyed")
        self.drivers = self._gauge("teleop_clients", "Open teleop websockets")

    def _link(self) -> None:
        self.clients = self._gauge("telemetry_clients", "Open telemetry websockets")
        self.dropped = self._counter("telemetry_dropped", "Messages replaced by newer ones", "kind")
        self.requests = self._counter("http_requests", "Requests answered", "method", "path", "status")
        self.request_s = self._histogram("http_seconds", "Time to answer a request", "method", "path")
        self.limited = self._counter("rate_limited", "Requests refused for their rate", "kind")

    def on_tick(self, tick: Tick) -> None:
        """Take a tick."""
        self.ticks.inc()
        self.realtime.set(_or_nan(tick.realtime_factor))
        self.frame_rate.set(_or_nan(tick.frame_rate_hz))
        self.points.set(tick.map_points)
        self.tracks.set(tick.health.tracks)
        self.tracked.set(Verdict(tick.health.verdict).tracked)
        for verdict in Verdict:
            self.verdict.labels(verdict.value).set(tick.health.verdict == verdict)
        self.error.set(_or_nan(tick.error_m))
        self.yaw_rms.set(_or_nan(tick.head.yaw_rms_deg))
        self.moving.set(tick.moving)
        self.governed.set(_or_nan(None if tick.governed is None else tick.governed.pace))
        self.drive_now.set(0.0 if tick.gait is None else tick.gait.drive)
        self.estop.set(tick.estop_reason is not None)

    def on_phase(self, phase: str) -> None:
        """Take the session's phase."""
        for name in PHASES:
            self.phase.labels(name).set(name == phase)

    def text(self) -> bytes:
        """Return all figures in Prometheus' text format."""
        return generate_latest(self.registry)


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value
