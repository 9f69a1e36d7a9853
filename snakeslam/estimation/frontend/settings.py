"""Settings of feature detection and tracking."""

from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class FrontendSettings(Settings):
    """Feature detection and tracking."""

    max_tracks: Annotated[int, Field(ge=20, le=2000)] = 200
    """Features tracked at most."""
    min_distance_px: Annotated[float, Field(ge=4)] = 20.0
    """Distance between features in px."""
    fast_threshold: Annotated[int, Field(ge=2, le=100)] = 12
    """FAST contrast threshold in grey levels; halved in images that give too few corners."""
    klt_window_px: Annotated[int, Field(ge=5, le=61)] = 13
    """Side of the window that KLT matches, in px."""
    klt_levels: Annotated[int, Field(ge=0, le=6)] = 2
    """Levels of the image pyramid above the image itself."""
    ransac_threshold_px: Positive = 1.5
    """Features further than this from the epipolar line of the common motion are dropped, in px."""
