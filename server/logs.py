"""Structured logs on standard error: for people on a terminal, JSON elsewhere or by SNAKESLAM_LOG=json."""

import logging
import os
import sys

import structlog
from structlog.typing import Processor

VARIABLE = "SNAKESLAM_LOG"


def configure_logs() -> None:
    """Send structlog's events, and warnings of the libraries, to standard error in one form."""
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
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, renderer],
        )
    )
    library = logging.getLogger("uvicorn")
    library.handlers, library.propagate = [handler], False
    library.setLevel(logging.WARNING)
