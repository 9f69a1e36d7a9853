"""Measurements of the filter: reprojection of tracks and landmarks, zero velocity; each with its Jacobian."""
