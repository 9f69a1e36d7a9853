"""Camera frames as JPEG images for the page, made as the frames arrive: the operator need not wait for the estimate."""

import queue
from collections.abc import Callable

import cv2

from snakeslam.messages import CameraFrame
from snakeslam.runtime.bus.topics import JpegImage

NS = 1e-9
PERIOD_S = 0.05
JPEG_QUALITY = 80


class JpegEncoder:
    """Encodes frames and passes the images to ``put``: the newest frame first, at most 20 a second of camera time."""

    def __init__(self, put: Callable[[JpegImage], None]) -> None:
        self._put = put
        self._frames: queue.SimpleQueue[CameraFrame] = queue.SimpleQueue()
        self._encoded_ns: int | None = None

    def add(self, frame: CameraFrame) -> None:
        """Add a frame to be encoded by ``iterate``; from any thread, returns at once."""
        self._frames.put(frame)

    def iterate(self, timeout_s: float = 0.1) -> None:
        """Wait for a frame and encode the newest one that was added; older ones are left out."""
        try:
            frame = self._frames.get(timeout=timeout_s)
            while not self._frames.empty():
                frame = self._frames.get_nowait()
        except queue.Empty:
            return
        self.encode(frame)

    def encode(self, frame: CameraFrame) -> None:
        """Encode ``frame`` now and pass it on, if an image is due."""
        if self._due(frame.t_ns):
            self._encoded_ns = frame.t_ns
            self._put(jpeg_of(frame))

    def _due(self, t_ns: int) -> bool:
        """Return whether an image is due by the camera's own time, which begins again with another robot node."""
        since_s = float("inf") if self._encoded_ns is None else (t_ns - self._encoded_ns) * NS
        return since_s >= 0.9 * PERIOD_S or since_s < 0.0


def jpeg_of(frame: CameraFrame) -> JpegImage:
    """Return ``frame`` as a JPEG image."""
    bgr = frame.gray if frame.rgb is None else cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)
    _, jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    height, width = frame.gray.shape
    return JpegImage(frame.t_ns, frame.seq, width, height, jpeg.tobytes())
