"""Recordings as a backend."""
