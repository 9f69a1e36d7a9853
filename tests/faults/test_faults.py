"""The fault table: real processes are killed, frozen and fed nonsense; asserted is what reached the servos.

The robot node's stamps are this machine's monotonic clock, so what it did is put in order with what was done to it.
"""

import os
import signal
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import httpx
import numpy as np
import pytest

from snakeslam.cli import main as cli
from snakeslam.errors import SnakeslamError
from snakeslam.messages import GaitCommand
from snakeslam.robot.model import PRESETS
from snakeslam.runtime.bus.codec import encode
from snakeslam.runtime.bus.commands import Drive, EStop, ResetEStop, RobotCommand, SetGait, Start, Stop
from snakeslam.runtime.bus.probe import check
from snakeslam.runtime.robot.deadman import INPUT_SILENT, RELEASE_FIRST
from snakeslam.runtime.robot.safety import FROZEN, LOST, SERVER, SLAM
from tests.faults.nodes import BRAKE_STEPS, HOLD_NS, Nodes, wait_for
from tests.server.running import START_S, Running, start

STALE_NS = 400_000_000


@pytest.fixture(scope="module")
def nodes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nodes]:
    nodes = Nodes(tmp_path_factory.mktemp("bus"))
    yield nodes
    nodes.close()


class Site:
    """The nodes, and a server that may come and go."""

    def __init__(self, nodes: Nodes, folder: Path) -> None:
        self.nodes, self.folder = nodes, folder
        self.server: Running = start(folder, bus=nodes.endpoint)

    def restart(self) -> None:
        self.server = start(self.folder, bus=self.nodes.endpoint)

    def post(self, path: str) -> httpx.Response:
        with self.server.client() as client:
            return client.post(f"/api/v1{path}")

    def get(self, path: str) -> dict:
        with self.server.client() as client:
            return client.get(f"/api/v1{path}").json()

    def running(self) -> bool:
        return self.get("/state")["session"] == "running"

    def moving(self) -> None:
        """Have the robot move, by order of the page."""
        wait_for(self.running, START_S)
        wait_for(lambda: self.get("/map")["points"] > 0, START_S)
        wait_for(lambda: self.post("/gait/start").status_code == 200, START_S)
        self.nodes.wait_moving()


@pytest.fixture(scope="module")
def site(nodes: Nodes, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    site = Site(nodes, tmp_path_factory.mktemp("site"))
    yield site
    site.server.stop()


@pytest.fixture
def moving(site: Site) -> Iterator[Site]:
    site.moving()
    yield site
    site.post("/estop/reset")
    site.post("/gait/stop")


def test_a_killed_server_leaves_a_held_robot_and_the_next_one_finds_the_map(moving: Site) -> None:
    points, pid = moving.get("/map")["points"], moving.server.process.pid
    killed_ns = time.monotonic_ns()
    os.kill(pid, signal.SIGKILL)
    moving.nodes.assert_held(killed_ns)
    assert moving.nodes.states[-1].held_because == LOST[SERVER]
    moving.server.stop()
    moving.restart()
    wait_for(moving.running, START_S)
    wait_for(lambda: moving.get("/map")["points"] >= points)
    moving.nodes.assert_stationary()
    assert not moving.get("/state")["moving"]
    moving.moving()


def test_a_frozen_server_leaves_a_held_robot_that_stays_where_it_is_when_it_thaws(moving: Site) -> None:
    frozen_ns = time.monotonic_ns()
    os.kill(moving.server.process.pid, signal.SIGSTOP)
    try:
        moving.nodes.assert_held(frozen_ns)
    finally:
        os.kill(moving.server.process.pid, signal.SIGCONT)
    wait_for(moving.running)
    moving.nodes.assert_stationary()
    moving.moving()


def test_a_killed_slam_holds_the_robot_and_the_next_one_goes_on_where_it_was(moving: Site) -> None:
    nodes = moving.nodes
    chunks, pose = dict(nodes.chunks), nodes.slam_states[-1].T_WI
    assert pose is not None
    killed_ns = time.monotonic_ns()
    nodes.slam.process.kill()
    nodes.assert_held(killed_ns)
    assert nodes.states[-1].held_because == LOST[SLAM]
    assert moving.get("/state")["held_because"] == LOST[SLAM]
    assert moving.post("/gait/start").status_code == 409
    nodes.slam_states.clear()
    nodes.start_slam()
    wait_for(lambda: nodes.slam_states and nodes.slam_states[-1].T_WI is not None, START_S)
    again = nodes.slam_states[-1].T_WI
    assert again is not None
    assert np.linalg.norm(again[:3, 3] - pose[:3, 3]) < 0.05
    wait_for(lambda: len(nodes.chunks) > len(chunks))
    assert all(nodes.chunks[key].revision >= chunk.revision for key, chunk in chunks.items())
    nodes.assert_stationary()
    moving.moving()


def test_a_frozen_slam_holds_the_robot(moving: Site) -> None:
    pid, frozen_ns = moving.nodes.slam.process.pid, time.monotonic_ns()
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    try:
        moving.nodes.assert_held(frozen_ns)
        wait_for(lambda: moving.get("/state")["health"]["verdict"] == "lost")
    finally:
        os.kill(pid, signal.SIGCONT)
    moving.nodes.assert_stationary()
    moving.moving()


def test_a_frozen_robot_is_reported_and_does_nothing_late_when_it_thaws(moving: Site) -> None:
    nodes, pid = moving.nodes, moving.nodes.robot.process.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    try:
        wait_for(lambda: "silent" in (moving.get("/state")["message"] or ""))
        late = nodes.send_now(SetGait(GaitCommand(0, "pedal")))
        time.sleep(0.4)
    finally:
        thawed_ns = time.monotonic_ns()
        os.kill(pid, signal.SIGCONT)
    refusal = nodes.answered(late)
    assert refusal is not None
    assert "old" in refusal
    wait_for(lambda: moving.get("/state")["message"] is None)
    nodes.assert_held(thawed_ns - HOLD_NS)
    assert nodes.states[-1].held_because == FROZEN
    moving.moving()


def test_an_estop_latches_at_once_under_a_flood_of_commands(moving: Site) -> None:
    nodes = moving.nodes
    for k in range(2000):
        last = nodes.send_now(SetGait(GaitCommand(0, "serpentine", parameters={"alpha_pi": 0.3 + 0.0001 * (k % 100)})))
        if k == 1000:
            stop = nodes.send_now(EStop("under flood"))
    wait_for(lambda: nodes.answered(stop) is None)
    wait_for(lambda: any(state.estop_reason is not None for state in nodes.states))
    latched = next(state for state in list(nodes.states) if state.estop_reason is not None)
    assert latched.estop_reason == "under flood"
    flood = next(answer for answer in latched.answers if answer.sender == nodes.sender.name)
    assert flood.done < last.number, "it was latched only after the flood was worked through"
    nodes.assert_held(latched.stamp_ns - HOLD_NS)
    nodes.answered(last)
    assert moving.post("/gait/start").status_code == 409
    assert nodes.answered(nodes.send_now(Start())) is not None
    assert nodes.answered(nodes.send_now(Drive(1.0, begins=True))) is not None
    nodes.assert_stationary()
    assert nodes.answered(nodes.send_now(ResetEStop())) is None
    nodes.assert_stationary()


def test_a_deadman_input_that_falls_silent_leaves_a_held_robot(site: Site) -> None:
    """As with a key-up that is lost, or a network that is cut behind the server."""
    nodes = site.nodes
    wait_for(site.running, START_S)
    nodes.wait_moving(Drive(1.0, 0.5))
    silent_ns = time.monotonic_ns()
    nodes.assert_held(silent_ns)
    assert not nodes.states[-1].moving
    assert nodes.states[-1].held_because == INPUT_SILENT
    assert nodes.answered(nodes.send_now(Drive(1.0, 0.5))) == RELEASE_FIRST
    nodes.assert_stationary()
    nodes.wait_moving(Drive(1.0, 0.5))
    site.moving()
    site.post("/gait/stop")


def test_what_must_not_be_obeyed_changes_nothing(moving: Site) -> None:
    """Orders that are stale, early, not of numbers, or overtaken by a later one of their sender."""
    nodes = moving.nodes
    now_ns = nodes.clock.now_ns()
    assert now_ns is not None
    other = SetGait(GaitCommand(0, "sidewinding"))
    for word, command, stamp_ns in (
        ("old", other, now_ns - STALE_NS),
        ("future", other, now_ns + 10**10),
        ("not a finite number", SetGait(GaitCommand(0, "sidewinding", turn=float("nan"))), None),
        ("not a finite number", SetGait(GaitCommand(0, "sidewinding", parameters={"period_s": float("inf")})), None),
        ("not a finite number", Drive(float("nan")), None),
        ("old", Drive(-1.0), now_ns - STALE_NS),
    ):
        assert word in (nodes.answered(nodes.send_now(command, stamp_ns)) or "")
    first = nodes.sender.stamped(other, now_ns)
    nodes.answered(nodes.send_now(SetGait(GaitCommand(0, "serpentine"))))
    nodes.send(first)
    nodes.answered(nodes.send_now(ResetEStop()))
    assert "later command" in (nodes.answered(first) or "")
    state = nodes.states[-1]
    assert state.gait is not None
    assert (state.gait.gait, state.gait.drive, state.moving) == ("serpentine", 1.0, True)


@pytest.mark.parametrize("command", [Stop(), Drive(0.0), EStop("late")], ids=["stop", "let go", "E-stop"])
def test_what_can_only_stop_is_obeyed_however_late(moving: Site, command: RobotCommand) -> None:
    nodes = moving.nodes
    for stamp_ns in (0, time.monotonic_ns() - 10**10, time.monotonic_ns() + 10**11):
        assert nodes.answered(nodes.send_now(command, stamp_ns)) is None
        assert not nodes.states[-1].moving
        assert (nodes.states[-1].estop_reason is not None) == isinstance(command, EStop)
        # The server keeps an E-stop latched of which it has heard, whoever pressed it.
        assert moving.post("/estop/reset").status_code == 200
        moving.moving()


def test_every_target_keeps_within_the_limits_of_the_joints(moving: Site) -> None:
    """Gaits that follow upon each other without a pause, and a stop in the middle."""
    nodes = moving.nodes
    limits = PRESETS["orthogonal24"].limits
    since_ns = time.monotonic_ns()
    for name in ("sidewinding", "arc_rolling", "pedal", "serpentine"):
        nodes.answered(nodes.send_now(SetGait(GaitCommand(0, name, parameters={"period_s": 2.0}))))
        nodes.wait_moving()
    nodes.answered(nodes.send_now(EStop("limits")))
    nodes.wait_stationary()
    with nodes.lock:
        q = np.array([angles for stamp, angles in nodes.steps if stamp >= since_ns])
    rates = np.diff(q, axis=0) / 0.01
    assert np.abs(q).max() <= limits.position_rad
    assert 0.1 < np.abs(rates).max() <= limits.rate_rad_s + 1e-9
    assert np.abs(np.diff(rates, axis=0)).max() / 0.01 <= limits.acceleration_rad_s2 * (1 + 1e-6)


def test_a_hold_brakes_every_joint_as_fast_as_it_can(moving: Site) -> None:
    nodes = moving.nodes
    nodes.answered(nodes.send_now(EStop("brake")))
    nodes.wait_stationary()
    latched_ns = next(state.stamp_ns for state in nodes.states if state.estop_reason == "brake")
    rates = [step / 0.01 for _, step in nodes.rates(latched_ns)]
    taken_off = PRESETS["orthogonal24"].limits.acceleration_rad_s2 * 0.01
    assert sum(rate > 0.0 for rate in rates) <= BRAKE_STEPS
    # The fastest joint slows down by all that is allowed, until less than that is left.
    assert all(after <= max(before - taken_off, taken_off) + 1e-9 for before, after in pairwise(rates))


def test_a_message_that_is_none_is_dropped(moving: Site) -> None:
    nodes = moving.nodes
    count = len(nodes.states)
    unknown = encode(nodes.sender.stamped(Stop(), 0)).replace(b"Stop", b"Expl")
    for data in (b"", b"nonsense", b"\xc1" * 100, b"\x93\x01\x02\x03", unknown):
        nodes.bus._session.put("snakeslam/robot/commands", data)
        nodes.bus._session.put("snakeslam/robot/estop", data)
    wait_for(lambda: len(nodes.states) > count + 20)
    assert nodes.states[-1].moving
    assert nodes.states[-1].estop_reason is None


def test_the_health_check_names_the_silent_node(nodes: Nodes, capsys: pytest.CaptureFixture[str]) -> None:
    wait_for(lambda: nodes.slam_states)
    assert cli(["node", "check", "--connect", nodes.endpoint]) == 0
    assert "alive" in capsys.readouterr().out
    pid = nodes.slam.process.pid
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    try:
        with pytest.raises(SnakeslamError, match="the slam node is silent"):
            check(nodes.link, patience_s=0.7)
    finally:
        os.kill(pid, signal.SIGCONT)
