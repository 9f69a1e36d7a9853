"""The robot controller with its commands: what reaches the servos, without a bus."""

from typing import Any

import numpy as np
import pytest

from snakeslam.config import Config, GovernorSettings
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import GaitCommand, HeadCommand, Health, JointTarget, Verdict
from snakeslam.robot.model import RobotSettings
from snakeslam.runtime.assembly.build import build_control
from snakeslam.runtime.bus.commands import Drive, EStop, ResetEStop, RobotCommand, SetGait, SetHead, Start, Stop
from snakeslam.runtime.bus.sender import Sender
from snakeslam.runtime.bus.topics import Event, Phase, Tick
from snakeslam.runtime.bus.wire import Estimate
from snakeslam.runtime.robot.controller import RobotController
from snakeslam.runtime.robot.deadman import DEADMAN_NS, INPUT_SILENT, RELEASE_FIRST
from snakeslam.runtime.robot.safety import BEFORE_THE_HOLD, FROZEN, FROZEN_NS
from snakeslam.runtime.session import compose
from tests.server.still_robot import StillRobot

CONFIG = Config(robot=RobotSettings(model="orthogonal24"))
STEP_NS = 10_000_000


class Bench:
    """A robot controller in this process that requires no other process, and its events."""

    def __init__(self, config: Config = CONFIG, required: dict[str, str] | None = None, **options: Any) -> None:
        self.robot = StillRobot(frame_every=100)
        self.events: list[Event] = []
        control = build_control(config, self.robot)
        assert control is not None
        self.node = RobotController(config, self.robot, control, self.events.append, required=required or {}, **options)
        self.sender = Sender()
        self.now_ns = 0

    def command(self, command: RobotCommand) -> str | None:
        return self.node.on_command(self.sender.stamped(command, self.now_ns), self.now_ns)

    def steps(self, count: int) -> np.ndarray:
        """Advance; return the targets that reached the robot."""
        before = len(self.robot.targets)
        for _ in range(count):
            self.now_ns += STEP_NS
            self.node.step(self.now_ns)
        return np.array([target.q_rad for target in self.robot.targets[before:]])

    @property
    def tick(self) -> Tick:
        return compose.tick(self.node.state(self.now_ns), None, self.sender.name)


def test_nothing_moves_before_a_start() -> None:
    bench = Bench()
    stationary = bench.steps(100)
    assert np.ptp(stationary[50:], axis=0).max() == 0.0
    bench.command(Start())
    assert bench.tick.moving
    moving = bench.steps(300)
    assert np.ptp(moving, axis=0).max() > 0.1


def test_autostart_waits_for_the_rest() -> None:
    bench = Bench(autostart=True)
    bench.steps(49)
    assert not any("start" in event.text for event in bench.events)
    bench.steps(30)
    assert bench.tick.moving


def test_the_estop_holds_within_one_control_step() -> None:
    bench = Bench()
    bench.command(Start())
    q = bench.steps(400)
    limits = bench.robot.model.limits
    speed = np.abs(q[-1] - q[-2]) / 0.01
    assert speed.max() > 0.1
    bench.command(EStop("test"))
    assert bench.tick.estop_reason == "test"
    assert not bench.tick.moving
    q = np.vstack([q[-1], bench.steps(100)])
    rates = np.abs(np.diff(q, axis=0)) / 0.01
    assert np.all(rates[0] <= np.maximum(speed - limits.acceleration_rad_s2 * 0.01, 0.0) + 1e-9)
    assert rates[20:].max() == 0.0


def test_only_a_start_moves_it_after_the_estop() -> None:
    bench = Bench()
    bench.command(Start())
    bench.steps(300)
    bench.command(EStop("test"))
    held = bench.steps(100)[-1]
    for command in (Start(), SetGait(GaitCommand(0, "sidewinding")), ResetEStop(), Stop()):
        bench.command(command)
        assert np.array_equal(bench.steps(60), np.tile(held, (60, 1))), command
    bench.command(Start())
    q = np.vstack([held, bench.steps(400)])
    assert np.ptp(q, axis=0).max() > 0.05
    assert np.abs(np.diff(q, axis=0)).max() / 0.01 <= bench.robot.model.limits.rate_rad_s


def test_a_session_that_begins_latched_does_not_autostart() -> None:
    bench = Bench(autostart=True, estop_reason="from before")
    q = bench.steps(200)
    assert np.ptp(q, axis=0).max() == 0.0
    assert bench.tick.estop_reason == "from before"
    bench.command(ResetEStop())
    assert np.ptp(bench.steps(100), axis=0).max() == 0.0


def test_every_command_is_counted_and_answered_at_once() -> None:
    bench = Bench()
    for number, command in enumerate((Start(), Stop(), EStop("x"), ResetEStop()), 1):
        bench.command(command)
        assert bench.tick.commands_done == number


def test_a_gait_that_is_set_while_stationary_is_the_one_that_starts() -> None:
    bench = Bench()
    bench.command(SetGait(GaitCommand(0, "sidewinding", drive=1.0, parameters={"period_s": 5.0})))
    assert np.ptp(bench.steps(100)[50:], axis=0).max() == 0.0
    assert bench.tick.gait is not None
    assert (bench.tick.gait.gait, bench.tick.gait.drive) == ("sidewinding", 0.0)
    assert bench.tick.gait.parameters == {"period_s": 5.0}


def events(bench: Bench) -> list[tuple[str, str]]:
    return [(event.level, event.text) for event in bench.events]


def test_the_head_is_set_while_moving_and_reported() -> None:
    bench = Bench()
    bench.command(Start())
    bench.steps(200)
    bench.command(SetHead(HeadCommand(0, "none", neck_joints=5)))
    assert bench.tick.head_settings == HeadSettings(controller="none", neck_joints=5)
    assert bench.tick.refusals == ()
    assert ("info", "neck of 5 yaw joints") in events(bench)
    assert bench.tick.moving


@pytest.mark.parametrize(
    "command",
    [
        SetHead(HeadCommand(0, "steady")),
        SetHead(HeadCommand(0, neck_joints=99)),
        SetHead(HeadCommand(0, "none", turn_by_deg=15.0)),
        SetGait(GaitCommand(0, "flying")),
        SetGait(GaitCommand(0, "serpentine", parameters={"alpha_pi": 0.7, "period_s": 0.5})),
    ],
)
def test_what_cannot_be_done_is_reported_and_changes_nothing(command: SetHead | SetGait) -> None:
    bench, untouched = Bench(), Bench()
    for one in (bench, untouched):
        one.command(Start())
        one.steps(200)
    bench.command(command)
    tick = bench.tick
    assert tick.commands_done == 2
    assert [refusal.number for refusal in tick.refusals] == [2]
    assert any(level == "error" and tick.refusals[0].reason in text for level, text in events(bench))
    assert (tick.gait, tick.head_settings) == (untouched.tick.gait, untouched.tick.head_settings)
    assert np.array_equal(bench.steps(100), untouched.steps(100))


def test_a_gait_that_barely_advances_has_a_notice_and_its_period_is_reported() -> None:
    bench = Bench()
    assert bench.tick.notice is None
    assert bench.node.state(0).period_s == pytest.approx(4.0)
    bench.command(
        SetGait(GaitCommand(0, "serpentine", parameters={"alpha_pi": 0.7, "wavelength_joints": 20, "period_s": 8.0}))
    )
    assert bench.tick.notice is not None
    assert "11 %" in bench.tick.notice
    assert bench.node.state(0).period_s == pytest.approx(8.0)
    bench.command(SetGait(GaitCommand(0, "pedal")))
    assert bench.tick.notice is None


def drive_for(bench: Bench, count: int, command: Drive) -> list[str | None]:
    """Repeat ``command`` ten times a second; return the answers."""
    answers: list[str | None] = []
    for _ in range(count):
        answers.append(bench.command(command))
        bench.steps(10)
    return answers


def test_a_deadman_input_drives_backwards_and_steers_for_as_long_as_it_is_renewed() -> None:
    bench = Bench()
    assert set(drive_for(bench, 20, Drive(-0.5, 0.4, begins=True))) == {None}
    assert bench.tick.moving
    assert bench.tick.gait is not None
    assert (bench.tick.gait.drive, bench.tick.gait.turn) == (-0.5, 0.4)
    assert np.ptp(bench.steps(10), axis=0).max() > 1e-3
    assert bench.command(Drive(0.0)) is None
    assert not bench.tick.moving
    assert (bench.tick.gait.drive, bench.tick.gait.turn) == (0.0, 0.0)
    assert [text for _, text in events(bench)] == ["start serpentine", "stop"]
    bench.steps(200)
    assert np.ptp(bench.steps(50), axis=0).max() < 1e-9


def test_a_silent_deadman_input_holds_the_robot_in_time_and_is_reported() -> None:
    bench = Bench()
    drive_for(bench, 5, Drive(1.0, 1.0, begins=True))
    bench.command(Drive(1.0, 1.0))
    bench.steps(DEADMAN_NS // STEP_NS)
    assert bench.tick.moving
    bench.steps(1)
    assert not bench.tick.moving
    assert bench.tick.gait is not None
    assert bench.tick.gait.turn == 0.0
    assert bench.tick.held_because == INPUT_SILENT
    assert ("error", f"held: {INPUT_SILENT}; start to move again") in events(bench)
    bench.steps(15)
    assert np.ptp(bench.steps(20), axis=0).max() == 0.0, "stationary 0.45 s after the last drive"
    assert set(drive_for(bench, 3, Drive(1.0))) == {RELEASE_FIRST}
    assert np.ptp(bench.steps(20), axis=0).max() == 0.0, "an input that was silent and not released moves it again"
    bench.command(Drive(0.0))
    assert bench.command(Drive(1.0)) is None
    assert (bench.tick.moving, bench.tick.held_because) == (True, None)


def test_a_start_needs_no_deadman_input_and_replaces_one() -> None:
    bench = Bench()
    bench.command(Drive(0.5, begins=True))
    bench.command(Start())
    bench.steps(100)
    assert bench.tick.moving
    assert bench.tick.gait is not None
    assert bench.tick.gait.drive == 1.0


def test_a_gait_that_is_set_while_driving_keeps_the_drive() -> None:
    bench = Bench()
    bench.command(Drive(-0.5, 0.2, begins=True))
    bench.command(SetGait(GaitCommand(0, "serpentine", turn=0.1, parameters={"period_s": 5.0})))
    assert bench.tick.gait is not None
    assert (bench.tick.gait.drive, bench.tick.gait.turn, bench.tick.gait.parameters["period_s"]) == (-0.5, 0.1, 5.0)


def test_a_drive_that_was_held_down_in_a_hold_must_be_released_first() -> None:
    """No input that was lost and is back again starts a robot by itself, as after an E-stop."""
    bench = Bench(required={"slam": "slam is silent"})
    send_heartbeat = lambda: bench.node.safety.on_heartbeat("slam", bench.now_ns, bench.now_ns)  # noqa: E731
    send_heartbeat()
    assert bench.command(Drive(1.0, begins=True)) is None
    drive_for(bench, 6, Drive(1.0))
    assert bench.tick.held_because == "slam is silent"
    assert not bench.tick.moving
    send_heartbeat()
    assert set(drive_for(bench, 3, Drive(1.0))) == {RELEASE_FIRST}
    assert np.ptp(bench.steps(20), axis=0).max() == 0.0
    assert bench.command(Drive(0.0)) is None
    assert bench.tick.held_because == "slam is silent"
    send_heartbeat()
    assert bench.command(Drive(1.0)) is None
    assert (bench.tick.moving, bench.tick.held_because) == (True, None)


def test_an_estop_refuses_the_drive_until_it_was_reset_and_the_drive_released() -> None:
    bench = Bench()
    drive_for(bench, 3, Drive(1.0, begins=True))
    bench.command(EStop("x"))
    assert None not in drive_for(bench, 3, Drive(1.0))
    bench.command(ResetEStop())
    assert drive_for(bench, 1, Drive(1.0)) == [RELEASE_FIRST]
    bench.command(Drive(0.0))
    assert bench.command(Drive(1.0)) is None
    assert [text for _, text in events(bench)].count("E-stop: x") == 1


@pytest.mark.parametrize(
    "command", [Drive(1.5, begins=True), Drive(1.0, -2.0, begins=True), Drive(np.nan), Drive(1.0, np.inf)]
)
def test_a_drive_beyond_its_range_moves_nothing(command: Drive) -> None:
    bench = Bench()
    assert bench.command(command) is not None
    assert not bench.tick.moving


def test_a_release_is_obeyed_however_late_it_arrives() -> None:
    bench = Bench()
    drive_for(bench, 5, Drive(1.0, begins=True))
    release = Drive(0.0)
    assert bench.node.on_command(bench.sender.stamped(release, bench.now_ns - 10**9), bench.now_ns) is None
    assert not bench.tick.moving


def estimate(bench: Bench, verdict: Verdict, boot: str = "") -> Estimate:
    return Estimate(boot, bench.now_ns, Health(verdict, (), 150), None)


def test_the_governor_throttles_what_is_played_by_what_slam_says() -> None:
    bench = Bench(CONFIG.model_copy(update={"governor": GovernorSettings(enabled=True)}))
    for verdict, boot, pace in ((Verdict.GOOD, "", 1.0), (Verdict.BLIND, "of before", 1.0), (Verdict.BLIND, "", 0.35)):
        for _ in range(40):
            bench.steps(5)
            bench.node.on_estimate(estimate(bench, verdict, boot))
        assert bench.tick.governed is not None
        assert bench.tick.governed.pace == pytest.approx(pace)
    assert bench.tick.governed.phase is Phase.SLOW
    assert bench.node._control.throttle == pytest.approx(0.35)
    assert Bench().tick.governed is None


def breaks(*given: Any) -> Any:
    raise FloatingPointError("no such angle")


def assert_brakes_and_moves_again(bench: Bench, reason: str) -> None:
    """The servos get the brake ramp and then one and the same target; a start moves the robot once all is well."""
    q = bench.steps(100)
    rates = np.abs(np.diff(q, axis=0)) / 0.01
    assert len(q) == 100, "the servos were left without a target"
    assert rates[20:].max() == 0.0
    assert not bench.tick.moving
    assert reason in (bench.tick.held_because or "")
    assert [text for _, text in events(bench)].count(f"held: {bench.tick.held_because}; start to move again") == 1


def test_control_that_fails_leaves_a_held_robot_whose_servos_brake(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    bench.command(Start())
    bench.steps(300)
    with monkeypatch.context() as broken:
        broken.setattr(bench.node._control, "step", breaks)
        assert_brakes_and_moves_again(bench, "control failed: FloatingPointError: no such angle")
    assert bench.command(Start()) is None
    assert np.ptp(bench.steps(300), axis=0).max() > 0.1


def test_a_target_of_the_wrong_size_is_a_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    bench.command(Start())
    bench.steps(300)
    monkeypatch.setattr(bench.node._control, "step", lambda *_: JointTarget(0, np.zeros(3)))
    assert_brakes_and_moves_again(bench, "control failed: ValueError")


def test_a_command_that_fails_is_a_hold_and_its_answer_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    bench.command(Start())
    bench.steps(300)
    with monkeypatch.context() as broken:
        broken.setattr(bench.node._control, "command_head", breaks)
        refusal = bench.command(SetHead(HeadCommand(0, "none", neck_joints=5)))
    assert refusal == "it failed: FloatingPointError: no such angle"
    assert bench.tick.refusals[-1].reason == refusal
    assert_brakes_and_moves_again(bench, "the head failed")


def test_an_estop_is_latched_though_all_that_follows_it_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench()
    bench.command(Start())
    bench.steps(300)
    monkeypatch.setattr(bench.node._control, "command", breaks)
    monkeypatch.setattr(bench.node, "_on_event", breaks)
    bench.command(EStop("x"))
    assert bench.tick.estop_reason == "x"
    assert (np.abs(np.diff(bench.steps(100), axis=0)) / 0.01)[20:].max() == 0.0


def test_a_press_from_before_this_node_was_started_moves_nothing() -> None:
    bench = Bench()
    assert set(drive_for(bench, 5, Drive(1.0))) == {RELEASE_FIRST}
    assert not bench.tick.moving
    bench.command(Drive(0.0))
    assert bench.command(Drive(1.0)) is None
    assert bench.tick.moving


def test_a_press_that_was_refused_does_not_begin_when_the_reason_has_gone() -> None:
    bench = Bench(required={"slam": "slam is silent"})
    assert bench.command(Drive(1.0, begins=True)) == "slam is silent"
    bench.node.safety.on_heartbeat("slam", bench.now_ns, bench.now_ns)
    assert bench.command(Drive(1.0)) == RELEASE_FIRST
    assert bench.command(Drive(1.0, begins=True)) is None


def test_a_stop_ends_the_press_and_another_input_does_not_continue_it() -> None:
    bench = Bench()
    assert bench.command(Drive(1.0, deadman="a", begins=True)) is None
    assert bench.command(Drive(1.0, deadman="b")) == RELEASE_FIRST
    assert bench.command(Drive(1.0, deadman="a")) is None
    bench.command(Stop())
    assert bench.command(Drive(1.0, deadman="a")) == RELEASE_FIRST
    assert bench.command(Drive(1.0, deadman="b", begins=True)) is None
    bench.command(Drive(0.0, deadman="a"))
    assert bench.command(Drive(1.0, deadman="b")) == RELEASE_FIRST, "a zero of any input stops"


@pytest.mark.parametrize("frozen", [Start(), Drive(1.0, begins=True)])
def test_what_was_sent_before_a_freeze_or_a_hold_moves_nothing(frozen: RobotCommand) -> None:
    bench = Bench()
    sent_ns = bench.now_ns
    bench.node.safety.on_iteration(bench.now_ns)
    bench.now_ns += FROZEN_NS + 100 * STEP_NS
    bench.node.safety.on_iteration(bench.now_ns)
    late = bench.sender.stamped(frozen, bench.now_ns - STEP_NS)
    assert bench.node.on_command(late, bench.now_ns) == BEFORE_THE_HOLD
    assert "old" in (bench.node.on_command(bench.sender.stamped(frozen, sent_ns), bench.now_ns) or "")
    assert bench.command(frozen) is None
    bench.node.hold("a reason")
    late = bench.sender.stamped(frozen, bench.now_ns - STEP_NS)
    assert bench.node.on_command(late, bench.now_ns) == BEFORE_THE_HOLD


def test_a_freeze_ends_the_press_before_the_orders_that_waited() -> None:
    bench = Bench()
    drive_for(bench, 3, Drive(1.0, begins=True))
    bench.node.safety.on_iteration(bench.now_ns)
    bench.now_ns += 2 * FROZEN_NS
    bench.node.safety.on_iteration(bench.now_ns)
    assert bench.command(Drive(1.0)) == RELEASE_FIRST
    assert bench.tick.held_because == FROZEN


def test_the_press_that_moves_the_robot_is_a_hold_when_it_is_refused() -> None:
    """As when slam fell silent before the next drive arrived: without the hold the robot would go on undriven."""
    bench = Bench(required={"slam": "slam is silent"})
    bench.node.safety.on_heartbeat("slam", bench.now_ns, bench.now_ns)
    assert bench.command(Drive(1.0, begins=True)) is None
    assert bench.tick.moving
    bench.now_ns += DEADMAN_NS + STEP_NS
    assert bench.command(Drive(1.0)) == "slam is silent"
    assert not bench.tick.moving
    assert bench.tick.held_because == "slam is silent"
