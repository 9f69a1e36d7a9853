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
    """Radius of the first search around the predicted pixel of a map point, for a focal length of 500 px."""
    refine_px: Positive = 8.0
    """Radius of the second search, from the pose of the first."""
    max_hamming: Annotated[int, Field(ge=10, le=128)] = 64
    """Bits of 256 in which the descriptors of a match may differ."""
    match_ratio: Annotated[float, Field(gt=0.5, le=1.0)] = 0.85
    """A match is ambiguous if its distance exceeds this share of the second best one's."""
    min_inliers: Annotated[int, Field(ge=6)] = 12
    """With fewer inliers a frame has no pose of its own."""
    few_inliers: Annotated[int, Field(ge=6)] = 40
    """Fewer inliers degrade the verdict."""
    relocalise_inliers: Annotated[int, Field(ge=6)] = 25
    """Inliers that a pose found without a prediction must have."""
    keyframe_angle_deg: Positive = 10.0
    """A frame rotated this much from every near keyframe becomes one, in deg."""
    keyframe_distance_m: Positive = 0.1
    """A frame this far from every keyframe becomes one, in m."""
    keyframe_matched: Annotated[float, Field(gt=0, le=1)] = 0.5
    """A frame becomes a keyframe when less than this share of its features with depth are in the map."""
    max_points: Annotated[int, Field(ge=1000, le=500_000)] = 30_000
    """Points in the map at most; those observed least are removed first."""
    window: Annotated[int, Field(ge=1, le=30)] = 7
    """Keyframes whose poses a new one adjusts in local bundle adjustment; as many more are held."""
    adjust_rounds: Annotated[int, Field(ge=0, le=20)] = 4
    """Iterations of that adjustment."""
