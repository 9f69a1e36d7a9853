"""Corners found in an image and tracked from frame to frame."""
