"""Structured logs: coloured on a terminal, JSON elsewhere. Events are `noun.past_verb` with fields that carry units.

A log or a display that nobody can read any more (a closed pipe, a terminal that hung up, a full disk) must not end a
flight: what can't be written is left out. Nor may one that nobody reads stop it (a terminal that is paused, a full
pipe): inside `standard_error_in_background` it is written by a thread of its own (app/output.py).
"""

from __future__ import annotations

import contextlib
import logging
import sys
from collections.abc import Callable, Iterator
from typing import Any, TextIO, cast

import structlog

from app.output import BackgroundStream


class _Unfailing:
    """As much of a text stream as structlog and rich write to; a write that fails is no error."""

    def __init__(self, stream: Callable[[], TextIO]) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError, ValueError):  # ValueError: closed, or not encodable
            self._stream().write(text)
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            self._stream().flush()

    def isatty(self) -> bool:
        return self._stream().isatty()

    def fileno(self) -> int:
        return self._stream().fileno()

    @property
    def encoding(self) -> str:
        return self._stream().encoding


def unfailing(stream: TextIO) -> TextIO:
    """A stream for people to look at, whose writes never fail."""
    return cast(TextIO, _Unfailing(lambda: stream))


@contextlib.contextmanager
def standard_error_in_background() -> Iterator[None]:
    """Whatever is written to standard error inside this is written by a thread of its own; at the end, what waits is
    written for a bounded time.
    """
    before = sys.stderr
    stream = BackgroundStream(before, _left_out)
    sys.stderr = cast(TextIO, stream)
    try:
        yield
    finally:
        stream.close()
        sys.stderr = before


def _left_out(lines: int) -> str:
    """The log event that tells how many lines were left out."""
    event: Any = {"event": "log.lines_left_out", "part": "log", "lines": lines, "why": "standard error was not read"}
    for process in structlog.get_config()["processors"]:
        event = process(None, "warning", event)
    return f"{event}\n"


# The present one, since a display that changes in place puts its own there: lines then go above it.
_STANDARD_ERROR = cast(TextIO, _Unfailing(lambda: sys.stderr))


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
        logger_factory=structlog.WriteLoggerFactory(file=_STANDARD_ERROR),
        cache_logger_on_first_use=False,
    )


def get_logger(name: str) -> Any:
    """A logger that names its part of the application."""
    # Not bind(): that would settle the configuration while modules are imported, before configure_logging has run.
    return structlog.get_logger(part=name)
