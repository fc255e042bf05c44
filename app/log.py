"""Structured logs: coloured on a terminal, JSON elsewhere. Events are `noun.past_verb` with fields that carry units."""

from __future__ import annotations

import logging
import sys
from typing import Any

import structlog


def configure_logging(*, verbose: bool = False, quiet: bool = False) -> None:
    """Send log events to standard error; standard output belongs to the commands' results.

    Args:
        verbose: From debug level on.
        quiet: Only what is wrong; for commands that show the same things in another way.
    """
    level = logging.DEBUG if verbose else logging.ERROR if quiet else logging.INFO
    renderer: Any = structlog.dev.ConsoleRenderer() if sys.stderr.isatty() else structlog.processors.JSONRenderer()
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=structlog.PrintLoggerFactory(file=sys.stderr),
        cache_logger_on_first_use=False,
    )


def get_logger(name: str) -> Any:
    """A logger that names its part of the application."""
    # Not bind(): that would settle the configuration while modules are imported, before configure_logging has run.
    return structlog.get_logger(part=name)
