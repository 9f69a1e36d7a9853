"""Image files: cheap checks when a recording is opened, decoding when a frame is wanted.

OpenCV decodes what is left of a truncated file without an error, so the ends of PNG and JPEG files are looked for here.
Bytes after the end, fill bytes before a JPEG's markers and the like are the decoder's affair: it accepts them.
"""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.errors import InputError

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_GRAY = 0
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
JPEG_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
JPEG_LONE_MARKERS = frozenset({0x01, *range(0xD0, 0xD9)})
"""Markers that no length follows."""
JPEG_SCAN = 0xDA
TAIL_BYTES = 4096
USUAL_BITS = (8, 10, 12, 14, 16)
FORMATS = "PNG, JPEG, or what OpenCV decodes"


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """What a file says of its image; ``is_gray`` is whether it has one channel, without a palette."""

    width: int
    height: int
    bits: int
    is_gray: bool


def check_image(path: Path, size_px: tuple[int, int], depth: bool = False) -> ImageHeader:
    """Return the header of a whole image of ``size_px`` (width, height); InputError otherwise.

    A ``depth`` image must have one channel of 16 bits.
    """
    header = read_header(path)
    if (header.width, header.height) != size_px:
        found, allowed = f"{header.width} x {header.height}", f"{size_px[0]} x {size_px[1]}"
        raise InputError(str(path), f"the image is {found} px", f"{allowed}, as the calibration says")
    if depth and header.bits != 16:
        raise InputError(str(path), f"{header.bits} bits a sample", "16")
    if depth and not header.is_gray:
        raise InputError(str(path), "the depth image has more than one channel", "16-bit grey")
    return header


def read_header(path: Path) -> ImageHeader:
    """Return the header of a whole image, read without its pixels where it is PNG or JPEG; InputError otherwise."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(str(path), "is not a file")
        with path.open("rb") as file:
            start = file.read(33)
            if not start:
                raise InputError(str(path), "the image is empty")
            if start.startswith(PNG_SIGNATURE):
                return _png_header(start, file)
            if start.startswith(JPEG_START):
                return _jpeg_header(file)
    except FileNotFoundError as error:
        raise InputError(str(path), "the image is missing") from error
    except (struct.error, EOFError) as error:
        raise InputError(str(path), "the image is truncated") from error
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from error
    return _decoded_header(path)


def used_bits(path: Path) -> int:
    """Return how many bits the brightest sample of a 16-bit image needs, 0 where all are zero."""
    return int(_decode(path).max()).bit_length()


def usual_bits(bits: int) -> int:
    """Return the number of bits that a sensor with ``bits`` used ones is likely to have: 8, 10, 12, 14 or 16."""
    return next(usual for usual in USUAL_BITS if bits <= usual) if bits else USUAL_BITS[-1]


def read_gray(path: Path, bits: int = 16) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
    """Return the image as grey (H, W) and, where it has colour, as RGB (H, W, 3).

    Of 16-bit samples ``bits`` are used: their upper 8 are returned; brighter samples saturate.
    """
    image = _decode(path)
    if image.dtype == np.uint16:
        image = np.minimum(image >> (bits - 8), 255).astype(np.uint8)
    if image.ndim == 3 and image.shape[2] < 3:
        image = image[..., 0]
    if image.ndim == 2:
        return np.ascontiguousarray(image, dtype=np.uint8), None
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
    try:
        decoded: Any = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error as error:
        raise InputError(str(path), "the image is damaged") from error
    if decoded is None:
        raise InputError(str(path), "the image is damaged")
    if decoded.dtype not in (np.uint8, np.uint16):
        raise InputError(str(path), f"samples of type {decoded.dtype}", "8 or 16 bits")
    return decoded


def _decoded_header(path: Path) -> ImageHeader:
    """Decode a file of another format to know what is in it."""
    try:
        image = _decode(path)
    except InputError as error:
        if error.problem == "the image is damaged":
            raise InputError(str(path), "is not an image", FORMATS) from error
        raise
    return ImageHeader(image.shape[1], image.shape[0], 8 * image.dtype.itemsize, image.ndim == 2)


def _png_header(start: bytes, file: BinaryIO) -> ImageHeader:
    """Read the header and walk the chunks to the end; struct.error or EOFError at an early end of the file."""
    width, height, bits, colour_type = struct.unpack(">IIBB", start[16:26])
    size = file.seek(0, 2)
    position = file.seek(len(PNG_SIGNATURE))
    while True:
        length, kind = struct.unpack(">I4s", file.read(8))
        position += 12 + length
        if position > size:
            raise EOFError
        if kind == b"IEND":
            return ImageHeader(width, height, bits, colour_type == PNG_GRAY)
        file.seek(position)


def _jpeg_header(file: BinaryIO) -> ImageHeader:
    """Walk the segments up to the scan, then look for the end marker; struct.error or EOFError at an early end."""
    file.seek(len(JPEG_START))
    header: ImageHeader | None = None
    while (marker := _jpeg_marker(file)) != JPEG_SCAN:
        if marker in JPEG_LONE_MARKERS:
            continue
        position = file.tell()
        (length,) = struct.unpack(">H", file.read(2))
        if marker in JPEG_FRAME_MARKERS:
            bits, height, width, channels = struct.unpack(">BHHB", file.read(6))
            header = ImageHeader(width, height, bits, channels == 1)
        file.seek(position + length)
    if header is None or not _has_jpeg_end(file):
        raise EOFError
    return header


def _jpeg_marker(file: BinaryIO) -> int:
    """Return the next marker: what follows any number of fill bytes, 0xFF; EOFError at the file's end."""
    byte = file.read(1)
    while byte and byte != b"\xff":
        byte = file.read(1)
    while byte == b"\xff":
        byte = file.read(1)
    if not byte:
        raise EOFError
    return byte[0]


def _has_jpeg_end(file: BinaryIO) -> bool:
    """Whether an end marker follows the scan's start; coded pixels never look like one."""
    scan = file.tell()
    size = file.seek(0, 2)
    file.seek(max(scan, size - TAIL_BYTES))
    if JPEG_END in file.read():
        return True
    file.seek(scan)
    return JPEG_END in file.read()
