"""Procedural textures that look like the surfaces of buildings; RGB images, drawn from a generator."""

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.messages import Float

Texture = NDArray[np.uint8]
Colour = Sequence[float]
"""Red, green, blue, 0..255."""
Grain = NDArray[np.float32]

LETTERS = "ABCDEFGHIKLMNOPRSTUVWYabcdefghiklmnoprstuvwy0123456789"
FONTS = (cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_COMPLEX, cv2.FONT_HERSHEY_TRIPLEX)


def grain(rng: np.random.Generator, size: int, coarsest: int = 4, persistence: float = 0.6, finest: int = 2) -> Grain:
    """Return tileable noise of many octaves, about unit variance, (size, size) float32.

    The first octave has ``coarsest`` cells a side, each next one twice as many down to cells of ``finest`` px;
    ``persistence`` is the ratio of their amplitudes. ``size`` and ``coarsest`` are powers of two.
    """
    total = rng.standard_normal((coarsest, coarsest), dtype=np.float32)
    cells, amplitude, power = coarsest, 1.0, 1.0
    while cells < size:
        padded = np.pad(total, 2, mode="wrap")
        total = cv2.resize(padded, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)[4:-4, 4:-4]
        cells, amplitude = cells * 2, amplitude * persistence
        if cells <= size // finest:
            total = total + np.float32(amplitude) * rng.standard_normal((cells, cells), dtype=np.float32)
            power += amplitude**2
    return np.asarray(total / np.float32(np.sqrt(power) * 0.75), np.float32)


def tinted(colour: Colour, shade: Grain | Float) -> Texture:
    """Return ``colour`` made lighter or darker by the fraction ``shade`` (H, W)."""
    return np.clip(np.asarray(colour, np.float32) * (1.0 + shade[..., None]), 0, 255).astype(np.uint8)


def _draw_wrapped(image: Texture, draw: Callable[[Float], None], centre: Float, reach: float) -> None:
    """Call ``draw`` at ``centre`` and at its repetitions that reach into the image."""
    height, width = image.shape[:2]
    for dx in (-width, 0, width):
        for dy in (-height, 0, height):
            x, y = centre[0] + dx, centre[1] + dy
            if -reach < x < width + reach and -reach < y < height + reach:
                draw(np.array([x, y]))


def chips(
    rng: np.random.Generator, image: Texture, count: int, radius_px: tuple[float, float], colours: Sequence[Colour]
) -> None:
    """Scatter angular chips of the given colours and radii over ``image``, in place."""
    low, high = np.log(radius_px)
    for _ in range(count):
        radius = float(np.exp(rng.uniform(low, high)))
        angles = np.sort(rng.uniform(0, 2 * np.pi, 6))
        shape = np.stack([np.cos(angles), np.sin(angles)], 1) * radius * rng.uniform(0.5, 1.0, (6, 1))
        colour, light = colours[int(rng.integers(len(colours)))], rng.uniform(0.75, 1.2)
        tone = tuple(min(255.0, float(v) * light) for v in colour)

        def draw(at: Float, shape: Float = shape, tone: tuple[float, ...] = tone) -> None:
            cv2.fillConvexPoly(image, np.rint((at + shape) * 8).astype(np.int32), tone, cv2.LINE_AA, 3)

        _draw_wrapped(image, draw, rng.uniform(0, image.shape[0], 2), radius)


def stains(rng: np.random.Generator, image: Texture, strength: float = 0.2) -> Texture:
    """Return ``image`` with large soft-edged patches darkened."""
    size = image.shape[0]
    mask = 1.0 / (1.0 + np.exp(-6.0 * (grain(rng, size, 4, 0.55) - 0.9)))
    return np.clip(image * (1.0 - strength * mask[..., None]), 0, 255).astype(np.uint8)


def cracks(rng: np.random.Generator, image: Texture, count: int, tone: Colour = (60, 56, 52)) -> None:
    """Draw thin wandering cracks, in place."""
    size = image.shape[0]
    for _ in range(count):
        heading = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(0, 0.35, 40))
        path = np.cumsum(np.stack([np.cos(heading), np.sin(heading)], 1) * size / 90.0, axis=0)
        width = int(rng.integers(1, 3))

        def draw(at: Float, path: Float = path, width: int = width) -> None:
            points = np.rint((at + path) * 8).astype(np.int32)
            cv2.polylines(image, [points], False, tuple(float(v) for v in tone), width, cv2.LINE_AA, 3)

        _draw_wrapped(image, draw, rng.uniform(0, size, 2), size / 2.0)


def terrazzo(rng: np.random.Generator, size: int = 2048, tiles: int = 4) -> Texture:
    """Return a floor of ``tiles`` x ``tiles`` stone tiles with chips, joints, wear and stains."""
    base = tinted((168, 160, 148), 0.05 * grain(rng, size, 8, 0.8))
    chips(rng, base, 9000, (1.5, 9.0), [(95, 88, 80), (205, 196, 180), (135, 92, 74), (70, 74, 82), (186, 160, 120)])
    side = size // tiles
    for row in range(tiles):
        for column in range(tiles):
            block = np.s_[row * side : (row + 1) * side, column * side : (column + 1) * side]
            base[block] = np.clip(base[block] * rng.uniform(0.82, 1.1), 0, 255).astype(np.uint8)
    for k in range(tiles):
        base[k * side : k * side + 4] = base[:, k * side : k * side + 4] = (84, 80, 74)
    cracks(rng, base, 7)
    return stains(rng, base)


def carpet(rng: np.random.Generator, size: int = 2048, tiles: int = 4) -> Texture:
    """Return a floor of carpet tiles: coloured flecks, a woven direction that differs from tile to tile, wear."""
    weave = grain(rng, size, 256, 0.9)
    along = cv2.GaussianBlur(weave, (1, 9), 0, sigmaY=3, borderType=cv2.BORDER_REFLECT)
    side = size // tiles
    shade = np.empty((size, size), np.float32)
    for row in range(tiles):
        for column in range(tiles):
            block = np.s_[row * side : (row + 1) * side, column * side : (column + 1) * side]
            part = along[block] if (row + column) % 2 else np.ascontiguousarray(along[block].T)
            shade[block] = 0.1 * part + rng.normal(0, 0.1)
    image = tinted((92, 104, 122), shade + 0.06 * grain(rng, size, 4, 0.6))
    chips(rng, image, 9000, (1.5, 8.0), [(150, 158, 170), (58, 64, 78), (168, 140, 96), (112, 70, 66)])
    return stains(rng, image, 0.18)


def gravel(rng: np.random.Generator, size: int = 2048) -> Texture:
    """Return trodden earth with stones of many sizes."""
    image = tinted((128, 112, 92), 0.16 * grain(rng, size, 8, 0.75))
    stone = [(150, 144, 134), (104, 98, 92), (176, 166, 148), (120, 92, 76), (84, 82, 84)]
    chips(rng, image, 2600, (3.0, 9.0), [(70, 60, 50), (58, 52, 46)])
    chips(rng, image, 6500, (2.0, 16.0), stone)
    chips(rng, image, 60, (25.0, 60.0), stone)
    worn = image * (1.0 + 0.12 * grain(rng, size, 32, 0.85)[..., None])
    return stains(rng, np.clip(worn, 0, 255).astype(np.uint8), 0.22)


def bricks(rng: np.random.Generator, size: int = 1024, courses: int = 16) -> Texture:
    """Return a wall of ``courses`` brick courses in running bond, each brick of its own tone."""
    height, width = size // courses, size * 2 // courses
    joint = max(2, height // 9)
    image = tinted((176, 170, 160), 0.08 * grain(rng, size, 64, 0.9))
    rough = grain(rng, size, 32, 0.85)
    for row in range(courses):
        shift = (row % 2) * width // 2
        for column in range(size // width):
            tone = np.array([150, 78, 60]) * rng.uniform(0.62, 1.25) + rng.normal(0, 8, 3)
            rows = slice(row * height + joint, (row + 1) * height)
            columns = np.arange(column * width + joint + shift, (column + 1) * width + shift) % size
            image[rows, columns] = tinted(tone.tolist(), 0.14 * rough[rows, columns])
    return stains(rng, image, 0.18)


def plaster(rng: np.random.Generator, colour: Colour, size: int = 1024, wear: float = 1.0) -> Texture:
    """Return painted plaster; ``wear`` 1 has scuffs, patches, cracks and flaked paint, 0 none."""
    image = tinted(colour, 0.05 * max(wear, 0.15) * grain(rng, size, 4, 0.75))
    if wear <= 0.0:
        return image
    chips(
        rng,
        image,
        int(260 * wear),
        (2.0, 16.0),
        [[c * 0.72 for c in colour], [c * 1.12 for c in colour], (140, 132, 120)],
    )
    cracks(rng, image, int(9 * wear))
    return stains(rng, image, 0.14 * wear)


def planks(rng: np.random.Generator, size: int = 1024, boards: int = 6, colour: Colour = (158, 118, 78)) -> Texture:
    """Return wooden boards along the image's width, with grain and knots."""
    streaks = cv2.resize(grain(rng, size, 32, 0.8), (size * 8, size), interpolation=cv2.INTER_LINEAR)[:, :size]
    height = size // boards
    image = np.empty((size, size, 3), np.uint8)
    for k in range(boards):
        rows = slice(k * height, size if k == boards - 1 else (k + 1) * height)
        rolled = np.roll(streaks[rows], int(rng.integers(size)), axis=1)
        image[rows] = tinted((np.asarray(colour) * rng.uniform(0.75, 1.2)).tolist(), 0.16 * rolled)
        image[k * height : k * height + 3] = (60, 44, 32)
        for _ in range(3):
            at = (int(rng.integers(size)), int(k * height + rng.integers(10, max(11, height - 10))))
            cv2.ellipse(
                image, at, (int(rng.integers(6, 14)), int(rng.integers(3, 7))), 0, 0, 360, (92, 62, 38), -1, cv2.LINE_AA
            )
    return image


def ceiling(rng: np.random.Generator, size: int = 1024, tiles: int = 2) -> Texture:
    """Return perforated ceiling tiles with a few stains."""
    image = tinted((226, 224, 218), 0.05 * grain(rng, size, 8, 0.8))
    chips(rng, image, 900, (2.0, 4.5), [(120, 118, 112), (96, 94, 90)])
    side = size // tiles
    for k in range(tiles):
        image[k * side : k * side + 10] = image[:, k * side : k * side + 10] = (140, 140, 138)
    return stains(rng, image, 0.1)


def cardboard(rng: np.random.Generator, size: int = 512) -> Texture:
    """Return the side of a moving box: corrugation, tape, a printed label and an arrow."""
    lines = 0.02 * np.sin(np.arange(size, dtype=np.float32) * 0.9)[None, :]
    image = tinted((172, 132, 88), lines + 0.05 * grain(rng, size, 8, 0.75))
    middle = int(size * rng.uniform(0.4, 0.6))
    image[:, middle - 28 : middle + 28] = np.clip(image[:, middle - 28 : middle + 28] * 1.18, 0, 255).astype(np.uint8)
    x, y = int(rng.integers(30, size // 3)), int(rng.integers(40, size // 2))
    cv2.rectangle(image, (x, y), (x + size // 3, y + size // 4), (226, 222, 212), -1)
    _print_lines(rng, image, (x + 8, y + 24), 4, size // 3 - 16, 0.6, (30, 30, 34))
    _word(rng, image, (int(rng.integers(20, size // 3)), int(size * 0.9)), 1.6, (60, 40, 28), 3)
    cv2.arrowedLine(image, (size - 70, size - 60), (size - 70, size - 190), (60, 40, 28), 8, cv2.LINE_AA, 0, 0.35)
    return image


def poster(rng: np.random.Generator, height: int = 768, width: int = 512) -> Texture:
    """Return a printed sheet: a heading, a drawing of shapes, and paragraphs."""
    paper = rng.uniform(190, 235, 3)
    image = np.full((height, width, 3), paper.astype(np.uint8))
    ink = rng.uniform(10, 90, 3).tolist()
    band = int(height * rng.uniform(0.12, 0.2))
    image[:band] = np.asarray(rng.uniform(40, 150, 3), np.uint8)
    _word(rng, image, (24, band - 26), 2.0, (238, 234, 224), 4)
    top, bottom = band + 24, int(height * rng.uniform(0.5, 0.62))
    shade = 0.25 * grain(rng, 512, 4, 0.7)[: bottom - top, : width - 48]
    image[top:bottom, 24 : width - 24] = tinted(rng.uniform(70, 190, 3).tolist(), shade)
    chips(rng, image[top:bottom, 24 : width - 24], 24, (14.0, 80.0), rng.uniform(30, 235, (6, 3)).tolist())
    _print_lines(rng, image, (28, bottom + 40), int((height - bottom - 50) / 30), width - 60, 0.75, ink)
    cv2.rectangle(image, (0, 0), (width - 1, height - 1), (70, 66, 60), 6)
    return image


def bookshelf(rng: np.random.Generator, size: int = 1024, shelves: int = 5) -> Texture:
    """Return the front of a filled bookshelf."""
    image = tinted((66, 50, 38), 0.15 * grain(rng, size, 16, 0.8))
    height = size // shelves
    for shelf in range(shelves):
        floor, x = (shelf + 1) * height - 14, 16
        while x < size - 60:
            width, tall = int(rng.integers(16, 56)), int(height * rng.uniform(0.6, 0.88))
            if rng.random() < 0.9:
                cv2.rectangle(image, (x, floor - tall), (x + width - 3, floor), rng.uniform(30, 215, 3).tolist(), -1)
                band = floor - int(tall * rng.uniform(0.2, 0.8))
                cv2.rectangle(image, (x, band), (x + width - 3, band + 12), rng.uniform(90, 235, 3).tolist(), -1)
            x += width
        image[floor : floor + 14] = tinted((122, 92, 62), 0.1 * grain(rng, size, 32, 0.8)[:14])
    return image


def door(rng: np.random.Generator, size: int = 1024) -> Texture:
    """Return a door with frame, panels, handle, a sign and scuffs."""
    image = planks(rng, size, 3, rng.uniform(90, 160, 3).tolist())
    cv2.rectangle(image, (0, 0), (size - 1, size - 1), (88, 82, 74), 60)
    for y0, y1 in ((0.12, 0.45), (0.55, 0.9)):
        cv2.rectangle(image, (170, int(y0 * size)), (size - 170, int(y1 * size)), (60, 50, 40), 8)
    cv2.rectangle(image, (size - 160, size // 2 - 50), (size - 120, size // 2 + 40), (190, 186, 176), -1)
    cv2.rectangle(image, (330, 210), (690, 330), (216, 214, 204), -1)
    _word(rng, image, (350, 300), 2.2, (34, 34, 40), 5)
    chips(rng, image, 120, (2.0, 12.0), [(70, 56, 44), (186, 170, 150)])
    return image


def stone(rng: np.random.Generator, colour: Colour = (136, 130, 122), size: int = 1024) -> Texture:
    """Return broken stone or concrete with pebbles and cracks."""
    image = tinted(colour, 0.17 * grain(rng, size, 8, 0.8))
    chips(rng, image, 1100, (2.5, 14.0), [(170, 164, 154), (88, 84, 80), (150, 116, 92), (110, 108, 106)])
    cracks(rng, image, 10)
    return stains(rng, image, 0.2)


def _word(
    rng: np.random.Generator, image: Texture, at: tuple[int, int], scale: float, ink: Colour, thickness: int
) -> None:
    text = "".join(rng.choice(list(LETTERS), int(rng.integers(4, 9))))
    font = FONTS[int(rng.integers(len(FONTS)))]
    cv2.putText(image, text, at, font, scale, tuple(float(v) for v in ink), thickness, cv2.LINE_AA)


def _print_lines(
    rng: np.random.Generator, image: Texture, at: tuple[int, int], count: int, width_px: int, scale: float, ink: Colour
) -> None:
    """Print ``count`` lines of random words, 30 px apart at scale .75."""
    font, tone = FONTS[0], tuple(float(v) for v in ink)
    for line in range(count):
        text = " ".join("".join(rng.choice(list(LETTERS), int(rng.integers(2, 9)))) for _ in range(9))
        text = text[: max(4, int(width_px / (19.0 * scale)))]
        cv2.putText(image, text, (at[0], at[1] + int(line * 40 * scale)), font, scale, tone, 2, cv2.LINE_AA)
