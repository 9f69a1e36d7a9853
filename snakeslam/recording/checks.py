"""Whether a recording's streams can be what they are said to be: images, rates, clocks.

What is unusable is an InputError; what is odd but usable is a note, one line that names the file.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from snakeslam.errors import InputError
from snakeslam.recording.images import check_image, used_bits, usual_bits
from snakeslam.recording.recording import FrameFile, Recording

Stamps = NDArray[np.int64]
WRONG_UNIT = 50.0
"""A rate that differs from the calibration's by this factor comes from stamps in another unit or of another sensor."""
ODD_RATE = 1.25
FRAME_RATES_HZ = (0.05, 5_000.0)
IMU_RATES_HZ = (1.0, 50_000.0)
JOINT_RATES_HZ = (0.5, 10_000.0)
GAP_NS, GAP_PERIODS = 100_000_000, 10
BRIGHTNESS_SAMPLES = 16


def with_checked_images(recording: Recording) -> Recording:
    """Return the recording with images that exist, are whole and have the calibration's size; InputError otherwise.

    An image that is missing may stand there with another extension. 16-bit images may use fewer bits.
    """
    frames, notes = _with_other_extensions(recording.frames)
    headers = [check_image(frame.image, recording.rig.cam0.resolution) for frame in frames]
    for frame in frames:
        if frame.depth is not None:
            check_image(frame.depth, recording.rig.cam0.resolution, depth=True)
    deep = [frame.image for frame, header in zip(frames, headers, strict=True) if header.bits == 16]
    bits = _gray_bits(deep)
    if bits < 16:
        notes.append(f"{deep[0].parent}: the images use {bits} of their 16 bits")
    return replace(recording, frames=frames, gray_bits=bits, notes=(*recording.notes, *notes))


def _gray_bits(images: Sequence[Path]) -> int:
    """Return the bits that 16-bit images use, judged by the brightest sample of some; 16 without such images."""
    if not images:
        return 16
    chosen = np.unique(np.linspace(0, len(images) - 1, BRIGHTNESS_SAMPLES).round().astype(int))
    return usual_bits(max(used_bits(images[k]) for k in chosen))


def _with_other_extensions(frames: Sequence[FrameFile]) -> tuple[tuple[FrameFile, ...], list[str]]:
    """Replace images that are missing by the only file of the same name with another extension, and say so."""
    missing = [frame for frame in frames if not frame.image.exists()]
    if not missing:
        return tuple(frames), []
    others: dict[tuple[Path, str], list[Path]] = {}
    for folder in {frame.image.parent for frame in missing}:
        for path in folder.iterdir() if folder.is_dir() else ():
            others.setdefault((folder, path.stem.lower()), []).append(path)
    found = [others.get((frame.image.parent, frame.image.stem.lower()), []) for frame in missing]
    images = {frame.image: paths[0] for frame, paths in zip(missing, found, strict=True) if len(paths) == 1}
    more = f", {len(images) - 1} more likewise" if len(images) > 1 else ""
    notes = [f"{image}: is read from {other.name}{more}" for image, other in images.items()]
    return tuple(replace(frame, image=images.get(frame.image, frame.image)) for frame in frames), notes[:1]


def median_rate_hz(t_ns: Stamps) -> float | None:
    """Return the rate of the median spacing of stamps; None below two."""
    return 1e9 / float(np.median(np.diff(t_ns))) if len(t_ns) > 1 else None


def check_rate(
    path: Path, t_ns: Stamps, said_hz: float | None, possible_hz: tuple[float, float], unit: str
) -> list[str]:
    """Return a note where the stamps' median spacing disagrees with the calibration's rate.

    InputError where it is off by a factor that another unit of time brings, or no such sensor has such a rate.
    """
    found_hz = median_rate_hz(t_ns)
    if found_hz is None:
        return []
    problem = f"the timestamps are {1e3 / found_hz:.6g} ms apart, {found_hz:.6g} Hz"
    least_hz, most_hz = possible_hz
    if said_hz is None:
        if not least_hz <= found_hz <= most_hz:
            raise InputError(str(path), problem, f"{least_hz:g} to {most_hz:g} Hz, timestamps in {unit}")
        return []
    ratio = max(found_hz / said_hz, said_hz / found_hz)
    if ratio >= WRONG_UNIT:
        raise InputError(str(path), f"{problem}, the calibration says {said_hz:g} Hz", f"timestamps in {unit}")
    return [f"{path}: {problem}, the calibration says {said_hz:g} Hz"] if ratio > ODD_RATE else []


def check_overlap(path: Path, imu_ns: Stamps, frames_ns: Stamps) -> list[str]:
    """Return notes on frames without IMU samples around them; InputError where no sample lies within their time."""
    if imu_ns[0] > frames_ns[-1] or imu_ns[-1] < frames_ns[0]:
        imu, frames = (f"{times[0] / 1e9:.3f} to {times[-1] / 1e9:.3f} s" for times in (imu_ns, frames_ns))
        problem = f"no sample lies within the frames' time (samples {imu}, frames {frames})"
        raise InputError(str(path), problem, "timestamps of one clock")
    early = int(np.count_nonzero(frames_ns < imu_ns[0]))
    late = int(np.count_nonzero(frames_ns > imu_ns[-1] + GAP_NS))
    notes: list[str] = []
    if early or late:
        notes.append(f"{path}: of {len(frames_ns)} frames {early} lie before its first sample, {late} after its last")
    gaps_ns = np.diff(imu_ns)
    if len(gaps_ns) and (gap_ns := int(gaps_ns.max())) > max(GAP_NS, GAP_PERIODS * int(np.median(gaps_ns))):
        at_s = (int(imu_ns[int(gaps_ns.argmax())]) - int(frames_ns[0])) / 1e9
        notes.append(f"{path}: no sample for {gap_ns / 1e9:.3f} s from {at_s:.3f} s after the first frame")
    return notes


def check_truth(path: Path, truth_ns: Stamps, frames_ns: Stamps) -> list[str]:
    """Return a note where no true pose lies within the frames' time."""
    if not len(truth_ns) or np.any((truth_ns >= frames_ns[0]) & (truth_ns <= frames_ns[-1])):
        return []
    times = (f"{stamps[0] / 1e9:.3f} to {stamps[-1] / 1e9:.3f} s" for stamps in (truth_ns, frames_ns))
    return ["{}: the ground truth does not overlap the frames in time ({}, frames {})".format(path, *times)]
