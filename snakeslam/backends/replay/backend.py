"""A recording played back packet by packet."""

from collections.abc import Sequence
from pathlib import Path

from snakeslam.backends.base import Backend, Recorded
from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.messages import CameraFrame, GroundTruth, JointTarget, Packet
from snakeslam.recording.datasets import open_recording
from snakeslam.recording.settings import ReplaySettings
from snakeslam.robot.model import SnakeModel


class ReplayBackend(Backend, Recorded):
    """Yields a recording's packets in time order; opening it checks all tables and images (InputError)."""

    def __init__(self, path: Path, settings: ReplaySettings) -> None:
        self.recording = open_recording(path, settings)
        frames = self.recording.frames
        imu = self.recording.imu
        first_ns = frames[0].t_ns if imu is None else min(frames[0].t_ns, int(imu.t_ns[0]))
        start_ns = first_ns + round(settings.start_s * 1e9)
        if start_ns > frames[-1].t_ns:
            length_s = (frames[-1].t_ns - first_ns) / 1e9
            raise InputError("replay.start_s", f"{settings.start_s:g} is past the end", f"less than {length_s:.3f} s")
        self._packets = self.recording.packets(start_ns)
        self._first_frame = next(k for k, frame in enumerate(frames) if frame.t_ns >= start_ns)
        self._truth = [truth for truth in self.recording.truth if truth.t_ns >= start_ns]
        self._taken = 0
        self._ended = False
        self._start_ns = start_ns
        self._t_ns = start_ns

    @property
    def simulated(self) -> bool:
        """False: the time is that of the recording."""
        return False

    @property
    def moves(self) -> bool:
        """False: nothing can be moved any more."""
        return False

    @property
    def recorded(self) -> Recorded:
        """The backend itself."""
        return self

    @property
    def start_ns(self) -> int:
        """Time at which playing starts."""
        return self._start_ns

    @property
    def seed(self) -> int | None:
        """Seed of the recorded session, None where it is not known."""
        return self.recording.seed

    @property
    def has_truth(self) -> bool:
        """Whether the true motion was recorded."""
        return bool(self.recording.truth)

    @property
    def rig(self) -> SensorRig:
        """Calibration of the recording's sensors."""
        return self.recording.rig

    @property
    def model(self) -> SnakeModel | None:
        """The robot whose joints were recorded, None without."""
        return None if self.recording.joints is None else self.recording.joints.model

    @property
    def notes(self) -> tuple[str, ...]:
        """What is odd about the recording's files and was read nevertheless, a line each."""
        return self.recording.notes

    @property
    def t_ns(self) -> int:
        """Stamp of the newest packet."""
        return self._t_ns

    @property
    def end_ns(self) -> int:
        """Stamp of the last packet."""
        return self.recording.frames[-1].t_ns

    @property
    def frame_stamps_ns(self) -> list[int]:
        """Stamps of the camera frames that are played, in order."""
        return [frame.t_ns for frame in self.recording.frames[self._first_frame :]]

    def read_frame(self, k: int) -> CameraFrame:
        """Return the ``k``-th of the frames that are played, from disk; InputError names a damaged file."""
        return self.recording.read_frame(self._first_frame + k)

    def frame_name(self, k: int) -> str:
        """Return the path of the ``k``-th image that is played."""
        return str(self.recording.frames[self._first_frame + k].image)

    def step(self, target: JointTarget | None) -> Sequence[Packet] | None:
        """Return the next packet, or None at the end; a target has nothing to move here."""
        del target
        packet = next(self._packets, None)
        if packet is None:
            self._ended = True
            return None
        self._t_ns = packet.t_ns
        return [packet]

    def read_ground_truth(self) -> Sequence[GroundTruth]:
        """Return the truth since the last call; after the end also the one sample beyond, to interpolate with."""
        last = self._taken
        while last < len(self._truth) and self._truth[last].t_ns <= self._t_ns:
            last += 1
        if self._ended and last < len(self._truth) and (last == 0 or self._truth[last - 1].t_ns < self._t_ns):
            last += 1
        taken, self._taken = self._truth[self._taken : last], last
        return taken

    def close(self) -> None:
        """Nothing stays open between packets."""
