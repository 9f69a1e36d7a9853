"""Lie groups on numpy batches (``so3``, ``se3``), numeric Jacobians for tests, compiled helpers."""
