"""Settings of a recording that is played back."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings


class ReplaySettings(Settings):
    """How a recording is read."""

    recording: Path | None = None
    """Folder of the recording that ``backend: replay`` plays; ``snakeslam replay PATH`` sets both."""
    calibration: Path | None = None
    """Calibration file in Kalibr's or OpenVINS's form, used instead of the recording's own; null: the recording's own,
    or for a TUM RGB-D folder without one the benchmark's, by a word of its name (freiburg1, fr2, ...)."""
    start_s: Annotated[float, Field(ge=0)] = 0.0
    """Seconds to leave out at the beginning."""
    association_ms: Annotated[float, Field(gt=0, le=100)] = 20.0
    """Largest difference between a colour image's stamp and its depth image's."""
