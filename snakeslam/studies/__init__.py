"""Experiments and what is measured in them."""
