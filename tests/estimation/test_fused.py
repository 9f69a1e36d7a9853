"""The gait as a sensor: its rows and displacements, its value without a camera, and faulty joint states."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from bench.simulated import RIG, SimulatedFrontend
from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.filter.preintegration import ImuSegments
from snakeslam.estimation.filter.state import CORE, State
from snakeslam.estimation.frontend.tracking import TrackedFeatures
from snakeslam.estimation.gait.joint_history import JointHistory
from snakeslam.estimation.gait.learning import SlipModel
from snakeslam.estimation.gait.measurement import GaitDisplacement, GaitMeasurement
from snakeslam.estimation.gait.odometry import FrictionOdometry, ModelledDisplacement
from snakeslam.estimation.gait.sensor import GaitSensor
from snakeslam.estimation.gait.settings import GaitSensorSettings
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.vio.odometry import VisualInertialOdometry
from snakeslam.gaits.catalogue import GaitName, GaitSettings
from snakeslam.geometry import numeric, so3
from snakeslam.messages import CameraFrame, Float, GaitCommand, JointState, Packet, Verdict
from snakeslam.robot.friction import Sliding, sliding_velocity
from snakeslam.robot.model import PRESETS
from snakeslam.slam import build_estimator
from tests.estimation import wall

MODEL = PRESETS["sim35"]
SETTINGS = EstimatorSettings()
GAIT = GaitSensorSettings()
FRAME_NS = 50_000_000
NOTHING = np.zeros(35)
NO_BIAS = np.zeros((3, 2))
COVERED_S = (2.5, 4.5)
DURATION_S = 5.5


# -- Rows and displacements -------------------------------------------------------------------------------------------


def state(rng: np.random.Generator) -> State:
    """Two clones and a state that has moved on from the second."""
    R = so3.exp(np.array([0.3, -0.2, 1.0]))
    at = State(0, R, np.ones(3), np.array([0.3, -0.1, 0.2]), np.zeros(3), np.zeros(3), np.eye(CORE) * 1e-4)
    at.add_clone()
    at.add_clone()
    at.R_WI, at.p_WI = R @ so3.exp(rng.normal(0, 0.2, 3)), at.p_WI + rng.normal(0, 0.2, 3)
    at.R_fej, at.p_fej = at.R_WI, at.p_WI
    return at


def modelled(
    dp_I: Float,
    v_I: Float,
    sigma_v: float,
    by_log_ratio: Float,
    by_bias: Float = NO_BIAS,
    dq_rad_s: Float = NOTHING,
) -> ModelledDisplacement:
    axes_I = np.column_stack([by_bias / 0.05, np.cross(*by_bias.T / 0.05)]) if by_bias.any() else np.eye(3)
    return ModelledDisplacement(0.05, dp_I, v_I, sigma_v**2 * np.eye(3), by_log_ratio, by_bias, axes_I, dq_rad_s)


def displacement(dp_I: Float, v_I: Float, sigma_v: float = 0.1) -> GaitDisplacement:
    given = modelled(dp_I, v_I, sigma_v, np.zeros(3))
    return GaitDisplacement(given, (sigma_v * 0.05) ** 2 * (np.eye(3) + 0.3 * np.ones((3, 3))))


@pytest.mark.parametrize("before", [0, 1, None])
def test_jacobian_of_the_rows(rng: np.random.Generator, before: int | None) -> None:
    """R_k^T (p - p_k), and R^T v, against a numeric derivative at the first estimates."""
    given = displacement(rng.normal(size=3), rng.normal(size=3))
    moved, start = state(np.random.default_rng(1)), state(np.random.default_rng(1))
    rows = GaitMeasurement.of(given, before)

    def residual(d: Float) -> Float:
        other = state(np.random.default_rng(1))
        other.plus(d)
        return rows.residual(other)

    np.testing.assert_allclose(-rows.jacobian(start), numeric.jacobian(residual, moved.size), atol=1e-5)


def test_rows_do_not_observe_position_and_yaw(rng: np.random.Generator) -> None:
    """A common shift, and a common rotation about z, change no row, at first estimates that differ from the state."""
    at = state(rng)
    at.p_WI, at.R_WI = at.p_WI + 0.01, at.R_WI @ so3.exp(np.full(3, 0.02))
    H = GaitMeasurement.of(displacement(np.zeros(3), np.zeros(3)), 0).jacobian(at)
    up = np.array([0.0, 0.0, 1.0])
    shift, rotation = np.zeros((at.size, 3)), np.zeros(at.size)
    for k, (R, p) in enumerate([(at.R_fej, at.p_fej), *zip(at.clones.R_fej, at.clones.p_fej, strict=True)]):
        start = 0 if k == 0 else at.clone_slice(k - 1).start
        shift[start + 3 : start + 6] = np.eye(3)
        rotation[start : start + 3], rotation[start + 3 : start + 6] = R.T @ up, np.cross(up, p)
    assert np.max(np.abs(H)) > 1.0
    np.testing.assert_allclose(H @ shift, 0.0, atol=1e-9)
    np.testing.assert_allclose(H @ rotation, 0.0, atol=1e-9)


def test_an_unexpected_displacement_is_inflated_then_left_out(rng: np.random.Generator) -> None:
    at = state(rng)
    at.cov *= 1e-6
    expected = GaitMeasurement.of(displacement(np.zeros(3), np.zeros(3)), 1).predicted(at)
    for sigmas, factor in ((1.0, 1.0), (5.0, 2.0), (10.0, 4.0), (20.0, None)):
        rows = GaitMeasurement.of(displacement(expected, np.zeros(3)), 1)
        rows.measured = expected + np.linalg.solve(rows.W, np.array([sigmas, 0.0, 0.0]))
        gated = rows.gated(at, 4.0)
        assert (None if gated is None else round(rows.W[0, 0] / gated.W[0, 0], 6)) == factor, sigmas


def winding(t_s: float) -> JointState:
    phase = 2.0 * np.pi * (np.arange(1, 36) / 20.0 + t_s / 4.0)
    q, dq = (np.where(MODEL.is_yaw, a, 0.0) for a in (0.4 * np.sin(phase), 0.2 * np.pi * np.cos(phase)))
    return JointState(round(t_s * 1e9), MODEL.rest_q_rad + q, dq, NOTHING, NOTHING)


def test_the_velocitys_derivative_by_the_ratio() -> None:
    now = winding(0.7)
    up = np.array([0.0, 0.0, 1.0])

    def velocity(d: Float) -> Float:
        return sliding_velocity(MODEL, now.q_rad, now.dq_rad_s, NOTHING[:3], up, 3.0 * float(np.exp(d[0]))).v_I

    given = sliding_velocity(MODEL, now.q_rad, now.dq_rad_s, NOTHING[:3], up, 3.0).v_D_log_ratio
    assert np.linalg.norm(given) > 0.01
    np.testing.assert_allclose(given, numeric.jacobian(velocity, 1, 0.01)[:, 0], atol=2e-3)


def test_a_displacement_is_the_velocity_integrated_in_the_frame_at_its_start() -> None:
    """Coarse steps agree with fine ones while the head rotates."""
    history = JointHistory(35)
    for k in range(51):
        history.add(winding(0.01 * k))
    rotation = ImuSegments(np.tile([0.1, -0.1, 0.8], (100, 1)), np.zeros((100, 3)), np.full(100, 0.005))
    displacements: list[Float] = []
    for rate_hz in (10.0, 24.0):
        given = FrictionOdometry(MODEL, GaitSensorSettings(rate_hz=rate_hz)).displacement(
            history, 0, 500_000_000, rotation, np.eye(3), 3.0
        )
        assert given is not None
        assert given.dt_s == pytest.approx(0.5)
        displacements.append(given.dp_I)
    assert np.linalg.norm(displacements[1]) > 0.03
    np.testing.assert_allclose(displacements[0], displacements[1], atol=0.004)


def test_stationary_joints_give_no_displacement() -> None:
    history = JointHistory(35)
    for k in range(11):
        history.add(JointState(k * 10_000_000, MODEL.rest_q_rad, NOTHING, NOTHING, NOTHING))
    rotation = ImuSegments(np.zeros((20, 3)), np.zeros((20, 3)), np.full(20, 0.005))
    assert FrictionOdometry(MODEL, GAIT).displacement(history, 0, 100_000_000, rotation, np.eye(3), 3.0) is None


def test_a_clock_that_jumps() -> None:
    """One stamp far ahead makes the next ones late; after ten of them the history continues with theirs."""
    history = JointHistory(35)
    for t_s in (0.1, 0.11, 500.0, *(0.12 + 0.01 * k for k in range(20))):
        history.add(winding(t_s))
    assert history.pop_bad_count() == 9
    assert history.covers(230_000_000, 310_000_000)
    assert not history.covers(100_000_000, 310_000_000)


@pytest.mark.parametrize("sigmas", [(0.3, 0.3, 0.3), (3.0, 3.0, 3.0), (0.3, 1.0, 3.0)])
def test_ratio_and_error_are_learnt(rng: np.random.Generator, sigmas: tuple[float, ...]) -> None:
    """Displacements on a ground of ratio 6 with errors of so many sigmas along each axis, beside an exact filter."""
    slip = SlipModel(GAIT)
    wrong = float(np.log(6.0 / 3.0))
    for _ in range(400):
        J = rng.normal(0, 0.005, 3)
        given = modelled((slip.log_ratio - np.log(3.0)) * J, np.zeros(3), 0.01, J)
        slip.learn(given, wrong * J + rng.normal(0, np.array(sigmas) * 0.01 * 0.05), 1e-10 * np.eye(3))
    assert slip.ratio == pytest.approx(6.0, rel=0.15)
    assert slip.scale == pytest.approx(np.array(sigmas), rel=0.4)
    held = SlipModel(GaitSensorSettings(ratio_sigma=0.0))
    held.learn(modelled(np.zeros(3), np.zeros(3), 0.01, np.ones(3)), np.full(3, 0.01), np.eye(3))
    assert held.ratio == pytest.approx(3.0)


def test_a_bias_of_the_velocity_is_learnt_and_removed(rng: np.random.Generator) -> None:
    """10 mm/s less ahead and 5 mm/s more to the left than modelled, in a rotating head; not estimated with sigma 0."""
    wrong = np.array([-0.01, 0.005])
    for sigma in (0.01, 0.0):
        slip = SlipModel(GaitSensorSettings(bias_sigma_m_s=sigma))
        for k in range(400):
            heading = so3.from_yaw(0.02 * k)[:, :2]
            raw = modelled(rng.normal(0, 0.01, 3), rng.normal(0, 0.1, 3), 0.01, np.zeros(3), 0.05 * heading)
            given = slip.corrected(raw)
            np.testing.assert_allclose(given.v_I - raw.v_I, heading @ slip.bias_m_s, atol=1e-12)
            moved_I = raw.dp_I + 0.05 * heading @ wrong + rng.normal(0, 0.01 * 0.05, 3)
            slip.learn(given, moved_I, 1e-10 * np.eye(3))
        np.testing.assert_allclose(slip.bias_m_s, wrong if sigma else 0.0, atol=0.002)


def test_a_periodic_bias_is_learnt_and_removed(rng: np.random.Generator) -> None:
    """30 mm/s to the left, a third of a period behind the joint rates of a crawl; not estimated with sigma 0."""
    ahead = 0.05 * np.eye(3)[:, :2]
    left: dict[float, list[float]] = {}
    for sigma in (0.05, 0.0):
        slip = SlipModel(GaitSensorSettings(wave_sigma_m_s=sigma))
        for k in range(400):
            t_s = 0.05 * k
            wrong = np.array([0.0, 0.03 * np.cos(2.0 * np.pi * (t_s / 4.0 - 1.0 / 3.0))])
            raw = modelled(np.zeros(3), np.zeros(3), 0.03, np.zeros(3), ahead, winding(t_s).dq_rad_s)
            slip.update_phase(raw)
            given = slip.corrected(raw)
            moved_I = ahead @ wrong
            left.setdefault(sigma, []).append(float(np.linalg.norm(given.dp_I - moved_I)) / 0.05)
            slip.learn(given, moved_I + rng.normal(0, 0.005 * 0.05, 3), 1e-10 * np.eye(3))
    assert np.max(left[0.0][-80:]) > 0.025
    assert np.max(left[0.05][-80:]) < 0.005


def test_half_a_period_predicts_the_other_half_by_its_mirror_image(rng: np.random.Generator) -> None:
    """20 mm/s ahead, twice in a period, 30 mm/s to the left, once: learnt over 2.5 of 4 s, predicted in the rest."""
    ahead, slip, left = 0.05 * np.eye(3)[:, :2], SlipModel(GAIT), []
    for k in range(80):
        phi = 2.0 * np.pi * 0.05 * k / 4.0
        wrong = np.array([0.02 * np.cos(2.0 * phi - 1.0), 0.03 * np.cos(phi - 2.0)])
        raw = modelled(np.zeros(3), np.zeros(3), 0.03, np.zeros(3), ahead, winding(0.05 * k).dq_rad_s)
        slip.update_phase(raw)
        given = slip.corrected(raw)
        if k < 50:
            slip.learn(given, ahead @ wrong + rng.normal(0, 0.001 * 0.05, 3), 1e-10 * np.eye(3))
        else:
            left.append(np.abs(given.dp_I - ahead @ wrong) / 0.05)
    assert np.max(left) < 0.01


@pytest.mark.parametrize(("moving", "verdict"), [(True, Verdict.BLIND), (False, Verdict.DEGRADED)])
def test_a_head_on_moving_joints_is_not_stationary(moving: bool, verdict: Verdict) -> None:
    """Image and IMU of a stationary head, then an image that freezes: only with stationary joints it is held."""
    odometry = VisualInertialOdometry(SETTINGS, wall.RIG, 0, gait=GaitSensor(MODEL, GAIT))
    shown: CameraFrame | None = None
    estimates: list[FrameEstimate | None] = []
    for packet in wall.Wall(stationary=True).packets(2.0):
        given = packet
        if isinstance(packet, CameraFrame):
            shown = packet if packet.t_ns < 1_500_000_000 or shown is None else replace(shown, t_ns=packet.t_ns)
            given = shown
        elif packet.t_ns % 10_000_000 == 0:
            now = winding(packet.t_ns / 1e9)
            odometry.process(now if moving else replace(now, q_rad=MODEL.rest_q_rad, dq_rad_s=NOTHING))
        estimates.append(odometry.process(given))
    last = estimates[-1]
    assert last is not None
    assert last.health.verdict is verdict, last.health.reasons
    assert ("dead reckoning on IMU and gait" in last.health.reasons) is moving


# -- A simulated crawl ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Crawl:
    """Sensor packets of a simulated robot and its true poses over time; also a head for ``SimulatedFrontend``."""

    packets: tuple[Packet, ...]
    rig: SensorRig
    t_s: Float
    T_WI: Float
    seed: int = 0
    tracks: int = 80
    depth: bool = True

    def pose(self, t_s: Float) -> tuple[Float, Float]:
        at = np.clip(np.searchsorted(self.t_s, t_s - 1e-6), 0, len(self.t_s) - 1)
        return self.T_WI[at, :3, :3], self.T_WI[at, :3, 3]


def crawl(name: GaitName) -> Crawl:
    """Physics, IMU and servos as in a run; frames are empty, their features come from a simulated front-end."""
    pytest.importorskip("pybullet")
    from snakeslam.backends.sim.backend import SimBackend
    from snakeslam.backends.sim.settings import SimSettings
    from snakeslam.control import Control
    from snakeslam.head.settings import HeadSettings

    backend = SimBackend(MODEL, SimSettings(), seed=1, camera="none")
    control = Control(MODEL, GaitSettings(name=name), HeadSettings(controller="none"))
    packets: list[Packet] = []
    try:
        while backend.t_ns < DURATION_S * 1e9:
            if backend.t_ns == 500_000_000:
                control.command(GaitCommand(backend.t_ns, name))
            packets += backend.step(control.step(backend.t_ns, None, None, None))
            if backend.t_ns % FRAME_NS == 0:
                packets.append(CameraFrame(backend.t_ns, backend.t_ns // FRAME_NS, np.zeros((2, 2), np.uint8)))
        truth = backend.read_ground_truth()
        rig = RIG.model_copy(update={"imu0": backend.rig.imu0})
    finally:
        backend.close()
    t_s, T_WI = np.array([one.t_ns for one in truth]) / 1e9, np.array([one.T_WI for one in truth])
    return Crawl(tuple(packets), rig, t_s, T_WI)


@pytest.fixture(scope="module")
def serpentine() -> Crawl:
    return crawl("serpentine")


@pytest.fixture(scope="module")
def rolling() -> Crawl:
    return crawl("arc_rolling")


class Covered(SimulatedFrontend):
    """A camera that is covered for a while, or repeats the same image."""

    def __init__(self, head: Crawl, noise: NoiseSettings, between_s: tuple[float, float], freeze: bool = False) -> None:
        super().__init__(head, noise)
        self._between_s, self._freeze = between_s, freeze
        self._shown: TrackedFeatures | None = None

    def process(self, frame: CameraFrame, T_C1C0: Float, doubted: bool = False) -> TrackedFeatures:
        if not self._between_s[0] <= frame.t_ns / 1e9 < self._between_s[1]:
            self._shown = super().process(frame, T_C1C0, doubted)
            return self._shown
        if self._freeze and self._shown is not None:
            return replace(self._shown, frozen=True)
        self._follow(np.zeros(len(self._points_W), bool))
        px, ids = np.empty((0, 2), np.float32), np.empty(0, np.int64)
        return TrackedFeatures(px, ids, np.empty((0, 2)), np.empty(0), px, ids, None, False, 0)


def follow(
    crawled: Crawl,
    fused: bool,
    spoil: Callable[[Packet], Packet | None] = lambda packet: packet,
    between_s: tuple[float, float] = COVERED_S,
    freeze: bool = False,
    aid: GaitSensor | None = None,
) -> list[FrameEstimate]:
    aid = (aid or GaitSensor(MODEL, GAIT)) if fused else None
    frontend = Covered(crawled, SETTINGS.noise, between_s, freeze)
    odometry = VisualInertialOdometry(SETTINGS, crawled.rig, 0, frontend, aid)
    packets = (spoil(packet) for packet in crawled.packets)
    return [e for e in (odometry.process(p) for p in packets if p is not None) if e is not None]


def errors(crawled: Crawl, estimates: list[FrameEstimate]) -> Iterator[tuple[float, Float, Float]]:
    """Yield time, position error (3,) and its covariance of each pose, aligned at the first pose."""
    poses = [e.pose for e in estimates if e.pose is not None]
    R, p = crawled.pose(np.array([pose.t_ns for pose in poses]) / 1e9)
    alignment = so3.from_yaw(float(so3.yaw(poses[0].T_WI[:3, :3]) - so3.yaw(R[0])))
    for k, pose in enumerate(poses):
        true = alignment @ (p[k] - p[0]) + poses[0].T_WI[:3, 3]
        yield pose.t_ns / 1e9, true - pose.T_WI[:3, 3], pose.cov[3:6, 3:6]


def grown(crawled: Crawl, estimates: list[FrameEstimate]) -> float:
    """Growth of the error while the camera was covered, m."""
    at = {round(t_s, 3): e for t_s, e, _ in errors(crawled, estimates)}
    return float(np.linalg.norm(at[COVERED_S[1] - 0.05] - at[COVERED_S[0] - 0.05]))


@pytest.mark.parametrize("freeze", [False, True], ids=["covered", "frozen"])
def test_without_a_camera_the_gait_bounds_the_error(serpentine: Crawl, freeze: bool) -> None:
    """Two seconds: the error grows by at most 5 % of the path, and by less than half of that without the gait."""
    with_gait, without = (follow(serpentine, fused, freeze=freeze) for fused in (True, False))
    _, p = serpentine.pose(np.arange(*COVERED_S, 0.05))
    gone_m = float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum())
    assert gone_m > 0.2
    assert grown(serpentine, with_gait) < 0.05 * gone_m
    assert grown(serpentine, with_gait) < 0.5 * grown(serpentine, without)
    blind = [e for e in with_gait if COVERED_S[0] <= e.t_ns / 1e9 < COVERED_S[1]]
    assert all(e.health.verdict is Verdict.BLIND for e in blind)
    assert all("dead reckoning on IMU and gait" in e.health.reasons for e in blind)
    assert with_gait[-1].health.verdict is Verdict.GOOD
    assert not any("reset" in e.events for e in with_gait)
    nees = [float(e @ np.linalg.solve(P, e)) for t, e, P in errors(serpentine, with_gait) if t > 0.5]
    assert np.mean(nees) < 6.0


def test_a_rolling_body_does_not_drift_upwards(rolling: Crawl, monkeypatch: pytest.MonkeyPatch) -> None:
    """Coarse joint rates lift the balance of friction by 8 mm/s where contacts come and go; the height bounds it."""

    def lifted(*args: Any) -> Sliding:
        sliding = sliding_velocity(*args)
        return replace(sliding, v_I=sliding.v_I + 0.008 * sliding.ground.normal_I)

    def risen_m() -> float:
        at = {round(t_s, 3): e for t_s, e, _ in errors(rolling, follow(rolling, True))}
        return float(abs(at[COVERED_S[1] - 0.05] - at[COVERED_S[0] - 0.05])[2])

    monkeypatch.setattr("snakeslam.estimation.gait.odometry.sliding_velocity", lifted)
    held_m = risen_m()
    assert held_m < 0.01
    monkeypatch.setattr("snakeslam.estimation.gait.odometry.HEIGHT_TIME_S", 1e9)
    assert held_m < 0.6 * risen_m()


def test_with_a_camera_it_does_no_harm(serpentine: Crawl) -> None:
    rms = [
        float(np.sqrt(np.mean([e @ e for _, e, _ in errors(serpentine, follow(serpentine, fused, between_s=(9, 9)))])))
        for fused in (True, False)
    ]
    assert rms[0] < 1.1 * rms[1]


def test_the_friction_ratio_is_estimated(serpentine: Crawl) -> None:
    """Of a ground of ratio 3, from 1.2 and from 8; the wrong start does no harm."""
    for start in (1.2, 8.0):
        aid = GaitSensor(MODEL, GaitSensorSettings(friction_ratio=start))
        estimates = follow(serpentine, True, between_s=(9, 9), aid=aid)
        assert aid.slip.ratio == pytest.approx(3.0, rel=0.35)
        assert max(float(np.linalg.norm(e)) for _, e, _ in errors(serpentine, estimates)) < 0.03


def bad_joints(kind: str) -> Callable[[Packet], Packet | None]:
    held: list[JointState] = []

    def spoil(packet: Packet) -> Packet | None:
        if not isinstance(packet, JointState) or packet.t_ns < 1_500_000_000:
            return packet
        held.append(packet)
        q, dq = packet.q_rad, packet.dq_rad_s
        return {
            "none": None,
            "not numbers": replace(packet, q_rad=np.full(35, np.nan)),
            "another robot's": replace(packet, q_rad=q[:24], dq_rad_s=dq[:24]),
            "stuck": replace(packet, q_rad=held[0].q_rad, dq_rad_s=2.0 * held[0].dq_rad_s),
            "wrong": replace(packet, q_rad=-q[::-1], dq_rad_s=-3.0 * dq[::-1]),
            "frozen at rest": replace(packet, q_rad=held[0].q_rad, dq_rad_s=NOTHING),
        }[kind]

    return spoil


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("none", "no joint states for"),
        ("not numbers", "joint states were late, not numbers"),
        ("another robot's", "of another robot"),
        ("stuck", "do not follow their rates"),
        ("wrong", ""),
        ("frozen at rest", ""),
    ],
)
def test_faulty_joint_states_do_no_harm_and_are_reported(serpentine: Crawl, kind: str, words: str) -> None:
    estimates = follow(serpentine, True, bad_joints(kind), between_s=(9, 9))
    after = [e for e in estimates if e.t_ns > 1_800_000_000]
    assert all(e.pose is not None and e.health.verdict.tracked for e in after)
    assert not any("reset" in e.events for e in estimates)
    assert max(float(np.linalg.norm(e)) for _, e, _ in errors(serpentine, estimates)) < 0.03
    if words:
        assert all(e.health.verdict is Verdict.DEGRADED for e in after)
        assert all(any(words in reason for reason in e.health.reasons) for e in after)


def test_without_joints_it_is_vio(serpentine: Crawl) -> None:
    """The very same poses, and the verdict says why."""
    alone = follow(serpentine, False)
    without = follow(serpentine, True, lambda p: None if isinstance(p, JointState) else p)
    for a, b in zip(alone, without, strict=True):
        assert (a.pose is None) == (b.pose is None)
        if a.pose is not None and b.pose is not None:
            np.testing.assert_array_equal(a.pose.T_WI, b.pose.T_WI)
    assert any("no joint states" in reason for reason in without[-1].health.reasons)


def test_same_packets_same_bytes(serpentine: Crawl) -> None:
    once, again = (follow(serpentine, True)[-1].pose for _ in range(2))
    assert once is not None
    assert again is not None
    assert once.T_WI.tobytes() == again.T_WI.tobytes()


def test_it_needs_joints_and_an_imu() -> None:
    settings = EstimatorSettings(mode="fused")
    with pytest.raises(InputError, match=r"'fused' needs a robot's joints.*\(allowed: visual, vio\)"):
        build_estimator(settings, RIG, 0, None)
    with pytest.raises(InputError, match=r"'fused' needs an IMU.*\(allowed: visual\)"):
        build_estimator(settings, RIG.model_copy(update={"imu0": None}), 0, MODEL)
    assert isinstance(build_estimator(settings, RIG, 0, MODEL), VisualInertialOdometry)
