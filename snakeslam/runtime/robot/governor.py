"""Slows the gait before tracking is lost, and lets it speed up again when tracking is good; pure."""

from snakeslam.config import Config, GovernorSettings
from snakeslam.messages import Health, Verdict
from snakeslam.runtime.bus.topics import Governed, Phase

NS = 1e-9
LONGEST_STEP_S = 0.5
"""A longer gap between two estimates counts as this long."""
TOLERANCE = 1e-9


def tracking_quality(health: Health, settings: GovernorSettings) -> tuple[float, str | None]:
    """Return how good the tracking is, from 0 (least pace) to 1 (full pace), and the worst reason against it.

    The least of three: 0 for a verdict without a supported pose, the number of tracked features and the size of the
    innovations, each linear between its two limits. An estimator without camera tracks no feature and may be good.
    """
    found: list[tuple[float, str | None]] = [(1.0, None)]
    if health.verdict in (Verdict.INITIALISING, Verdict.BLIND, Verdict.LOST):
        found.append((0.0, f"the estimator is {health.verdict.value}"))
    if health.tracks > 0 or health.verdict is not Verdict.GOOD:
        quality = _fraction(health.tracks, settings.few_tracks, settings.enough_tracks)
        found.append((quality, f"only {health.tracks} features tracked"))
    if health.innovation is not None:
        quality = 1.0 - _fraction(health.innovation, settings.fine_innovation, settings.bad_innovation)
        found.append((quality, f"innovations {health.innovation:.1f} times their expected size"))
    return min(found, key=lambda item: item[0])


def _fraction(value: float, low: float, high: float) -> float:
    return min(max((value - low) / max(high - low, TOLERANCE), 0.0), 1.0)


class Governor:
    """Lowers the pace at once and raises it late and slowly, so that it does not oscillate with the head's motion."""

    def __init__(self, settings: GovernorSettings) -> None:
        self._settings = settings
        self._now = Governed()
        self._t_ns: int | None = None
        self._good_s = 0.0

    @property
    def now(self) -> Governed:
        """The pace that is allowed now."""
        return self._now

    def step(self, t_ns: int, health: Health) -> Governed:
        """Add the health at the image of ``t_ns`` and return the pace that is allowed from now on."""
        dt_s = 0.0 if self._t_ns is None else min(max((t_ns - self._t_ns) * NS, 0.0), LONGEST_STEP_S)
        self._t_ns = t_ns
        settings, pace = self._settings, self._now.pace
        quality, reason = tracking_quality(health, settings)
        goal = settings.least_pace + (1.0 - settings.least_pace) * quality
        if goal < pace - TOLERANCE:
            self._good_s = 0.0
            pace = max(goal, pace - settings.fall_per_s * dt_s)
            phase = Phase.SLOWING if pace > goal + TOLERANCE else Phase.SLOW
        else:
            self._good_s = self._good_s + dt_s if goal > pace + TOLERANCE else 0.0
            phase = self._now.phase
            if self._good_s > settings.good_s:
                pace, phase = min(goal, pace + settings.rise_per_s * dt_s), Phase.RETURNING
        if pace >= 1.0 - TOLERANCE:
            self._now = Governed()
        else:
            self._now = Governed(pace, phase, reason or self._now.reason)
        return self._now


def build_governor(config: Config) -> Governor | None:
    """Return the governor; None where it is switched off."""
    return Governor(config.governor) if config.governor.enabled else None
