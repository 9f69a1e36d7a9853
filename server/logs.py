"""The server's log: structlog's events, and warnings of the libraries, on standard error in one form."""

import logging

import structlog

from snakeslam.runtime.process.logs import Repeats, StandardError, log_to_stderr


def configure_logs() -> None:
    """Send everything to standard error."""
    shared, renderer = log_to_stderr()
    handler = logging.StreamHandler(StandardError())
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, renderer],
        )
    )
    handler.addFilter(Repeats().filter)
    for name in ("uvicorn", "asyncio", "websockets"):
        library = logging.getLogger(name)
        library.handlers, library.propagate = [handler], False
        library.setLevel(logging.WARNING)
