"""Messages to bytes and back: MessagePack, checked against the type when decoded; no message can run code.

An array is (dtype, shape, bytes in C order); its dtype must be the one that its field declares, and its shape must fit
(``shapes``).
"""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, TypeVar, get_args, get_origin

import msgspec
import numpy as np
from pydantic import BaseModel, ValidationError

from snakeslam.errors import SnakeslamError
from snakeslam.runtime.bus.shapes import check

T = TypeVar("T")
LARGEST_SIDE = 1 << 24
NO_SIZES: Mapping[str, int] = MappingProxyType({})


class WireError(SnakeslamError):
    """Bytes from the bus are not a message of their topic."""


def encode(message: Any) -> bytes:
    """Return ``message``, a frozen dataclass, as bytes."""
    return _ENCODER.encode(message)


def decode(kind: type[T], data: bytes, sizes: Mapping[str, int] = NO_SIZES) -> T:
    """Return the message of type ``kind`` in ``data``; WireError when there is none.

    ``sizes`` are those of the arrays that the receiver knows, by their names in ``shapes``.
    """
    try:
        message: Any = _decoder(kind).decode(data)
        check(message, sizes)
        return message
    except (msgspec.MsgspecError, ValidationError, ValueError, TypeError) as error:
        raise WireError(f"not a {kind.__name__}: {' '.join(str(error).split())}") from error


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    raise TypeError(f"{type(value).__name__} cannot be sent")


def _rich(kind: Any, value: Any) -> Any:
    origin = get_origin(kind) or kind
    if origin is np.ndarray:
        return _array(get_args(get_args(kind)[1])[0], value)
    if issubclass(origin, BaseModel):
        return origin.model_validate(value)
    raise TypeError(f"{kind} cannot be received")


def _array(dtype: type[np.generic], value: Any) -> np.ndarray[Any, Any]:
    name, shape, data = value
    if np.dtype(str(name)) != np.dtype(dtype):
        raise ValueError(f"an array of {name} instead of {np.dtype(dtype).str}")
    if not all(isinstance(side, int) and 0 <= side <= LARGEST_SIDE for side in shape):
        raise ValueError(f"not a shape: {shape}")
    return np.frombuffer(data, dtype=dtype).reshape(shape)


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_plain)


@cache
def _decoder(kind: type[T]) -> "msgspec.msgpack.Decoder[T]":
    return msgspec.msgpack.Decoder(kind, dec_hook=_rich)
