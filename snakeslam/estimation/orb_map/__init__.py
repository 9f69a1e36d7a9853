"""A map of ORB landmarks from RGB-D keyframes, and the camera pose found in it."""
