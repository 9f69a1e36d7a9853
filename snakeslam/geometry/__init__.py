"""Lie groups on numpy batches: ``so3``, ``se3``, and ``numeric`` Jacobians for tests."""
