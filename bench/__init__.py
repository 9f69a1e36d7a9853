"""Budgets as figures: ``make bench``."""
