"""The paper's planar filter, Eq. (37)-(41): its formulas; poses that drift, are missing, or start anew."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.planar.dead_reckoning import GaitDeadReckoning
from snakeslam.estimation.planar.motion import BodyShape, GaitMotionModel, rotation
from snakeslam.estimation.planar.odometry import PlanarOdometry
from snakeslam.estimation.planar.poses import plane_pose, with_plane_pose
from snakeslam.estimation.planar.state import (
    ControlInput,
    PlanarState,
    move,
    observation_jacobian,
    observe,
    transition,
    wrapped,
)
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.gaits.catalogue import GaitName, GaitSettings, resolve
from snakeslam.gaits.parametric import joint_angles, joint_slopes
from snakeslam.gaits.posture import posed_angles
from snakeslam.geometry import se3, so3
from snakeslam.geometry.numeric import jacobian
from snakeslam.messages import CameraFrame, Float, Health, JointState, Packet, PoseEstimate, Verdict
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import PRESETS
from snakeslam.slam import build_estimator
from tests.estimation.wall import RIG

MODEL = PRESETS["sim35"]
SETTINGS = EstimatorSettings()
GAIT = GaitMotionModel(MODEL, 3.0, "fan")
SHAPE = BodyShape(np.array([1.3, 0.2]), 0.4)
STEP_NS, FRAME_EVERY = 10_000_000, 5
REST_S = 0.5
IMAGE = np.zeros((4, 4), np.uint8)


def motion(keep: float = 0.9) -> ControlInput:
    return ControlInput(0.11, 0.3, 0.09, 0.25, 0.2, keep, 0.03, 0.05, 0.01)


# -- Formulas ---------------------------------------------------------------------------------------------------------


def test_the_motion_is_the_papers() -> None:
    """Eq. (37), Eq. (38): p += v dt (cos, sin), theta += omega dt, v and omega from the motion model."""
    x = np.array([1.0, 2.0, 0.5, 7.0, 8.0])
    u = ControlInput(0.2, 0.4, 0.0, 0.0, 0.0, 0.0, 0.03, 0.05, 0.01)
    middle = 0.5 + 0.4 * 0.1 / 2
    expected = [1.0 + 0.02 * np.cos(middle), 2.0 + 0.02 * np.sin(middle), 0.54, 0.2, 0.4]
    np.testing.assert_allclose(move(x, u, 0.1), expected)
    kept = move(np.array([0, 0, 0, 0.05, 0.35]), motion(keep=1.0), 0.1)
    np.testing.assert_allclose(
        kept[3:], [0.07, 0.4], err_msg="what the state knew better stays, the model's change adds"
    )


@pytest.mark.parametrize("keep", [0.0, 0.7, 1.0])
def test_jacobians(rng: np.random.Generator, keep: float) -> None:
    """F and G of Eq. (40), H of Eq. (39), against numeric derivatives."""
    x = rng.normal(size=5)
    F, G = transition(x, motion(keep), 0.05)
    np.testing.assert_allclose(F, jacobian(lambda d: move(x + d, motion(keep), 0.05), 5), atol=1e-8)

    def disturbed(w: Float) -> Float:
        u = motion(keep)
        moved = move(x, ControlInput(u.speed + w[0], u.omega + w[1], *(0.0, 0.0), u.direction_rad, 0.0, 0, 0, 0), 0.05)
        at = move(x, ControlInput(u.speed, u.omega, 0.0, 0.0, u.direction_rad, 0.0, 0, 0, 0), 0.05)
        direction = x[2] + 0.5 * u.omega * 0.05 + u.direction_rad
        across = w[2] * 0.05 * np.array([-np.sin(direction), np.cos(direction), 0, 0, 0])
        return moved - at + across

    if keep == 0.0:
        np.testing.assert_allclose(G, jacobian(disturbed, 3), atol=1e-8)
    np.testing.assert_allclose(observation_jacobian(x, SHAPE), jacobian(lambda d: observe(x + d, SHAPE), 5), atol=1e-8)


def test_the_prediction_adds_the_errors_of_the_model(rng: np.random.Generator) -> None:
    """Eq. (40): F P F^T + G Q G^T, and the same growth whether a second is predicted in 10 steps or in 100."""
    grown: list[Float] = []
    for count in (10, 100):
        state = PlanarState(np.zeros(5), np.diag([0, 0, 0, 9e-4, 2.5e-3]))
        for _ in range(count):
            keep = float(np.exp(-1.0 / count))
            state.predict(ControlInput(0.1, 0.0, 0.1, 0.0, 0.0, keep, 0.03, 0.05, 0.01), 1.0 / count, 1.0)
        grown.append(state.cov)
    np.testing.assert_allclose(np.diag(grown[0]), np.diag(grown[1]), rtol=0.25)
    assert np.diag(grown[1])[3] == pytest.approx(9e-4, rel=0.05), "the speed's error stays what it is"


def random_cov(rng: np.random.Generator, size: int, scale: float) -> Float:
    A = rng.normal(size=(size, size)) * scale
    return A @ A.T + scale**2 * np.eye(size)


def test_one_iteration_is_the_kalman_filter(rng: np.random.Generator) -> None:
    """Eq. (41) as printed."""
    P, R, x, z = random_cov(rng, 5, 0.1), random_cov(rng, 3, 0.01), rng.normal(size=5), rng.normal(size=3)
    z = observe(x, SHAPE) + 0.01 * z
    H = observation_jacobian(x, SHAPE)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    state = PlanarState(x, P)
    assert state.update(z, R, SHAPE, 1) == 1
    np.testing.assert_allclose(state.x, x + K @ (z - observe(x, SHAPE)), atol=1e-10)
    H1 = observation_jacobian(state.x, SHAPE)
    K1 = P @ H1.T @ np.linalg.inv(H1 @ P @ H1.T + R)
    np.testing.assert_allclose(state.cov, (np.eye(5) - K1 @ H1) @ P, atol=1e-10)


def test_iterations_find_the_most_probable_state(rng: np.random.Generator) -> None:
    """Eq. (41) with its iteration: the lever of the head makes h nonlinear, one iteration misses the least cost."""
    P, R = np.diag([0.01, 0.01, 0.5, 0.01, 0.01]), np.diag([1e-4, 1e-4, 1.0])
    x = np.zeros(5)
    z = observe(np.array([0.02, -0.03, 0.6, 0.0, 0.0]), SHAPE)

    def cost(y: Float) -> float:
        d, r = y - x, wrapped(z - observe(y, SHAPE))
        return float(d @ np.linalg.solve(P, d) + r @ np.linalg.solve(R, r))

    costs: list[float] = []
    for rounds in (1, 10):
        state = PlanarState(x, P)
        assert state.update(z, R, SHAPE, rounds) <= rounds
        costs.append(cost(state.x))
    assert costs[1] < 0.9 * costs[0]
    gradient = jacobian(lambda d: np.array([cost(state.x + d)]), 5)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-3 * costs[1] + 1e-4)


def test_a_yaw_difference_over_pi_is_wrapped() -> None:
    state = PlanarState(np.array([0, 0, np.pi - 0.01, 0, 0]), np.diag([1e-4] * 5))
    z = observe(np.array([0, 0, np.pi + 0.01, 0, 0]), SHAPE)
    z[2] -= 2 * np.pi
    state.update(z, np.diag([1e-6] * 3), SHAPE, 3)
    assert state.x[2] == pytest.approx(np.pi + 0.01, abs=1e-3)


# -- Shape and motion from joints --------------------------------------------------------------------------------------


def joints(name: GaitName, t_s: float, raised: bool = False) -> JointState:
    """The gait's joints; stationary in its first posture until REST_S."""
    gait = resolve(GaitSettings(name=name), MODEL)
    moving = t_s > REST_S
    sigma = gait.start_sigma + gait.omega * max(0.0, t_s - REST_S)
    angles, slopes = (
        posed_angles(gait, MODEL, sigma)
        if raised
        else (joint_angles(gait.shape, 35, sigma), joint_slopes(gait.shape, 35, sigma))
    )
    nothing = np.zeros(35)
    return JointState(round(t_s * 1e9), angles, slopes * gait.omega * moving, nothing, nothing)


def test_the_gait_is_known_by_its_joints() -> None:
    for name, known in (("serpentine", True), ("arc_rolling", True), ("sidewinding", False), ("pedal", False)):
        times = np.linspace(REST_S + 0.01, REST_S + 4.0, 40)
        found = [GAIT.twist_V(s.q_rad, s.dq_rad_s) is not None for s in (joints(name, t, True) for t in times)]
        assert all(found) if known else not any(found), name


def test_arc_rolling_moves_to_the_right_at_the_fans_speed() -> None:
    for t_s in np.linspace(REST_S + 0.01, REST_S + 4.0, 20):
        state = joints("arc_rolling", t_s, raised=True)
        twist = GAIT.twist_V(state.q_rad, state.dq_rad_s)
        assert twist is not None
        assert 0.03 < -twist.v[1] < 0.0503
        assert (twist.v[0], twist.omega) == (0.0, 0.0)


@pytest.mark.parametrize("name", ["serpentine", "arc_rolling"])
def test_the_attitude_of_a_flat_body(name: GaitName) -> None:
    for t_s in np.linspace(REST_S + 0.01, REST_S + 4.0, 9):
        q_rad = joints(name, t_s).q_rad
        Ts = link_poses_from_imu(MODEL, q_rad, se3.from_rt(GAIT.level_attitude(q_rad), np.zeros(3)))
        assert np.ptp(Ts[:, 2, 3]) < 0.1, "level to the half of one joint's bend"
        assert np.ptp(Ts[:, :2, 3], axis=0).max() > 1.0


def test_the_head_on_the_body() -> None:
    """Straight: half the body ahead of the centre, along the mean heading; its yaw in the world has no effect."""
    q = np.zeros(35)
    ahead_m = 17.5 * MODEL.joint_length_m + float((MODEL.T_HI[:3, 3] - MODEL.com_L)[0])
    for yaw in (0.0, 2.0):
        shape = GAIT.shape(q, so3.from_yaw(yaw))
        np.testing.assert_allclose(shape.r_V, [ahead_m, 0.0], atol=1e-12)
        assert shape.yaw_rad == pytest.approx(0.0, abs=1e-12)
    q[MODEL.joint_count - 1] = 0.6
    shape = GAIT.shape(q, np.eye(3))
    assert shape.yaw_rad == pytest.approx(0.6 * 35 / 36)


# -- A robot that goes as the model says, but for slip ----------------------------------------------------------------


@dataclass
class FakeVio:
    """Poses of the true head with noise, and drift that is in the covariance; ``lost`` frames have none."""

    truth: dict[int, Float]
    seed: int = 0
    drift_m: float = 0.0
    noise_m: float = 0.001
    lost: range = range(0)
    world: Float = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._shift, self._variance, self._frames = np.zeros(2), 1e-8, 0

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        pass

    def process(self, packet: Packet) -> FrameEstimate | None:
        if not isinstance(packet, CameraFrame):
            return None
        self._frames += 1
        nothing = np.empty((0, 2), np.float32), np.empty(0, np.int64), np.empty(0, bool)
        if packet.seq in self.lost:
            events = ("reset",) if packet.seq == self.lost.start else ()
            return FrameEstimate(packet.t_ns, packet.seq, None, Health(Verdict.LOST, ("gone",)), *nothing, events)
        if self.lost and packet.seq == self.lost.stop:
            # It starts anew in the pose in which it was lost.
            last = self.truth[packet.t_ns - STEP_NS * FRAME_EVERY * len(self.lost)]
            self.world = with_plane_pose(last, plane_pose(last) + np.array([0.3, 0.2, 0.5])) @ se3.inv(
                self.truth[packet.t_ns]
            )
        step = self.drift_m * np.sqrt(STEP_NS * FRAME_EVERY / 1e9)
        self._shift = self._shift + self._rng.normal(0, step, 2)
        self._variance += step**2
        T = self.world @ self.truth[packet.t_ns]
        T[:2, 3] += self._shift + self._rng.normal(0, self.noise_m, 2)
        cov = np.diag([1e-6] * 3 + [self._variance + self.noise_m**2] * 2 + [1e-6] + [1e-4] * 3)
        health = Health(Verdict.GOOD)
        pose = PoseEstimate(packet.t_ns, T, np.zeros(3), cov, health)
        return FrameEstimate(packet.t_ns, packet.seq, pose, health, *nothing)


def crawl(duration_s: float, slip: float = 0.8, gait: GaitName = "serpentine") -> tuple[list[Packet], dict[int, Float]]:
    """Packets, and true T_WI at every time, of a robot that moves at ``slip`` times the model's speed."""
    packets: list[Packet] = []
    truth: dict[int, Float] = {}
    first = joints(gait, 0.01)
    state = PlanarState.at(np.zeros(3), GAIT.shape(first.q_rad, np.eye(3)), np.zeros((5, 5)))
    for k in range(1, round(duration_s * 1e9) // STEP_NS):
        now = joints(gait, k * STEP_NS / 1e9)
        twist = GAIT.twist_V(now.q_rad, now.dq_rad_s)
        if twist is not None:
            theta = state.x[2] + 0.5 * twist.omega * STEP_NS / 1e9
            state.x[:2] += slip * rotation(theta) @ twist.v * STEP_NS / 1e9
            state.x[2] += twist.omega * STEP_NS / 1e9
        shape = GAIT.shape(now.q_rad, GAIT.level_attitude(now.q_rad))
        truth[now.t_ns] = with_plane_pose(np.eye(4), observe(state.x, shape))
        packets.append(now)
        if k % FRAME_EVERY == 0:
            packets.append(CameraFrame(now.t_ns, k // FRAME_EVERY - 1, IMAGE))
    return packets, truth


def follow(estimator: PlanarOdometry | GaitDeadReckoning, packets: list[Packet]) -> Iterator[FrameEstimate]:
    for packet in packets:
        estimate = estimator.process(packet)
        assert (estimate is not None) == isinstance(packet, CameraFrame)
        if estimate is not None:
            yield estimate


def errors(estimates: list[FrameEstimate], truth: dict[int, Float]) -> Float:
    """Position errors of the poses, (N,) m, in the world of the first."""
    poses = [e.pose for e in estimates if e.pose is not None]
    T = poses[0].T_WI @ se3.inv(truth[poses[0].t_ns])
    return np.array([np.linalg.norm((T @ truth[p.t_ns])[:2, 3] - p.T_WI[:2, 3]) for p in poses])


@pytest.fixture(scope="module")
def crawled() -> tuple[list[Packet], dict[int, Float]]:
    return crawl(9.0)


def test_it_is_better_than_the_gait_alone_and_smoother_than_the_pose(
    crawled: tuple[list[Packet], dict[int, Float]],
) -> None:
    packets, truth = crawled
    settings = SETTINGS.model_copy(update={"planar": SETTINGS.planar.model_copy(update={"pose_m": 0.002})})
    planar = list(
        follow(PlanarOdometry(settings.planar, settings.max_iterations, FakeVio(truth, noise_m=0.002), MODEL), packets)
    )
    alone = list(follow(GaitDeadReckoning(SETTINGS.planar, MODEL), packets))
    fake = FakeVio(truth, noise_m=0.002)
    vio = [e for e in (fake.process(p) for p in packets) if e is not None]
    assert len(planar) == len(alone) == len(vio)
    rms = [float(np.sqrt(np.mean(errors(e, truth) ** 2))) for e in (planar, vio, alone)]
    assert rms[0] < 0.85 * rms[1]
    assert rms[0] < 0.1 * rms[2]
    assert all(e.health.verdict is Verdict.GOOD for e in planar)
    assert alone[-1].health.verdict is Verdict.DEGRADED


def test_without_a_pose_it_continues_with_the_gait_and_the_slip_it_has_learnt(
    crawled: tuple[list[Packet], dict[int, Float]],
) -> None:
    """Two seconds without a pose, then one in another world: the path continues where the robot is, without a jump."""
    packets, truth = crawled
    lost = range(100, 140)
    estimates = list(
        follow(
            PlanarOdometry(SETTINGS.planar, SETTINGS.max_iterations, FakeVio(truth, noise_m=0.0005, lost=lost), MODEL),
            packets,
        )
    )
    assert [e.health.verdict for e in estimates if e.seq in lost] == [Verdict.BLIND] * len(lost)
    assert all("dead reckoning on the gait" in e.health.reasons for e in estimates if e.seq in lost)
    assert "reset" in estimates[lost.start].events
    assert all(e.pose is not None for e in estimates)
    p = np.array([e.pose.T_WI[:3, 3] for e in estimates if e.pose is not None])
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1)
    assert steps[lost.stop - 2 : lost.stop + 2].max() < 0.03, "no jump where the pose comes back"
    e = errors(estimates, truth)
    gone_m = sum(np.linalg.norm(np.diff([truth[k * STEP_NS][:2, 3] for k in range(505, 705, 5)], axis=0), axis=1))
    assert gone_m > 0.4
    assert e[lost.stop - 1] - e[lost.start - 1] < 0.05 * gone_m
    assert e[-1] < e[lost.stop] + 0.03
    sigma = [float(np.sqrt(est.pose.cov[3, 3])) for est in estimates if est.pose is not None]
    assert sigma[lost.start - 1] < sigma[lost.stop - 1] <= 1.01 * sigma[-1], "what was lost is not found again"


def test_the_covariance_is_consistent_with_a_pose_that_drifts() -> None:
    """NEES of x and y (2 when exact) over seeds; a drift that is observed repeatedly is not averaged away."""
    packets, truth = crawl(3.0)
    nees: list[float] = []
    for seed in range(12):
        vio = FakeVio(truth, seed=seed, drift_m=0.01, noise_m=0.002)
        for e in list(follow(PlanarOdometry(SETTINGS.planar, SETTINGS.max_iterations, vio, MODEL), packets))[20:]:
            assert e.pose is not None
            d = (truth[e.t_ns] - e.pose.T_WI)[:2, 3]
            nees.append(float(d @ np.linalg.solve(e.pose.cov[3:5, 3:5], d)))
    assert 1.0 < np.mean(nees) < 3.0


def test_invalid_joint_states_are_left_out(crawled: tuple[list[Packet], dict[int, Float]]) -> None:
    packets, truth = crawled
    broken: list[Packet] = []
    for k, packet in enumerate(packets[:400]):
        broken.append(packet)
        if isinstance(packet, JointState) and k % 7 == 0:
            bad = np.where(np.arange(35) == k % 35, np.nan, packet.q_rad)
            broken.append(JointState(packet.t_ns + 1, bad, packet.dq_rad_s, bad, bad))
            broken.append(JointState(packet.t_ns + 1, packet.q_rad[:9], packet.dq_rad_s[:9], bad[:9], bad[:9]))
            broken.append(JointState(packet.t_ns - 5 * STEP_NS, packet.q_rad + 1, packet.dq_rad_s, bad, bad))
    clean, dirty = (
        [
            e.pose.T_WI.tobytes()
            for e in follow(PlanarOdometry(SETTINGS.planar, SETTINGS.max_iterations, FakeVio(truth), MODEL), p)
            if e.pose
        ]
        for p in (packets[:400], broken)
    )
    assert len(clean) > 60
    assert clean == dirty


def test_without_joints_the_pose_is_passed_on(crawled: tuple[list[Packet], dict[int, Float]]) -> None:
    packets, truth = crawled
    frames = [packet for packet in packets if isinstance(packet, CameraFrame)][:10]
    planar, vio = PlanarOdometry(SETTINGS.planar, SETTINGS.max_iterations, FakeVio(truth), MODEL), FakeVio(truth)
    for frame in frames:
        ours, its = planar.process(frame), vio.process(frame)
        assert ours is not None
        assert its is not None
        assert ours.pose is not None
        assert its.pose is not None
        assert np.array_equal(ours.pose.T_WI, its.pose.T_WI)


@pytest.mark.parametrize("mode", ["planar", "gait"])
def test_the_modes_need_a_robot(mode: str) -> None:
    settings = SETTINGS.model_copy(update={"mode": mode})
    expected = f"estimator.mode: '{mode}' needs a robot's joints, and here are none \\(allowed: visual, vio\\)"
    with pytest.raises(InputError, match=expected):
        build_estimator(settings, RIG, 0, None)
