"""Verdicts from evidence."""

from dataclasses import replace

import numpy as np
import pytest

from snakeslam.estimation.filter.gating import Agreement, Innovation
from snakeslam.estimation.health import Evidence, judge, supports
from snakeslam.estimation.health_settings import HealthSettings
from snakeslam.messages import Verdict

FINE = Evidence(100, 3, Agreement(60, 58, 0.9), np.eye(3) * 1e-4, 0.0, False, False, 0.005, 0)
SETTINGS = HealthSettings()


def test_all_well() -> None:
    assert judge(FINE, SETTINGS).verdict is Verdict.GOOD
    assert judge(FINE, SETTINGS).reasons == ()


@pytest.mark.parametrize(
    ("change", "verdict", "words"),
    [
        ({"tracked": 8}, Verdict.DEGRADED, "few features"),
        ({"tracked": 2}, Verdict.BLIND, "few features"),
        ({"agreement": Agreement(60, 55, 4.0)}, Verdict.DEGRADED, "4.0 times the predicted ones"),
        ({"agreement": Agreement(60, 20, 0.9)}, Verdict.DEGRADED, "40 of 60"),
        ({"agreement": Agreement(60, 0, 50.0)}, Verdict.BLIND, "60 of 60"),
        ({"frozen": True}, Verdict.BLIND, "does not change"),
        ({"frozen": True, "stationary": True}, Verdict.DEGRADED, "does not change"),
        ({"blind_s": 3.5}, Verdict.LOST, "nothing seen for 3.5 s"),
        ({"cov_v": np.eye(3)}, Verdict.LOST, "velocity uncertain"),
        ({"cov_v": np.full((3, 3), np.nan)}, Verdict.LOST, "velocity uncertain"),
        ({"imu_gap_s": 0.2}, Verdict.DEGRADED, "IMU silent for 200 ms"),
        ({"bad_samples": 2}, Verdict.DEGRADED, "2 IMU samples"),
    ],
)
def test_trouble_is_reported(change: dict, verdict: Verdict, words: str) -> None:
    health = judge(replace(FINE, **change), SETTINGS)
    assert health.verdict is verdict
    assert any(words in reason for reason in health.reasons), health.reasons


def test_a_stationary_head_is_supported_without_a_camera() -> None:
    dark = replace(FINE, tracked=0, agreement=Agreement(0, 0, 0.0))
    assert not supports(dark, SETTINGS)
    assert supports(replace(dark, stationary=True), SETTINGS)


def test_innovations_of_exact_covariance_are_about_one(rng: np.random.Generator) -> None:
    """d^2 = r^T S^-1 r has the freedom of its rows; 1 % lies outside of the gate."""
    root = rng.normal(0, 1, (4, 4))
    r = rng.normal(0, 1, (4000, 4)) @ np.linalg.cholesky(root @ root.T + np.eye(4)).T
    innovation = Innovation.of(r, np.tile(root @ root.T, (4000, 1, 1)), np.full(4000, 4))
    assert innovation.distance.mean() == pytest.approx(4.0, abs=0.2)
    assert 1.0 - innovation.accepted.mean() == pytest.approx(0.01, abs=0.005)
    assert Agreement.of([innovation]).ratio == pytest.approx(0.84, abs=0.05)
