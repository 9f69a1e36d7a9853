"""Figures for Prometheus."""

from prometheus_client import CollectorRegistry, Counter, Gauge, generate_latest

from snakeslam.messages import Verdict
from snakeslam.runtime.topics import Tick


class Metrics:
    """The live session's health and load, in a registry of its own."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.realtime = Gauge("snakeslam_realtime_factor", "Simulated over wall time", registry=self.registry)
        self.frame_rate = Gauge("snakeslam_frame_rate_hz", "Camera frames a second", registry=self.registry)
        self.points = Gauge("snakeslam_map_points", "Points in the map", registry=self.registry)
        self.tracks = Gauge("snakeslam_tracks", "Features tracked", registry=self.registry)
        self.tracked = Gauge("snakeslam_tracked", "1 while the camera supports the pose", registry=self.registry)
        self.estop = Gauge("snakeslam_estop_latched", "1 while the E-stop is latched", registry=self.registry)
        self.clients = Gauge("snakeslam_telemetry_clients", "Open telemetry websockets", registry=self.registry)
        self.ticks = Counter("snakeslam_ticks", "Ticks from the session", registry=self.registry)
        self.pictures = Counter("snakeslam_pictures", "Pictures from the session", registry=self.registry)
        self.dropped = Counter(
            "snakeslam_telemetry_dropped", "Messages replaced by newer ones", ["kind"], registry=self.registry
        )

    def on_tick(self, tick: Tick) -> None:
        """Take a tick."""
        self.ticks.inc()
        self.realtime.set(tick.realtime_factor or 0.0)
        self.frame_rate.set(tick.frame_rate_hz or 0.0)
        self.points.set(tick.map_points)
        self.tracks.set(tick.health.tracks)
        self.tracked.set(Verdict(tick.health.verdict).tracked)
        self.estop.set(tick.estop_reason is not None)

    def text(self) -> bytes:
        """Everything, in Prometheus' text format."""
        return generate_latest(self.registry)
