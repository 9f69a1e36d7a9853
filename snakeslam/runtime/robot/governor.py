"""Slows the gait before tracking is lost, and gives its pace back when it is good: a pure state machine over health."""

from snakeslam.config import Config, GovernorSettings
from snakeslam.messages import Health, Verdict
from snakeslam.runtime.bus.topics import Governed, Phase

NS = 1e-9
LONGEST_STEP_S = 0.5
"""A gap in the estimates longer than this does not count in full."""
ENOUGH = 1e-9


def ease(health: Health, settings: GovernorSettings) -> tuple[float, str | None]:
    """Return how well the estimator is off, 0 (least pace) to 1 (full), and the worst reason.

    The worst of three: the verdict (nothing supports the pose: 0), and linear between their two limits the features
    followed and the innovations. An estimator without camera follows none and may still be good.
    """
    found: list[tuple[float, str | None]] = [(1.0, None)]
    if health.verdict in (Verdict.INITIALISING, Verdict.BLIND, Verdict.LOST):
        found.append((0.0, f"the estimator is {health.verdict.value}"))
    if health.tracks > 0 or health.verdict is not Verdict.GOOD:
        share = _between(health.tracks, settings.few_tracks, settings.enough_tracks)
        found.append((share, f"only {health.tracks} features followed"))
    if health.innovation is not None:
        share = 1.0 - _between(health.innovation, settings.fine_innovation, settings.bad_innovation)
        found.append((share, f"innovations {health.innovation:.1f} times what is foreseen"))
    return min(found, key=lambda item: item[0])


def _between(value: float, low: float, high: float) -> float:
    return min(max((value - low) / max(high - low, ENOUGH), 0.0), 1.0)


class Governor:
    """Takes pace at once and gives it back late and slowly, so that it does not swing with the head."""

    def __init__(self, settings: GovernorSettings) -> None:
        self._settings = settings
        self._now = Governed()
        self._t_ns: int | None = None
        self._good_s = 0.0

    @property
    def now(self) -> Governed:
        """What is allowed now."""
        return self._now

    def step(self, t_ns: int, health: Health) -> Governed:
        """Take the health of a frame at ``t_ns`` and return what is allowed from here."""
        dt_s = 0.0 if self._t_ns is None else min(max((t_ns - self._t_ns) * NS, 0.0), LONGEST_STEP_S)
        self._t_ns = t_ns
        settings, pace = self._settings, self._now.pace
        share, reason = ease(health, settings)
        wanted = settings.least_pace + (1.0 - settings.least_pace) * share
        if wanted < pace - ENOUGH:
            self._good_s = 0.0
            pace = max(wanted, pace - settings.fall_per_s * dt_s)
            phase = Phase.SLOWING if pace > wanted + ENOUGH else Phase.SLOW
        else:
            self._good_s = self._good_s + dt_s if wanted > pace + ENOUGH else 0.0
            phase = self._now.phase
            if self._good_s > settings.good_s:
                pace, phase = min(wanted, pace + settings.rise_per_s * dt_s), Phase.RETURNING
        if pace >= 1.0 - ENOUGH:
            self._now = Governed()
        else:
            self._now = Governed(pace, phase, reason or self._now.reason)
        return self._now


def build_governor(config: Config) -> Governor | None:
    """Return the governor; None where it is switched off."""
    return Governor(config.governor) if config.governor.enabled else None
