"""What the estimator says of itself: a verdict for each frame, with its reasons in words."""

from dataclasses import dataclass

import numpy as np

from snakeslam.estimation.settings import HealthSettings
from snakeslam.messages import Float, Health, Verdict


@dataclass(frozen=True, slots=True)
class Evidence:
    """What one frame showed: features in use and rejected, the velocity's covariance (3, 3), faults of the inputs."""

    used: int
    rejected: int
    cov_v: Float
    blind_s: float
    frozen: bool
    imu_gap_s: float
    bad_samples: int


def judge(evidence: Evidence, settings: HealthSettings) -> Health:
    """Return the verdict of a frame.

    BLIND while the camera supports nothing, LOST when that has lasted too long or the velocity's sigma is too large,
    DEGRADED with few features, many rejections or faults of the input.
    """
    sigma_v_m_s = float(np.sqrt(max(np.linalg.eigvalsh(evidence.cov_v)[-1], 0.0)))
    reasons = _reasons(evidence, settings)
    if evidence.blind_s > settings.max_blind_s:
        return Health(Verdict.LOST, (*reasons, f"nothing seen for {evidence.blind_s:.1f} s"), evidence.used)
    if not np.isfinite(sigma_v_m_s) or sigma_v_m_s > settings.max_sigma_v_m_s:
        return Health(Verdict.LOST, (*reasons, f"velocity uncertain to {sigma_v_m_s:.2f} m/s"), evidence.used)
    if evidence.used < settings.min_features or evidence.frozen:
        return Health(Verdict.BLIND, reasons, evidence.used)
    return Health(Verdict.DEGRADED if reasons else Verdict.GOOD, reasons, evidence.used)


def _reasons(evidence: Evidence, settings: HealthSettings) -> tuple[str, ...]:
    reasons: list[str] = []
    if evidence.frozen:
        reasons.append("the picture does not change")
    if evidence.used < settings.few_features:
        reasons.append(f"few features: {evidence.used}")
    if evidence.rejected > max(settings.few_features, evidence.used):
        reasons.append(f"features disagree: {evidence.rejected} rejected")
    if evidence.imu_gap_s > settings.max_imu_gap_s:
        reasons.append(f"IMU silent for {evidence.imu_gap_s * 1e3:.0f} ms")
    if evidence.bad_samples:
        reasons.append(f"{evidence.bad_samples} IMU samples were not numbers")
    return tuple(reasons)
