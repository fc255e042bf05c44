"""Text that a thread of its own writes: nothing waits for the reader, what finds no room is counted, order is kept."""

from __future__ import annotations

import io
import os
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import TextIO

import pytest

from app.output import BackgroundStream


@dataclass
class Pipe:
    """A pipe that nobody reads until it is told to."""

    out: TextIO
    reader: int

    def read(self, until: str, timeout_s: float = 10.0) -> str:
        """All that comes, up to and with some text."""
        text, end_s = "", time.monotonic() + timeout_s
        while until not in text and time.monotonic() < end_s:
            text += os.read(self.reader, 65536).decode()
        return text


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    reader, writer = os.pipe()
    with os.fdopen(writer, "w", encoding="utf-8", buffering=1) as out:
        yield Pipe(out, reader)
        os.close(reader)


class Broken(io.StringIO):
    """A terminal that fails in a way of its own."""

    def write(self, text: str) -> int:
        raise RuntimeError("no such terminal")


def fill(pipe: Pipe, *, blocking: bool = True) -> None:
    """Until it takes no more."""
    os.set_blocking(pipe.out.fileno(), False)
    with suppress(BlockingIOError):
        while True:
            os.write(pipe.out.fileno(), b"\n" * 4096)
    os.set_blocking(pipe.out.fileno(), blocking)


def numbered(first: int, last: int) -> list[str]:
    """Lines of a hundred characters."""
    return [f"{k:099d}\n" for k in range(first, last)]


def test_text_is_written_in_order_and_whole_by_the_end():
    below = io.StringIO()
    stream = BackgroundStream(below)
    lines = numbered(0, 500)
    for line in lines:
        stream.write(line)
    assert stream.close()
    assert below.getvalue() == "".join(lines)


def test_text_of_before_comes_first(pipe):
    pipe.out.write("begun, ")
    stream = BackgroundStream(pipe.out)
    stream.write("ended\n")
    assert pipe.read("\n") == "begun, ended\n"
    assert stream.close()


def test_text_that_the_encoding_lacks_is_written_escaped(tmp_path):
    with (tmp_path / "log").open("w", encoding="ascii") as below:
        stream = BackgroundStream(below)
        stream.write("10 \u00b0\n")
        assert stream.close()
    assert (tmp_path / "log").read_text() == "10 \\xb0\n"


def test_write_to_a_full_pipe_does_not_wait_and_the_lines_left_out_are_told_in_their_place(pipe):
    stream = BackgroundStream(pipe.out, lambda lines: f"{lines} left out\n", limit_chars=10_000)
    start_s = time.monotonic()
    fill(pipe)
    for line in numbered(0, 2000):  # 100 lines fill the queue
        stream.write(line)
    assert time.monotonic() - start_s < 5.0  # for ever, where it waits
    assert stream.is_behind
    text = pipe.read("left out\n").lstrip("\n")
    for line in numbered(2000, 2010):
        stream.write(line)
    text += pipe.read(f"{2009:099d}\n")
    assert stream.close()
    kept, _, after = text.partition("left out\n")
    *kept_lines, count = kept.splitlines()
    assert kept_lines == [line.rstrip("\n") for line in numbered(0, len(kept_lines))]
    assert len(kept_lines) == 100
    assert int(count) == 2000 - len(kept_lines)
    assert after == "".join(numbered(2000, 2010))


def test_end_with_a_full_pipe_is_bounded_in_time(pipe):
    stream = BackgroundStream(pipe.out)
    fill(pipe)
    stream.write("to nobody\n")
    start_s = time.monotonic()
    assert not stream.close(0.2)
    assert 0.2 <= time.monotonic() - start_s < 5.0


def test_write_after_the_end_is_left_out():
    below = io.StringIO()
    stream = BackgroundStream(below)
    stream.write("first\n")
    assert stream.close()
    stream.write("late\n")
    assert below.getvalue() == "first\n"


def test_queue_that_is_full_in_one_line_takes_the_next_that_fits():
    stream = BackgroundStream(below := io.StringIO(), lambda lines: f"{lines} left out\n", limit_chars=100)
    stream.write("x" * 100 + "\n")
    stream.write("short\n")
    assert stream.close()
    assert below.getvalue() == "1 left out\nshort\n"


def test_stream_that_fails_ends_nothing():
    stream = BackgroundStream(Broken())
    for line in numbered(0, 10):
        stream.write(line)
    assert stream.close()


def test_pipe_that_nobody_holds_any_more_ends_nothing():
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w", encoding="utf-8") as out:
        stream = BackgroundStream(out)
        stream.write("to nobody\n")
        assert stream.close()


def test_pipe_that_was_made_non_blocking_is_waited_for_by_the_thread(pipe):
    stream = BackgroundStream(pipe.out)
    fill(pipe, blocking=False)
    for line in numbered(0, 1500):
        stream.write(line)
    assert pipe.read(f"{1499:099d}\n").lstrip("\n") == "".join(numbered(0, 1500))
    assert stream.close()


def test_lines_of_several_threads_stay_whole():
    stream = BackgroundStream(below := io.StringIO())
    threads = [
        threading.Thread(target=lambda mark=mark: [stream.write(mark * 50 + "\n") for _ in range(200)])
        for mark in "abc"
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert stream.close()
    assert sorted(below.getvalue().splitlines()) == sorted(mark * 50 for mark in "abc" for _ in range(200))


def test_stream_knows_what_is_below_it(pipe):
    stream = BackgroundStream(pipe.out)
    assert (stream.fileno(), stream.isatty(), stream.encoding) == (pipe.out.fileno(), False, "utf-8")
    assert not stream.is_behind
