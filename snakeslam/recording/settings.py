"""Settings of a recording that is played back."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings


class ReplaySettings(Settings):
    """How a recording is read."""

    calibration: Path | None = None
    """Kalibr-form file for a TUM RGB-D folder that has no calibration.yaml and no known name (freiburg1, fr2, ...)."""
    start_s: Annotated[float, Field(ge=0)] = 0.0
    """Seconds to leave out at the beginning."""
    association_ms: Annotated[float, Field(gt=0, le=100)] = 20.0
    """Largest difference between a colour image's stamp and its depth image's."""
