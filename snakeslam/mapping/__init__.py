"""Keyframe chunks of coloured points, and their export."""
