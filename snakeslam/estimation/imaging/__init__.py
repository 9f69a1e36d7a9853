"""The camera model, depth at a pixel, and the roll that a rolling gait gives the image."""
