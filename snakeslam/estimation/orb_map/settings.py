"""Settings of a map of ORB landmarks: detection, matching, keyframes and their adjustment."""

from typing import Annotated

from pydantic import Field

from snakeslam.settings import Settings

Positive = Annotated[float, Field(gt=0)]


class OrbMapSettings(Settings):
    """ORB features of RGB-D keyframes and the pose found among them."""

    features: Annotated[int, Field(ge=100, le=5000)] = 1000
    """ORB features in a frame."""
    fast_threshold: Annotated[int, Field(ge=2, le=100)] = 7
    """FAST contrast threshold in grey levels."""
    pyramid_levels: Annotated[int, Field(ge=1, le=12)] = 8
    """Levels of the image pyramid."""
    pyramid_scale: Annotated[float, Field(gt=1.01, le=2.0)] = 1.2
    """Ratio between two levels."""
    search_px: Positive = 40.0
    """Radius around the predicted place of a map point for the first search, for a focal length of 500 px."""
    refine_px: Positive = 8.0
    """Radius of the second search, once the pose is about known."""
    max_hamming: Annotated[int, Field(ge=10, le=128)] = 64
    """Bits of 256 in which the descriptors of a match may differ."""
    match_ratio: Annotated[float, Field(gt=0.5, le=1.0)] = 0.85
    """A match whose distance is above this part of the second best one's is ambiguous."""
    min_inliers: Annotated[int, Field(ge=6)] = 12
    """With fewer points in agreement a frame has no pose of its own."""
    few_inliers: Annotated[int, Field(ge=6)] = 40
    """Fewer points in agreement degrade the verdict."""
    relocalise_inliers: Annotated[int, Field(ge=6)] = 25
    """Points in agreement that a pose found without a prediction must have."""
    keyframe_angle_deg: Positive = 10.0
    """A frame turned this much since the last keyframe becomes one, in deg."""
    keyframe_distance_m: Positive = 0.1
    """A frame this far from the last keyframe becomes one, in m."""
    keyframe_matched: Annotated[float, Field(gt=0, le=1)] = 0.5
    """A frame becomes a keyframe when less than this part of its features with depth are in the map."""
    max_points: Annotated[int, Field(ge=1000, le=500_000)] = 30_000
    """Points in the map; beyond it those seen least go first."""
    window: Annotated[int, Field(ge=1, le=30)] = 7
    """Keyframes adjusted together when a new one comes; as many more hold them."""
    adjust_rounds: Annotated[int, Field(ge=0, le=20)] = 4
    """Rounds of that adjustment."""
