"""Messages over the wire: every topic's type comes back as it was, and nothing else gets through."""

from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snakeslam.backends.sim.shot import Shot
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import (
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
from snakeslam.runtime.codec import WireError, decode, encode
from snakeslam.runtime.governor import Governed, Phase
from snakeslam.runtime.orders import Sender, command_of
from snakeslam.runtime.topics import (
    TOPICS,
    Answer,
    Command,
    Drive,
    EStop,
    Event,
    Features,
    HeadMotion,
    Picture,
    Refusal,
    ResetEStop,
    RobotState,
    SetGait,
    SetHead,
    SlamState,
    Start,
    Stop,
)
from snakeslam.runtime.wire import Beat, Estimate, Exposure, Hello, Order, Sensors
from tests.server.still_robot import StillRobot

Q = np.linspace(-1.0, 1.0, 24)
POSE = PoseEstimate(5, np.eye(4), np.arange(3.0), np.eye(9), Health(Verdict.GOOD, ("a reason",), 7))
GRAY = np.arange(12, dtype=np.uint8).reshape(3, 4)
EXAMPLES: dict[type, Any] = {
    Order: Order("me", 3, 4, "SetGait", gait=GaitCommand(0, "pedal", turn=0.5)),
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
    Exposure: Exposure("boot", Shot(1, 2, np.tile(np.eye(4), (3, 1, 1)), np.eye(4), np.zeros(3))),
    CameraFrame: CameraFrame(1, 2, GRAY, None, GRAY.astype(np.float32), 5),
    Beat: Beat("me", 1, None),
    Estimate: Estimate("boot", 4, Health(Verdict.DEGRADED, ("a reason",), 7, 3.5), POSE),
    SlamState: SlamState(
        "boot", "vio", POSE.health, 20.0, np.eye(4), None, None, HeadMotion(yaw_deg=1.0), None, 0.5, 100
    ),
    Picture: Picture(1, 2, 4, 3, b"jpeg"),
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


@pytest.mark.parametrize(
    "command",
    [
        SetGait(GaitCommand(0, "pedal")),
        SetHead(HeadCommand(0, "none")),
        Start(),
        Stop(),
        EStop("x"),
        ResetEStop(),
        Drive(-0.5, 0.25),
    ],
)
def test_a_command_is_the_same_after_its_way_as_an_order(command: Command) -> None:
    order = decode(Order, encode(Sender().order(command, 5)))
    assert command_of(order) == command


def test_numbers_of_orders_go_up() -> None:
    sender = Sender()
    assert [sender.order(Start(), 0).number for _ in range(3)] == [1, 2, 3]


@pytest.mark.parametrize("order", [Order("me", 1, 0, "Explode"), Order("me", 1, 0, "SetGait")])
def test_an_order_without_a_command_is_refused(order: Order) -> None:
    with pytest.raises(WireError):
        command_of(order)


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
