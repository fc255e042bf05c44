"""Trials spread over processes: each takes the next one that waits, and which one takes it changes nothing.

Workers are spawned, not forked: they begin from nothing, so a result depends on its seed alone. Numeric libraries have
one thread in each. Ctrl-C reaches the parent only, which keeps what is done and ends the workers.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import traceback
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from typing import Any, Generic, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
LOOK_S = 0.5
"""How often it is looked whether the workers still live."""
END_S = 5.0


class WorkerError(RuntimeError):
    """A worker's own error, or its end: a bug, or a machine without memory."""


@dataclass(frozen=True)
class Work(Generic[Job, Result]):
    """What the workers do; both functions must be importable by name.

    Attributes:
        prepare: Called once in each worker.
        do: Called for each job.
    """

    prepare: Callable[[], None]
    do: Callable[[Job], Result]


def run_jobs(work: Work[Job, Result], jobs: Sequence[Job], workers: int) -> Generator[tuple[int, Result], None, None]:
    """Results with the index of their job, as they come. Closing the iterator ends the workers.

    Raises:
        WorkerError: A worker failed.
    """
    context = multiprocessing.get_context("spawn")
    waiting: Any = context.Queue()
    done: Any = context.Queue()
    for item in enumerate(jobs):
        waiting.put(item)
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))  # read by the libraries as a worker loads them
    crew = [context.Process(target=_work, args=(work, waiting, done), daemon=True) for _ in range(workers)]
    try:
        for process in crew:
            process.start()
            waiting.put(None)
        yield from _collect(done, crew, len(jobs))
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        _end(crew)
        for channel in (waiting, done):
            channel.cancel_join_thread()
            channel.close()


def _collect(done: Any, crew: Sequence[BaseProcess], count: int) -> Iterator[tuple[int, Any]]:
    for _ in range(count):
        while True:
            try:
                index, result, fault = done.get(timeout=LOOK_S)
                break
            except queue.Empty:
                ended = [process.exitcode for process in crew if process.exitcode]
                if ended:
                    raise WorkerError(f"a worker ended by itself (exit code {ended[0]})") from None
        if fault is not None:
            raise WorkerError(fault)
        yield index, result


def _end(crew: Sequence[BaseProcess]) -> None:
    for process in crew:
        if process.pid is not None and process.is_alive():
            process.terminate()
    for process in crew:
        if process.pid is not None:
            process.join(END_S)


def _work(work: Work[Any, Any], waiting: Any, done: Any) -> None:
    """A worker's life."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # a terminal's Ctrl-C, or its end, goes to all: the parent decides
    work.prepare()
    while (item := waiting.get()) is not None:
        index, job = item
        try:
            done.put((index, work.do(job), None))
        except Exception:
            done.put((index, None, f"job {job!r}:\n{traceback.format_exc()}"))
            return
