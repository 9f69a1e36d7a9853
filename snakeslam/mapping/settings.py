"""Settings of the map."""

from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class MappingSettings(Settings):
    """When a keyframe is taken, and which of its points are kept."""

    keyframe_distance_m: Positive = 0.15
    """A frame this far from every keyframe that looks the same way becomes one."""
    keyframe_angle_deg: Annotated[float, Field(gt=0, le=180)] = 20.0
    """A frame turned this much against every keyframe that is near becomes one."""
    max_rate_deg_s: Positive = 60.0
    """Frames that turn faster are left out: their pictures are blurred."""
    voxel_m: Positive = 0.02
    """One point is kept in each cube of the world of this size."""
    depth_min_m: Positive = 0.25
    """The nearest point kept, in m."""
    depth_max_m: Positive = 4.0
    """The farthest point kept, in m."""
    edge_ratio: Positive = 0.06
    """Pixels whose depth differs from a neighbour's by more than this part of it are edges, and dropped."""
    max_points: Annotated[int, Field(ge=100, le=200_000)] = 4000
    """Points of one chunk; beyond it an even choice is kept."""
