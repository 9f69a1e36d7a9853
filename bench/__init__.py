"""Budgets as figures: ``make bench``."""

from snakeslam.threads import use_one_thread

use_one_thread()
