"""Angles and rates from a servo's quantised readings: their errors do not accumulate."""

import numpy as np
import pytest

from snakeslam.estimation.gait.joint_history import ANGLE_SIGMA_RAD, OFF_RAD, JointHistory
from snakeslam.messages import Float, JointState

DT_NS = 10_000_000
FRAME_NS = 50_000_000
ANGLE_STEP_RAD = 2.0 * np.pi / 4096.0
RATE_STEP_RAD_S = 0.229 * 2.0 * np.pi / 60.0
PHASES = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)


def angles(t_s: float) -> Float:
    return 0.4 * np.sin(1.6 * t_s + PHASES)


def rates(t_s: float) -> Float:
    return 0.4 * 1.6 * np.cos(1.6 * t_s + PHASES)


def reported(t_ns: int, shift_rad: float = 0.0, rate_scale: float = 1.0) -> JointState:
    t_s = t_ns * 1e-9
    q = np.rint((angles(t_s) + shift_rad) / ANGLE_STEP_RAD) * ANGLE_STEP_RAD
    dq = np.rint(rates(t_s) * rate_scale / RATE_STEP_RAD_S) * RATE_STEP_RAD_S
    return JointState(t_ns, q, dq, np.zeros(len(q)), np.full(len(q), 30.0))


def rotations(end_ns: int, rate_scale: float = 1.0) -> Float:
    """Return the sum of all frames' rates and the true rotation of the joints, from 1 s on, (2, n, N)."""
    history = JointHistory(len(PHASES))
    history.add(reported(0))
    sums, t_ns = [np.zeros(len(PHASES))], 0
    while t_ns < end_ns:
        for k in range(1, FRAME_NS // DT_NS + 1):
            history.add(reported(t_ns + k * DT_NS, rate_scale=rate_scale))
        _, dq = history.mean(t_ns, t_ns + FRAME_NS)
        history.forget_before(t_ns)
        t_ns += FRAME_NS
        sums.append(sums[-1] + dq * FRAME_NS * 1e-9)
    truth = np.array([angles(k * FRAME_NS * 1e-9) - angles(0.0) for k in range(len(sums))])
    return np.stack([np.array(sums), truth])[:, 20:]


def test_the_rates_of_all_frames_sum_up_to_the_joints_rotation() -> None:
    estimated, truth = rotations(20_000_000_000)
    assert np.sqrt(np.mean((estimated - truth) ** 2)) < 1.5 * ANGLE_SIGMA_RAD
    assert np.max(np.abs(estimated - truth)) < 2.0 * ANGLE_STEP_RAD


def test_rates_that_are_reported_too_small_do_not_accumulate_an_error() -> None:
    estimated, truth = rotations(20_000_000_000, rate_scale=0.97)
    assert np.max(np.abs(estimated - truth)) < 3.0 * ANGLE_STEP_RAD


def test_a_rate_is_better_than_the_difference_of_two_angles() -> None:
    history, errors, differences = JointHistory(len(PHASES)), [], []
    for t_ns in range(0, 5_000_000_000, DT_NS):
        history.add(reported(t_ns))
        if t_ns > 1_000_000_000 and t_ns % FRAME_NS == 0:
            truth = (angles(t_ns * 1e-9) - angles((t_ns - FRAME_NS) * 1e-9)) / (FRAME_NS * 1e-9)
            errors.append(history.mean(t_ns - FRAME_NS, t_ns)[1] - truth)
            differences.append((reported(t_ns).q_rad - reported(t_ns - FRAME_NS).q_rad) / (FRAME_NS * 1e-9) - truth)
    assert np.sqrt(np.mean(np.square(errors))) < 0.4 * np.sqrt(np.mean(np.square(differences)))


def test_between_two_states_the_angles_are_interpolated_and_after_the_last_extrapolated() -> None:
    history = JointHistory(len(PHASES))
    for k in range(30):
        history.add(reported(k * DT_NS))
    q, _ = history.mean(20 * DT_NS, 21 * DT_NS)
    np.testing.assert_allclose(q, angles(20.5 * DT_NS * 1e-9), atol=ANGLE_STEP_RAD)
    _, dq = history.mean(29 * DT_NS, 30 * DT_NS)
    np.testing.assert_allclose(dq, reported(29 * DT_NS).dq_rad_s, atol=1e-12)


@pytest.mark.parametrize("gap_ns", [DT_NS, 500_000_000])
def test_angles_that_jump_are_used_as_reported(gap_ns: int) -> None:
    history = JointHistory(len(PHASES))
    for k in range(30):
        history.add(reported(k * DT_NS))
    t_ns, shift_rad = 29 * DT_NS + gap_ns, 1.01 * OFF_RAD + ANGLE_STEP_RAD
    history.add(reported(t_ns, shift_rad))
    q, _ = history.mean(t_ns, t_ns + 1)
    np.testing.assert_allclose(q, reported(t_ns, shift_rad).q_rad, atol=1e-9)
