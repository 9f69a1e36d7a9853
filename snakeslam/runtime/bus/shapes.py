"""The shape of every array in the messages on the bus, and the ranges of their numbers.

A size with a name has the same value throughout a message; it is the robot's where the receiver knows it
(``Bus.expect``).
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

import numpy as np
from msgspec import Struct

from snakeslam.messages import (
    CameraExposure,
    CameraFrame,
    GroundTruth,
    ImuSample,
    JointState,
    JointTarget,
    MapChunk,
    PoseEstimate,
)
from snakeslam.robot.model import snake_model
from snakeslam.runtime.bus.topics import RobotState, SlamState
from snakeslam.runtime.bus.wire import Hello

ArrayShape = tuple[int | str, ...]
JOINTS, LINKS, POINTS, HEIGHT, WIDTH = "joints", "links", "points", "height", "width"
SHAPES: dict[type, dict[str, ArrayShape]] = {
    ImuSample: {"gyro_I": (3,), "accel_I": (3,)},
    CameraFrame: {"gray": (HEIGHT, WIDTH), "rgb": (HEIGHT, WIDTH, 3), "depth_m": (HEIGHT, WIDTH)},
    JointState: dict.fromkeys(("q_rad", "dq_rad_s", "current_a", "temperature_degc"), (JOINTS,)),
    JointTarget: {"q_rad": (JOINTS,)},
    PoseEstimate: {"T_WI": (4, 4), "v_W": (3,), "cov": (9, 9)},
    MapChunk: {"T_WK": (4, 4), "points_K": (POINTS, 3), "rgb": (POINTS, 3)},
    GroundTruth: {"T_WI": (4, 4), "v_W": (3,), "gyro_bias_I": (3,), "accel_bias_I": (3,)},
    RobotState: {"q_target_rad": (JOINTS,), "q_measured_rad": (JOINTS,)},
    SlamState: {"T_WI": (4, 4), "Ts_WL": (LINKS, 4, 4), "T_WI_truth": (4, 4)},
    CameraExposure: {"Ts_WL": (LINKS, 4, 4), "T_WI": (4, 4), "w_C": (3,)},
}
MAY_BE_UNKNOWN = {(JointState, "current_a"), (JointState, "temperature_degc"), (CameraFrame, "depth_m")}
"""Arrays whose unknown values are NaN."""
FINITE_SCALARS = {(JointTarget, "head_roll_rad"), (RobotState, "period_s")}
"""Commands are not among them: the robot answers those that are not finite (``admission``)."""
INTEGERS = 1 << 62
"""Integers are below this, so that times in ns can be added in 64 bits."""


def robot_sizes(joint_count: int) -> dict[str, int]:
    """Return the sizes of a robot's arrays."""
    return {JOINTS: joint_count, LINKS: joint_count + 1}


def hello_sizes(hello: Hello) -> dict[str, int]:
    """Return the sizes of the arrays of the robot that says hello, its images among them."""
    width, height = hello.rig.cam0.resolution
    robot = {} if hello.robot is None else robot_sizes(snake_model(hello.robot).joint_count)
    return {**robot, HEIGHT: height, WIDTH: width}


def check(message: Any, sizes: Mapping[str, int]) -> None:
    """Raise ValueError where an array has a shape that its field does not have, or a number is out of range."""
    _check(message, dict(sizes))


def _check(value: Any, sizes: dict[str, int]) -> None:
    if isinstance(value, int):
        if not -INTEGERS < value < INTEGERS:
            raise ValueError(f"the integer {value} is out of range")
    elif isinstance(value, tuple):
        for item in value:  # pyright: ignore[reportUnknownVariableType]
            _check(item, sizes)
    elif (names := _field_names(type(value))) is not None:
        for name in names:
            _check_field(value, name, sizes)


def _check_field(message: Any, name: str, sizes: dict[str, int]) -> None:
    value, where = getattr(message, name), f"{type(message).__name__}.{name}"
    if isinstance(value, np.ndarray):
        _check_shape(where, value.shape, SHAPES[type(message)][name], sizes)
        if value.dtype.kind == "f" and (type(message), name) not in MAY_BE_UNKNOWN and not np.isfinite(value).all():
            raise ValueError(f"{where} is not finite")
    elif isinstance(value, float):
        if (type(message), name) in FINITE_SCALARS and not np.isfinite(value):
            raise ValueError(f"{where} is not finite")
    else:
        _check(value, sizes)


def _check_shape(where: str, shape: tuple[int, ...], declared: ArrayShape, sizes: dict[str, int]) -> None:
    fits = len(shape) == len(declared)
    for side, size in zip(shape, declared, strict=False):
        # The first array with a name of a size binds it for the rest of the message.
        fits = fits and side == (sizes.setdefault(size, side) if isinstance(size, str) else size)
    if not fits:
        wanted = ", ".join(f"{size} = {sizes[size]}" if size in sizes else str(size) for size in map(str, declared))
        raise ValueError(f"{where} has the shape {shape} instead of ({wanted})")


@cache
def _field_names(kind: type) -> tuple[str, ...] | None:
    if issubclass(kind, Struct):
        return kind.__struct_fields__
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else None
