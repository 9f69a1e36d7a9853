"""The estimator's verdict on each frame, with its reasons in words for the operator."""

from dataclasses import dataclass, replace

import numpy as np

from snakeslam.estimation.filter.gating import Agreement
from snakeslam.estimation.health_settings import HealthSettings
from snakeslam.messages import Float, Health, Verdict

ENOUGH_TRIED = 5
"""Fewer measurements than this say nothing about their agreement with the state."""
NEW_MAP, TIED = "new map, not connected to the old one", "tied to the old map again"
"""Events; the first is also a reason of the verdict while the map is not connected."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """The evidence of one frame: features tracked and rejected, agreement of the measurements, faults of the inputs.

    ``cov_v`` (3, 3) is the covariance of the velocity, ``blind_s`` the time since a frame last supported the state,
    ``frozen`` an image that repeats the one before, ``stationary`` a head that image and IMU both find stationary,
    ``gait_supports`` a displacement by the gait that passed its gate; ``gait_faults`` are its faults in words.
    """

    tracked: int
    rejected: int
    agreement: Agreement
    cov_v: Float
    blind_s: float
    frozen: bool
    stationary: bool
    imu_gap_s: float
    bad_samples: int
    gait_supports: bool = False
    gait_faults: tuple[str, ...] = ()
    imu_doubts: tuple[str, ...] = ()
    """Faults of the IMU's samples since the frame before, in words."""


def supports(evidence: Evidence, settings: HealthSettings) -> bool:
    """Return whether a frame supports the state: enough features are tracked, and enough of them agree with it.

    After an IMU gap of ``max_blind_s`` (a clock that was set) no frame does: the predicted state is of no use then.
    """
    if evidence.imu_gap_s > settings.max_blind_s:
        return False
    agreement = evidence.agreement
    contradicts = agreement.tried >= ENOUGH_TRIED and agreement.accepted < settings.min_features
    camera = evidence.tracked >= settings.min_features and not evidence.frozen and not contradicts
    return camera or evidence.stationary


def judge(evidence: Evidence, settings: HealthSettings) -> Health:
    """Return the verdict of a frame.

    LOST after too long a time without the camera, or with too large a sigma of the velocity; BLIND while no frame
    supports the state; DEGRADED with few features, many rejections, large innovations or faults of the input.
    """
    reasons, tracked = _reasons(evidence, settings), evidence.tracked
    agreement = evidence.agreement
    innovation = agreement.ratio if agreement.tried >= ENOUGH_TRIED else None
    finite = bool(np.all(np.isfinite(evidence.cov_v)))
    sigma_v_m_s = float(np.sqrt(max(np.linalg.eigvalsh(evidence.cov_v)[-1], 0.0))) if finite else np.inf
    if evidence.blind_s > settings.max_blind_s:
        return Health(Verdict.LOST, (*reasons, f"nothing seen for {evidence.blind_s:.1f} s"), tracked, innovation)
    if sigma_v_m_s > settings.max_sigma_v_m_s:
        return Health(Verdict.LOST, (*reasons, f"velocity uncertain to {sigma_v_m_s:.2f} m/s"), tracked, innovation)
    if not supports(evidence, settings):
        return Health(Verdict.BLIND, reasons, tracked, innovation)
    return Health(Verdict.DEGRADED if reasons else Verdict.GOOD, reasons, tracked, innovation)


def _reasons(evidence: Evidence, settings: HealthSettings) -> tuple[str, ...]:
    agreement = evidence.agreement
    possible = (
        (evidence.frozen, "the image does not change"),
        (evidence.tracked < settings.few_features, f"few features: {evidence.tracked}"),
        (
            evidence.rejected > max(settings.few_features, evidence.tracked),
            f"features disagree: {evidence.rejected} rejected",
        ),
        (
            agreement.tried >= ENOUGH_TRIED and 2 * agreement.accepted < agreement.tried,
            f"measurements disagree with the motion: {agreement.tried - agreement.accepted} of {agreement.tried}",
        ),
        (
            agreement.tried >= ENOUGH_TRIED and agreement.ratio > settings.max_innovation,
            f"innovations {agreement.ratio:.1f} times the predicted ones",
        ),
        (evidence.imu_gap_s > settings.max_imu_gap_s, f"IMU silent for {evidence.imu_gap_s * 1e3:.0f} ms"),
        (evidence.bad_samples > 0, f"{evidence.bad_samples} IMU samples were late, not numbers or not possible"),
    )
    dead_reckoning = evidence.gait_supports and not supports(evidence, settings)
    return (
        *(words for applies, words in possible if applies),
        *evidence.imu_doubts,
        *evidence.gait_faults,
        *(("dead reckoning on IMU and gait",) if dead_reckoning else ()),
    )


def in_map(health: Health, island: int) -> Health:
    """Return the verdict of a pose in map ``island``: DEGRADED at best while that is not tied to the first map (0)."""

    if island == 0:
        return health
    verdict = Verdict.DEGRADED if health.verdict is Verdict.GOOD else health.verdict
    return replace(health, verdict=verdict, reasons=(NEW_MAP, *health.reasons), map_connected=False)
