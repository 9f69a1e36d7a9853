"""Messages over the wire: every topic's type comes back as it was, and nothing else gets through."""

from dataclasses import replace
from typing import Any, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snakeslam.head.settings import HeadSettings
from snakeslam.messages import (
    CameraExposure,
    CameraFrame,
    GaitCommand,
    GroundTruth,
    HeadCommand,
    Health,
    ImuSample,
    JointState,
    JointTarget,
    MapChunk,
    PoseEstimate,
    Verdict,
)
from snakeslam.robot.model import RobotSettings
from snakeslam.runtime.bus.codec import WireError, decode, encode
from snakeslam.runtime.bus.commands import BackUp, Drive, EStop, ResetEStop, RobotCommand, SetGait, SetHead, Start, Stop
from snakeslam.runtime.bus.sender import Sender
from snakeslam.runtime.bus.shapes import SHAPES, hello_sizes, robot_sizes
from snakeslam.runtime.bus.topics import (
    TOPICS,
    Answer,
    Event,
    Features,
    Governed,
    HeadMotion,
    JpegImage,
    Phase,
    Refusal,
    RobotState,
    SlamState,
)
from snakeslam.runtime.bus.wire import Estimate, Exposure, Heartbeat, Hello, Sensors, SentCommand
from tests.server.still_robot import StillRobot

Q = np.linspace(-1.0, 1.0, 24)
POSE = PoseEstimate(5, np.eye(4), np.arange(3.0), np.eye(9), Health(Verdict.GOOD, ("a reason",), 7))
GRAY = np.arange(12, dtype=np.uint8).reshape(3, 4)
EXAMPLES: dict[type, Any] = {
    SentCommand: SentCommand("me", 3, 4, SetGait(GaitCommand(0, "pedal", turn=0.5))),
    Hello: Hello("boot", 1, 2, StillRobot().rig, RobotSettings(model="orthogonal24"), 9, True, POSE),
    Sensors: Sensors(
        "boot", 1, 2, (ImuSample(1, np.arange(3.0), np.ones(3)),), JointState(2, Q, Q, Q, Q * np.nan),
        JointTarget(1, Q, 0.1), (GroundTruth(1, np.eye(4), np.zeros(3)),),
    ),
    RobotState: RobotState(
        "boot", 1, 0, 2, True, None, "why", GaitCommand(0, "pedal"), HeadSettings(neck_joints=5), "notice", 4.0,
        0.9, Q, None, Governed(0.5, Phase.SLOW, "few features"),
        (Answer("me", 4, (Refusal(3, "no"),)),),
    ),
    Event: Event(1, "info", "words"),
    Exposure: Exposure("boot", CameraExposure(1, 2, np.tile(np.eye(4), (3, 1, 1)), np.eye(4), np.zeros(3))),
    CameraFrame: CameraFrame(1, 2, GRAY, None, GRAY.astype(np.float32), 5),
    Heartbeat: Heartbeat("me", 1, None),
    Estimate: Estimate("boot", 4, Health(Verdict.DEGRADED, ("a reason",), 7, 3.5), POSE),
    SlamState: SlamState(
        "boot", "vio", POSE.health, 20.0, np.eye(4), None, None, HeadMotion(yaw_deg=1.0), None, 0.5, 100
    ),
    JpegImage: JpegImage(1, 2, 4, 3, b"jpeg"),
    Features: Features(1, 2, ((1.5, 2.5, 1, 7),), None),
    MapChunk: MapChunk(1, 2, np.eye(4), np.ones((5, 3), np.float32), np.zeros((5, 3), np.uint8)),
}  # fmt: skip


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if hasattr(type(a), "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, k), getattr(b, k)) for k in type(a).__dataclass_fields__)
    return type(a) is type(b) and a == b


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_every_topic_comes_back_as_it_was(topic: Any) -> None:
    message = EXAMPLES[topic.type]
    assert same(message, decode(topic.type, encode(message)))


def test_no_two_topics_share_a_name() -> None:
    assert len({topic.name for topic in TOPICS}) == len(TOPICS)


COMMANDS: list[RobotCommand] = [
    SetGait(GaitCommand(0, "pedal", turn=0.5, parameters={"period_s": 3.0})),
    SetHead(HeadCommand(0, "none", 5)),
    Start(),
    BackUp(),
    Stop(),
    Drive(-0.5, 0.25, "a", True),
    EStop("x"),
    ResetEStop(),
]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_is_the_same_after_the_bus(command: RobotCommand) -> None:
    assert decode(SentCommand, encode(Sender().stamped(command, 5))).command == command


def test_every_command_of_the_union_is_tested() -> None:
    assert {type(command) for command in COMMANDS} == set(get_args(RobotCommand))


def test_numbers_of_orders_go_up() -> None:
    sender = Sender()
    assert [sender.stamped(Start(), 0).number for _ in range(3)] == [1, 2, 3]


@pytest.mark.parametrize(
    "command",
    [
        {"type": "Explode"},
        {"type": "SetGait"},
        {"type": "SetGait", "gait": {"t_ns": 0, "gait": 7}},
        {"type": "Drive", "drive": "fast"},
        {"type": "ControlPlayback", "paused": True},
        {},
        None,
    ],
)
def test_an_order_without_a_command_is_refused(command: Any) -> None:
    message = {"sender": "me", "number": 1, "stamp_ns": 0, "command": command}
    with pytest.raises(WireError):
        decode(SentCommand, msgspec.msgpack.encode(message))


@given(st.binary(max_size=64))
def test_bytes_of_any_kind_are_a_message_or_an_error(data: bytes) -> None:
    for topic in TOPICS:
        try:
            assert isinstance(decode(topic.type, data), topic.type)
        except WireError:
            continue


@pytest.mark.parametrize(
    "array",
    [("<f4", (3,), b"\0" * 12), ("<f8", (4,), b"\0" * 24), ("|O", (3,), b"\0" * 24), ("<f8", (-3,), b"\0" * 24), 5,
     ("<f8", (1 << 40,), b"")],
)  # fmt: skip
def test_an_array_that_is_not_what_its_field_declares_is_refused(array: Any) -> None:
    data = msgspec.msgpack.encode({"t_ns": 1, "q_rad": array, "head_roll_rad": None})
    with pytest.raises(WireError, match="JointTarget"):
        decode(JointTarget, data)


def array_fields(kind: type) -> set[tuple[type, str]]:
    """Every (message, field) below ``kind`` that holds an array."""
    found: set[tuple[type, str]] = set()
    for name, hint in get_type_hints(kind).items() if hasattr(kind, "__dataclass_fields__") else ():
        for part in (hint, *get_args(hint), *(inner for arg in get_args(hint) for inner in get_args(arg))):
            if (get_origin(part) or part) is np.ndarray:
                found.add((kind, name))
            elif isinstance(part, type) and part is not kind:
                found |= array_fields(part)
    return found


def test_every_array_on_the_bus_has_its_shape_in_the_table() -> None:
    declared = {(kind, name) for kind, names in SHAPES.items() for name in names}
    assert declared == set().union(*(array_fields(topic.type) for topic in TOPICS))


def changed(message: Any, path: str, value: Any) -> Any:
    """Return ``message`` with the field at the dotted ``path`` (a number: of a tuple) replaced."""
    name, _, rest = path.partition(".")
    if isinstance(message, tuple):
        items = list(message)
        items[int(name)] = changed(items[int(name)], rest, value) if rest else value
        return tuple(items)
    return replace(message, **{name: changed(getattr(message, name), rest, value) if rest else value})


@pytest.mark.parametrize(
    ("kind", "path", "value"),
    [
        (Estimate, "pose.T_WI", np.eye(3)),
        (Estimate, "pose.T_WI", np.full((4, 4), np.nan)),
        (Estimate, "pose.cov", np.eye(6)),
        (Estimate, "pose.v_W", np.zeros((3, 1))),
        (Estimate, "t_ns", 1 << 63),
        (Sensors, "imu.0.gyro_I", np.zeros(2)),
        (Sensors, "joints.q_rad", np.zeros((2, 12))),
        (Sensors, "joints.dq_rad_s", np.zeros(23)),
        (Sensors, "joints.q_rad", Q * np.inf),
        (Sensors, "target.q_rad", np.zeros(23)),
        (Sensors, "target.head_roll_rad", np.nan),
        (Sensors, "truth.0.T_WI", np.eye(3)),
        (Sensors, "stamp_ns", -(1 << 63)),
        (RobotState, "q_target_rad", np.zeros(0)[None]),
        (RobotState, "period_s", np.inf),
        (CameraFrame, "gray", GRAY[0]),
        (CameraFrame, "depth_m", np.zeros((4, 3), np.float32)),
        (CameraFrame, "rgb", np.zeros((3, 4, 4), np.uint8)),
        (Exposure, "exposure.Ts_WL", np.zeros((3, 4))),
        (Exposure, "exposure.w_C", np.full(3, np.inf)),
        (MapChunk, "rgb", np.zeros((4, 3), np.uint8)),
        (MapChunk, "points_K", np.full((5, 3), np.nan, np.float32)),
        (MapChunk, "key", 1 << 63),
        (SlamState, "T_WI", np.eye(3)),
        (Heartbeat, "stamp_ns", 1 << 63),
        (SentCommand, "number", 1 << 63),
    ],
)
def test_a_message_with_a_wrong_shape_or_number_is_dropped(kind: type, path: str, value: Any) -> None:
    with pytest.raises(WireError, match=kind.__name__):
        decode(kind, encode(changed(EXAMPLES[kind], path, value)))


def test_what_the_sensors_do_not_know_may_be_no_number() -> None:
    unknown = changed(EXAMPLES[Sensors], "joints.temperature_degc", Q * np.nan)
    assert same(unknown, decode(Sensors, encode(unknown)))


@pytest.mark.parametrize("kind", [Sensors, RobotState])
def test_a_robot_of_another_size_is_dropped_where_the_robot_is_known(kind: type) -> None:
    data = encode(EXAMPLES[kind])
    assert decode(kind, data, robot_sizes(24)) is not None
    with pytest.raises(WireError, match="joints = 35"):
        decode(kind, data, robot_sizes(35))


def test_a_frame_of_another_size_is_dropped_where_the_camera_is_known() -> None:
    frame = CameraFrame(1, 2, np.zeros((240, 320), np.uint8))
    assert decode(CameraFrame, encode(frame), hello_sizes(EXAMPLES[Hello])) is not None
    with pytest.raises(WireError, match="height = 240, width = 320"):
        decode(CameraFrame, encode(EXAMPLES[CameraFrame]), hello_sizes(EXAMPLES[Hello]))
