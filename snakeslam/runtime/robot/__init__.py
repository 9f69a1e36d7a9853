"""The robot's controller and its safety: deadman, E-stop, limits, governor."""
