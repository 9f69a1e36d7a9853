"""Which sensors are silent, or stamp their messages with times that cannot be right.

The estimator gives a verdict per image, so after the last image its last verdict would stand for ever. The streams are
therefore watched where they arrive, by the robot's time, whatever the reason for a silence: a process that died or was
frozen, an unplugged cable, a wrong clock.
"""

import threading
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, replace
from statistics import median

from snakeslam.calibration import SensorRig
from snakeslam.messages import CameraFrame, Health, ImuSample, Packet, Verdict
from snakeslam.runtime.slam.merge import LONGEST_WAIT_NS

NS = 1e-9
CAMERA, IMU, JOINTS = "camera", "IMU", "joints"
SILENT_NS = 400_000_000
"""Longer than simulated time may run ahead of the estimator (0.3 s); verdict and hold follow within 0.5 s."""
FIRST_INTERVAL_NS = 1_500_000_000
"""The limit until the second message: the interval is not known yet, and a recording's sensors may begin apart."""
INTERVALS_MISSED, INTERVALS_KEPT = 3, 8
"""A slow stream is silent when this many of its median interval have passed, if that is more than SILENT_NS."""
AHEAD_NS = 1_000_000_000
"""A stamp this far ahead of the robot's time is wrong; so is one that arrives later than any frame is waited for."""
MODES_WITHOUT_IMU = ("visual", "gait")


@dataclass(frozen=True, slots=True)
class SensorFault:
    """A stream without usable messages: its ``name``, and what is wrong in words."""

    name: str
    words: str


class _Stream:
    """The newest plausible stamp of one stream, and its interval."""

    def __init__(self) -> None:
        self.newest_ns: int | None = None
        self.stamp_error: str | None = None
        self._intervals_ns: deque[int] = deque(maxlen=INTERVALS_KEPT)

    def add(self, t_ns: int, now_ns: int) -> None:
        """Add a stamp; one that is not plausible does not count as a message."""
        self.stamp_error = _stamp_error(t_ns, now_ns, self.newest_ns)
        if self.stamp_error is not None:
            return
        if self.newest_ns is not None:
            self._intervals_ns.append(t_ns - self.newest_ns)
        self.newest_ns = t_ns

    @property
    def limit_ns(self) -> int:
        """How long it may be silent."""
        if not self._intervals_ns:
            return FIRST_INTERVAL_NS
        return max(SILENT_NS, round(INTERVALS_MISSED * median(self._intervals_ns)))


def _stamp_error(t_ns: int, now_ns: int, newest_ns: int | None) -> str | None:
    if t_ns - now_ns > AHEAD_NS:
        return f"stamped {(t_ns - now_ns) * NS:.1f} s ahead of the robot's time"
    if now_ns - t_ns > LONGEST_WAIT_NS:
        return f"stamped {(now_ns - t_ns) * NS:.1f} s behind the robot's time"
    if newest_ns is not None and t_ns <= newest_ns:
        return "stamped no later than the one before"
    return None


class SensorWatch:
    """Watches the stamps of each stream in ``names`` as they arrive; may be used from several threads."""

    def __init__(self, names: Iterable[str]) -> None:
        self._lock = threading.Lock()
        self._streams = {name: _Stream() for name in names}
        self._began_ns: int | None = None
        self._now_ns = 0

    @staticmethod
    def of(rig: SensorRig, mode: str, *, joints: bool) -> "SensorWatch":
        """Return the watch over the sensors that an estimator of ``mode`` and the robot's control depend on."""
        uses_imu = rig.imu0 is not None and mode not in MODES_WITHOUT_IMU
        return SensorWatch([CAMERA, *([IMU] if uses_imu else []), *([JOINTS] if joints else [])])

    def advance(self, now_ns: int) -> None:
        """Note that the robot's time has reached ``now_ns``."""
        with self._lock:
            self._began_ns = now_ns if self._began_ns is None else self._began_ns
            self._now_ns = max(self._now_ns, now_ns)

    def add(self, name: str, t_ns: int) -> None:
        """Add the stamp ``t_ns`` of a message; ignored for a stream that is not watched."""
        with self._lock:
            if name in self._streams:
                self._streams[name].add(t_ns, self._now_ns if self._began_ns is not None else t_ns)

    def add_packet(self, packet: Packet) -> None:
        """Add a packet of a recording, whose own stamps are the robot's time, and may be set back."""
        if self._began_ns is not None and packet.t_ns < self._now_ns - AHEAD_NS:
            self._restart()
        name = CAMERA if isinstance(packet, CameraFrame) else IMU if isinstance(packet, ImuSample) else JOINTS
        self.advance(packet.t_ns)
        self.add(name, packet.t_ns)

    def _restart(self) -> None:
        with self._lock:
            self._streams = {name: _Stream() for name in self._streams}
            self._began_ns, self._now_ns = None, 0

    def faults(self) -> tuple[SensorFault, ...]:
        """Return the streams that have been silent for too long."""
        with self._lock:
            return tuple(SensorFault(name, self._words(name, s)) for name, s in self._streams.items() if self._late(s))

    def missing(self) -> str | None:
        """Return in words the first stream that is silent, or has given nothing yet: the robot may not move then."""
        with self._lock:
            for name, stream in self._streams.items():
                if stream.newest_ns is None or self._late(stream):
                    return self._words(name, stream)
        return None

    def _late(self, stream: _Stream) -> bool:
        since_ns = self._began_ns if stream.newest_ns is None else stream.newest_ns
        return since_ns is not None and self._now_ns - since_ns > stream.limit_ns

    @staticmethod
    def _words(name: str, stream: _Stream) -> str:
        verb = "are" if name == JOINTS else "is"
        wrong = "" if stream.stamp_error is None else f" (its messages are {stream.stamp_error})"
        return f"the {name} {verb} silent{wrong}"


def with_faults(health: Health, faults: tuple[SensorFault, ...]) -> Health:
    """Return the health of the last image, however old, as it is shown while ``faults`` last."""
    if not faults:
        return health
    reasons = tuple(fault.words for fault in faults)
    if all(fault.name != CAMERA for fault in faults):
        verdict = Verdict.DEGRADED if health.verdict is Verdict.GOOD else health.verdict
        return replace(health, verdict=verdict, reasons=(*reasons, *health.reasons))
    verdict = health.verdict if health.verdict is Verdict.LOST else Verdict.BLIND
    return Health(verdict, reasons, map_connected=health.map_connected)
