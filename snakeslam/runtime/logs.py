"""Structured logs on standard error, which leave standard output to others: JSON, on a terminal in words."""

import logging
import os
import sys

import structlog
from structlog.typing import Processor

VARIABLE = "SNAKESLAM_LOG"


def log_to_stderr() -> tuple[list[Processor], Processor]:
    """Send structlog's events to standard error; return the processors that others share, and the renderer."""
    as_json = os.environ.get(VARIABLE, "text" if sys.stderr.isatty() else "json") == "json"
    shared: list[Processor] = [
        structlog.stdlib.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
    ]
    renderer: Processor = structlog.processors.JSONRenderer() if as_json else structlog.dev.ConsoleRenderer()
    structlog.configure(
        processors=[*shared, renderer],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
    )
    return shared, renderer
