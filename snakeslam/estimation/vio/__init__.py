"""estimator.mode = vio and fused: the visual-inertial filter over a sliding window, one frame at a time."""
