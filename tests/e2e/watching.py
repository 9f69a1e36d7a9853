"""What a test sees of the page: pixels, numbers, and what the browser complained of."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar
from urllib.parse import urlsplit

import cv2
import numpy as np
from playwright.sync_api import ConsoleMessage, Error, Frame, Locator, Page, Request

T = TypeVar("T")
DRAW_S = 90.0

# Looked at inside the page: to carry an image over as JSON costs more than to draw it.
LOOK = """canvas => {
    const {width, height} = canvas;
    // What a worker draws on is looked at through a canvas of one's own.
    const own = document.createElement('canvas');
    [own.width, own.height] = [width, height];
    const context = own.getContext('2d', {willReadFrequently: true});
    context.drawImage(canvas, 0, 0);
    const data = context.getImageData(0, 0, width, height).data;
    let hash = 0, sum = 0, squares = 0, drawn = 0, colourful = 0;
    for (let i = 0; i < data.length; i += 4) {
        const [r, g, b, a] = [data[i], data[i + 1], data[i + 2], data[i + 3]];
        hash = (31 * hash + r + 7 * g + 13 * b + 17 * a) | 0;
        sum += g;
        squares += g * g;
        if (a > 0) drawn += 1;
        if (a > 100 && Math.max(r, g, b) - Math.min(r, g, b) > 60) colourful += 1;
    }
    const mean = sum / (width * height || 1);
    return {width, height, hash, drawn, colourful, variance: squares / (width * height || 1) - mean * mean};
}"""


@dataclass(frozen=True)
class Look:
    """A 2D canvas as it was: how many pixels are drawn at all, how many in a colour, and how uneven they are."""

    width: int
    height: int
    hash: int
    drawn: int
    colourful: int
    variance: float


def poll(look: Callable[[], T], accept: Callable[[T], Any], what: str, timeout_s: float = DRAW_S) -> T:
    """Return the first seen value that is accepted; say what was waited for when none is."""
    until = time.monotonic() + timeout_s
    while not accept(seen := look()):
        assert time.monotonic() < until, f"{what}: not within {timeout_s:g} s, last seen {str(seen)[:200]}"
        time.sleep(0.1)
    return seen


def look_at(canvas: Locator) -> Look:
    """Look at a 2D canvas."""
    return Look(**canvas.evaluate(LOOK))


def screenshot_rgb(locator: Locator) -> np.ndarray:
    """What the screen shows of an element, (H, W, 3) uint8."""
    png = np.frombuffer(locator.screenshot(), dtype=np.uint8)
    return cv2.cvtColor(cv2.imdecode(png, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def viewer_frame(page: Page) -> Frame:
    """The frame of the 3D view, once it is there."""
    frames = poll(lambda: [f for f in page.frames if "/viewer" in f.url], bool, "the 3D view's frame")
    return frames[0]


def drawn_points(frame: Frame) -> int:
    """How many points WebGL has drawn in the last frame of the 3D view."""
    return frame.evaluate("() => window.__viserTestpoints?.rendererInfo?.render?.points ?? 0")


@dataclass
class Complaints:
    """Errors of the page's own scripts, and requests to anywhere but its server."""

    errors: list[str] = field(default_factory=list)
    outside: list[str] = field(default_factory=list)

    def watch(self, page: Page, host: str) -> None:
        def on_error(error: Error) -> None:
            # viser probes for eval, which its policy forbids, and goes on without.
            if "unsafe-eval" not in str(error):
                self.errors.append(str(error))

        def on_console(message: ConsoleMessage) -> None:
            if message.type == "error" and "/viewer" not in str(message.location.get("url", "")):
                self.errors.append(message.text)

        def on_request(request: Request) -> None:
            parts = urlsplit(request.url)
            if parts.scheme not in ("data", "blob") and parts.netloc != host:
                self.outside.append(request.url)

        page.on("pageerror", on_error)
        page.on("console", on_console)
        page.on("request", on_request)
