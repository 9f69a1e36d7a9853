"""What the estimator says of itself: a verdict for each frame, with its reasons in words."""

from dataclasses import dataclass, replace

import numpy as np

from snakeslam.estimation.filter.gating import Agreement
from snakeslam.estimation.health_settings import HealthSettings
from snakeslam.messages import Float, Health, Verdict

ENOUGH_TRIED = 5
NEW_MAP, TIED = "new map, not connected to the old one", "tied to the old map again"
"""Events; the first is a reason as well, for as long as it is so."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What one frame showed: features followed into it and rejected, how measurements agree, faults of the inputs.

    ``cov_v`` (3, 3) is the velocity's covariance, ``blind_s`` the time since a frame last supported the state,
    ``resting`` that picture and IMU both say that nothing moves, ``gait_holds`` that the gait's way was taken;
    ``gait_faults`` are its faults in words.
    """

    followed: int
    rejected: int
    agreement: Agreement
    cov_v: Float
    blind_s: float
    frozen: bool
    resting: bool
    imu_gap_s: float
    bad_samples: int
    gait_holds: bool = False
    gait_faults: tuple[str, ...] = ()
    imu_doubts: tuple[str, ...] = ()
    """Which samples of the IMU are doubted since the frame before, in words."""


def supports(evidence: Evidence, settings: HealthSettings) -> bool:
    """Return whether a frame holds the state: enough is followed, and not all of it contradicts.

    After an IMU gap of ``max_blind_s`` (a clock set anew) nothing does: a state reckoned over so long is not corrected.
    """
    if evidence.imu_gap_s > settings.max_blind_s:
        return False
    agreement = evidence.agreement
    contradicts = agreement.tried >= ENOUGH_TRIED and agreement.accepted < settings.min_features
    seen = evidence.followed >= settings.min_features and not evidence.frozen and not contradicts
    return seen or evidence.resting


def judge(evidence: Evidence, settings: HealthSettings) -> Health:
    """Return the verdict of a frame.

    BLIND while the camera supports nothing, LOST when that has lasted too long or the velocity's sigma is too large,
    DEGRADED with few features, many rejections, innovations beyond what is foreseen or faults of the input.
    """
    reasons, followed = _reasons(evidence, settings), evidence.followed
    agreement = evidence.agreement
    innovation = agreement.ratio if agreement.tried >= ENOUGH_TRIED else None
    finite = bool(np.all(np.isfinite(evidence.cov_v)))
    sigma_v_m_s = float(np.sqrt(max(np.linalg.eigvalsh(evidence.cov_v)[-1], 0.0))) if finite else np.inf
    if evidence.blind_s > settings.max_blind_s:
        return Health(Verdict.LOST, (*reasons, f"nothing seen for {evidence.blind_s:.1f} s"), followed, innovation)
    if sigma_v_m_s > settings.max_sigma_v_m_s:
        return Health(Verdict.LOST, (*reasons, f"velocity uncertain to {sigma_v_m_s:.2f} m/s"), followed, innovation)
    if not supports(evidence, settings):
        return Health(Verdict.BLIND, reasons, followed, innovation)
    return Health(Verdict.DEGRADED if reasons else Verdict.GOOD, reasons, followed, innovation)


def _reasons(evidence: Evidence, settings: HealthSettings) -> tuple[str, ...]:
    agreement = evidence.agreement
    said = (
        (evidence.frozen, "the picture does not change"),
        (evidence.followed < settings.few_features, f"few features: {evidence.followed}"),
        (
            evidence.rejected > max(settings.few_features, evidence.followed),
            f"features disagree: {evidence.rejected} rejected",
        ),
        (
            agreement.tried >= ENOUGH_TRIED and 2 * agreement.accepted < agreement.tried,
            f"measurements disagree with the motion: {agreement.tried - agreement.accepted} of {agreement.tried}",
        ),
        (
            agreement.tried >= ENOUGH_TRIED and agreement.ratio > settings.max_innovation,
            f"innovations {agreement.ratio:.1f} times what is foreseen",
        ),
        (evidence.imu_gap_s > settings.max_imu_gap_s, f"IMU silent for {evidence.imu_gap_s * 1e3:.0f} ms"),
        (evidence.bad_samples > 0, f"{evidence.bad_samples} IMU samples were late, not numbers or not possible"),
    )
    reckons = evidence.gait_holds and not supports(evidence, settings)
    return (
        *(words for holds, words in said if holds),
        *evidence.imu_doubts,
        *evidence.gait_faults,
        *(("dead reckoning on IMU and gait",) if reckons else ()),
    )


def in_map(health: Health, island: int) -> Health:
    """Return the verdict of a pose in map ``island``: one that nothing ties to the first map (0) is never good."""
    if island == 0:
        return health
    verdict = Verdict.DEGRADED if health.verdict is Verdict.GOOD else health.verdict
    return replace(health, verdict=verdict, reasons=(NEW_MAP, *health.reasons), map_connected=False)
