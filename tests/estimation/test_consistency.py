"""Consistency of the covariance: NEES over seeds on simulated measurements (3 for three exact errors)."""

import numpy as np

from bench.simulated import SETTINGS, SwingingHead, run


def test_nees_over_seeds() -> None:
    """A few short runs, so wide bounds; ``python -m bench consistency`` has 50 seeds and the tight ones."""
    results = [run(SwingingHead(seed=seed, duration_s=4.0, tracks=80)) for seed in range(8)]
    position = np.mean([result.nees_p.mean() for result in results])
    orientation = np.mean([result.nees_theta.mean() for result in results])
    assert 1.2 < position < 5.0
    assert 1.2 < orientation < 5.0
    assert np.sqrt(np.mean([np.sum(result.e_p**2, axis=1).mean() for result in results])) < 0.015


def test_yaw_is_not_learnt_from_nothing() -> None:
    """Yaw is not observable: its variance never falls while the head swings (first-estimates Jacobians).

    Only in the first window may it fall: its features measure the yaw since the first pose, where that is zero.
    """
    head = SwingingHead(seed=3, duration_s=5.0, tracks=80)
    result = run(head)
    R, _ = head.pose(result.t_s)
    up_I = R[:, 2]
    variance = np.einsum("ni,nij,nj->n", up_I, result.cov[:, :3, :3], up_I)
    assert variance[-1] > variance[len(variance) // 3] > variance[2]
    variance = variance[SETTINGS.window.clones :]
    lowest_ahead = np.minimum.accumulate(variance[::-1])[::-1]
    assert np.all(lowest_ahead > 0.9 * variance)
