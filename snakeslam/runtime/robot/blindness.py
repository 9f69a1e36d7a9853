"""How long a moving robot may go on without support from its camera, and how long it backs up; pure.

The estimator dead-reckons through a blind time, but the operator sees nothing meanwhile: the robot may stand before a
wall. So a robot that moves blind for ``safety.max_blind_s`` is held, and the operator is offered a back-up.
"""

from snakeslam.config import SafetySettings
from snakeslam.messages import Health

SIGHT_NS = 300_000_000
"""Support from the camera counts once it has lasted this long: a few features in one image show the operator little."""


class Blindness:
    """Keeps since when no image has supported the pose, and until when the robot backs up.

    All times are the backend's, in ns. ``min_features``: a stationary robot may be sure of its pose without a feature
    and still see nothing, so a robot that was held for blindness counts as seeing only with this many features.
    """

    def __init__(self, settings: SafetySettings, min_features: int) -> None:
        self._min_features = min_features
        self._limit_ns = round(settings.max_blind_s * 1e9)
        self._back_up_ns = round(settings.back_up_s * 1e9)
        self.reason = f"the camera has seen nothing for {settings.max_blind_s:g} s"
        """Why the robot is held, for the operator."""
        self._blind_since_ns: int | None = None
        self._seen_since_ns: int | None = None
        self._back_up_until_ns: int | None = None
        self.held = False
        """Whether the robot was held for blindness, and has neither seen anything nor been started since."""

    @property
    def backs_up(self) -> bool:
        """Whether the robot backs up at the operator's request."""
        return self._back_up_until_ns is not None

    def add(self, t_ns: int, health: Health) -> None:
        """Add the estimator's health at the image of ``t_ns``."""
        if not health.verdict.tracked or (self.held and health.tracks < self._min_features):
            self._seen_since_ns = None
            self._blind_since_ns = t_ns if self._blind_since_ns is None else self._blind_since_ns
            return
        self._seen_since_ns = t_ns if self._seen_since_ns is None else self._seen_since_ns
        if t_ns - self._seen_since_ns >= SIGHT_NS:
            self._blind_since_ns, self.held = None, False

    def start(self, t_ns: int) -> None:
        """Note that the operator started the robot: blind or not, it may move for the whole limit again."""
        self._back_up_until_ns, self.held = None, False
        self._blind_since_ns = None if self._blind_since_ns is None else t_ns

    def back_up(self, t_ns: int) -> None:
        """Note that the operator has the robot back up from ``t_ns`` on."""
        self._back_up_until_ns = t_ns + self._back_up_ns

    def end_back_up(self) -> None:
        """Note that the robot was stopped or held."""
        self._back_up_until_ns = None

    def hold(self) -> None:
        """Note that the robot is held for blindness."""
        self._back_up_until_ns, self.held = None, True

    def too_long(self, t_ns: int) -> bool:
        """Return whether a moving robot must be held at ``t_ns``."""
        since_ns = self._blind_since_ns
        return bool(self._limit_ns) and not self.backs_up and since_ns is not None and t_ns - since_ns > self._limit_ns

    def backed_up(self, t_ns: int) -> bool:
        """Return whether a back-up has lasted its time at ``t_ns``."""
        return self._back_up_until_ns is not None and t_ns >= self._back_up_until_ns
