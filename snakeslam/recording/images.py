"""Image files: cheap checks when a recording is opened, decoding when a frame is wanted.

OpenCV decodes what is left of a damaged file without a word, so the ends of files are checked here.
"""

import struct
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.errors import InputError

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
JPEG_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
TAIL_BYTES = 4096


def check_image(path: Path, size_px: tuple[int, int], bits: int | None = None) -> None:
    """Raise InputError unless ``path`` is a whole PNG or JPEG of ``size_px`` (width, height), of ``bits`` a sample."""
    try:
        with path.open("rb") as file:
            found_size, found_bits = _header(path, file)
            _check_end(path, file)
    except FileNotFoundError as error:
        raise InputError(str(path), "the image is missing") from error
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from error
    if found_size != size_px:
        size, allowed = (f"{width} x {height}" for width, height in (found_size, size_px))
        raise InputError(str(path), f"the image is {size} px", f"{allowed}, as the calibration says")
    if bits is not None and found_bits != bits:
        raise InputError(str(path), f"{found_bits} bits a sample", f"{bits}")


def read_gray(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Return the image as grey (H, W) and, where it has colour, as RGB (H, W, 3)."""
    image = _decode(path)
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.ndim == 2:
        return image.astype(np.uint8, copy=False), None
    rgb = np.asarray(cv2.cvtColor(image[..., :3], cv2.COLOR_BGR2RGB), dtype=np.uint8)
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), dtype=np.uint8), rgb


def read_depth(path: Path, units_per_m: float) -> NDArray[np.float32]:
    """Return a 16-bit depth image in metres, (H, W), 0 where unknown."""
    image = _decode(path)
    if image.ndim != 2 or image.dtype != np.uint16:
        raise InputError(str(path), "the depth image is not 16-bit grey")
    return (image * np.float32(1.0 / units_per_m)).astype(np.float32)


def _decode(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from error
    decoded: Any = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    if decoded is None:
        raise InputError(str(path), "the image is damaged")
    if decoded.dtype not in (np.uint8, np.uint16):
        raise InputError(str(path), f"samples of type {decoded.dtype}", "8 or 16 bits")
    return decoded


def _header(path: Path, file: BinaryIO) -> tuple[tuple[int, int], int]:
    """Return (width, height) and bits a sample."""
    start = file.read(33)
    if not start:
        raise InputError(str(path), "the image is empty")
    try:
        if start.startswith(PNG_SIGNATURE):
            width, height, bits = struct.unpack(">IIB", start[16:25])
            return (width, height), bits
        if start.startswith(JPEG_START):
            return _jpeg_header(file)
    except struct.error as error:
        raise InputError(str(path), "the image is truncated") from error
    raise InputError(str(path), "is not an image", "PNG or JPEG")


def _jpeg_header(file: BinaryIO) -> tuple[tuple[int, int], int]:
    """Walk the segments of a JPEG up to its frame header; struct.error at an early end."""
    file.seek(2)
    while True:
        marker, length = struct.unpack(">HH", file.read(4))
        if marker >> 8 != 0xFF:
            raise struct.error
        if marker & 0xFF in JPEG_FRAME_MARKERS:
            bits, height, width = struct.unpack(">BHH", file.read(5))
            return (width, height), bits
        file.seek(length - 2, 1)


def _check_end(path: Path, file: BinaryIO) -> None:
    """Raise InputError unless the file has its format's end marker; zeros after it are let pass."""
    file.seek(0)
    is_png = file.read(len(PNG_SIGNATURE)) == PNG_SIGNATURE
    size = file.seek(0, 2)
    file.seek(max(0, size - TAIL_BYTES))
    tail = file.read().rstrip(b"\x00")
    if not tail.endswith(PNG_END if is_png else JPEG_END):
        raise InputError(str(path), "the image is truncated")
