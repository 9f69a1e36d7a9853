"""Settings of the map."""

from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class MappingSettings(Settings):
    """Selection of keyframes and of their points."""

    keyframe_distance_m: Positive = 0.15
    """A frame this far from every keyframe of similar orientation becomes one, in m."""
    keyframe_angle_deg: Annotated[float, Field(gt=0, le=180)] = 20.0
    """A frame rotated this much from every near keyframe becomes one, in deg."""
    max_rate_deg_s: Positive = 60.0
    """Frames that rotate faster are left out, since their images are blurred, in deg/s."""
    voxel_m: Positive = 0.02
    """One point is kept in each voxel of this size, in m."""
    depth_min_m: Positive = 0.25
    """The nearest point kept, in m."""
    depth_max_m: Positive = 4.0
    """The farthest point kept, in m."""
    edge_ratio: Positive = 0.06
    """Pixels whose depth differs from a neighbour's by more than this share of it are edges, and left out."""
    max_points: Annotated[int, Field(ge=100, le=200_000)] = 4000
    """Points of one chunk at most; more are thinned out evenly."""
