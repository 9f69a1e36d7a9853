"""Camera frames as pictures for the page, made as they come: an operator's eyes do not wait for the estimate."""

import queue
from collections.abc import Callable

import cv2

from snakeslam.messages import CameraFrame
from snakeslam.runtime.bus.topics import Picture

NS = 1e-9
PERIOD_S = 0.05
JPEG_QUALITY = 80


class Pictures:
    """Makes JPEGs of what it hears, the newest first and at most 20 for a second of the camera's time."""

    def __init__(self, put: Callable[[Picture], None]) -> None:
        self._put = put
        self._heard: queue.SimpleQueue[CameraFrame] = queue.SimpleQueue()
        self._shown_ns: int | None = None

    def hear(self, frame: CameraFrame) -> None:
        """Take a frame; from any thread, returns at once."""
        self._heard.put(frame)

    def turn(self, timeout_s: float = 0.1) -> None:
        """Wait for a frame and make its picture; frames that a newer one has overtaken are left out."""
        try:
            frame = self._heard.get(timeout=timeout_s)
            while not self._heard.empty():
                frame = self._heard.get_nowait()
        except queue.Empty:
            return
        self.show(frame)

    def show(self, frame: CameraFrame) -> None:
        """Make the picture of ``frame`` now, if one is due."""
        if self._due(frame.t_ns):
            self._shown_ns = frame.t_ns
            self._put(picture_of(frame))

    def _due(self, t_ns: int) -> bool:
        """By the camera's own time, which begins anew with another robot node."""
        since_s = float("inf") if self._shown_ns is None else (t_ns - self._shown_ns) * NS
        return since_s >= 0.9 * PERIOD_S or since_s < 0.0


def picture_of(frame: CameraFrame) -> Picture:
    """Return ``frame`` as a JPEG."""
    bgr = frame.gray if frame.rgb is None else cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    height, width = frame.gray.shape
    return Picture(frame.t_ns, frame.seq, width, height, jpeg.tobytes())
