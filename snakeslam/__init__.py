"""Gait control, visual-inertial SLAM and a browser dashboard for snake robots."""
