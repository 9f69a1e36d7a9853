"""When a robot that moves and sees nothing is stopped, and how long it backs up; pure, with the time given."""

from snakeslam.config import SafetySettings
from snakeslam.messages import Health

SEEN_NS = 300_000_000
"""Sight must last for so long to count: a feature or two for an image or two let nobody see the way."""


class Blindness:
    """How long a moving robot has seen nothing: no image supported the estimate, whatever else carries it meanwhile.

    Every time is the backend's, in ns. ``min_features``: a robot at rest may be sure of its pose without any, and still
    sees nothing; once it was stopped, only so many of them show that the view is free again.
    """

    def __init__(self, settings: SafetySettings, min_features: int) -> None:
        self._min_features = min_features
        self._limit_ns = round(settings.max_blind_s * 1e9)
        self._back_up_ns = round(settings.back_up_s * 1e9)
        self.words = f"the camera has seen nothing for {settings.max_blind_s:g} s"
        """Why the robot is held."""
        self._blind_since_ns: int | None = None
        self._seen_since_ns: int | None = None
        self._back_up_until_ns: int | None = None
        self.stopped = False
        """Whether the robot was stopped for it, and has neither seen anything since nor been started again."""

    @property
    def backs_up(self) -> bool:
        """Whether the operator has the robot back up."""
        return self._back_up_until_ns is not None

    def add(self, t_ns: int, health: Health) -> None:
        """Take the verdict on an image."""
        if not health.verdict.tracked or (self.stopped and health.tracks < self._min_features):
            self._seen_since_ns = None
            self._blind_since_ns = t_ns if self._blind_since_ns is None else self._blind_since_ns
            return
        self._seen_since_ns = t_ns if self._seen_since_ns is None else self._seen_since_ns
        if t_ns - self._seen_since_ns >= SEEN_NS:
            self._blind_since_ns, self.stopped = None, False

    def start(self, t_ns: int) -> None:
        """The operator has set the robot going: blind or not, it may go on for the whole limit."""
        self._back_up_until_ns, self.stopped = None, False
        self._blind_since_ns = None if self._blind_since_ns is None else t_ns

    def back_up(self, t_ns: int) -> None:
        """The operator has the robot back up."""
        self._back_up_until_ns = t_ns + self._back_up_ns

    def end(self) -> None:
        """The robot is at rest or held."""
        self._back_up_until_ns = None

    def stop(self) -> None:
        """The robot is held because it is blind."""
        self._back_up_until_ns, self.stopped = None, True

    def too_long(self, t_ns: int) -> bool:
        """Whether a moving robot must be held now."""
        since_ns = self._blind_since_ns
        return bool(self._limit_ns) and not self.backs_up and since_ns is not None and t_ns - since_ns > self._limit_ns

    def backed_up(self, t_ns: int) -> bool:
        """Whether the back-up is over."""
        return self._back_up_until_ns is not None and t_ns >= self._back_up_until_ns
