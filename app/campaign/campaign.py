"""A campaign: every scenario with its seeds, flown by workers, shown while it runs."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import cv2
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from app.campaign.figures import CampaignFigures, ScenarioFigures
from app.campaign.outcome import TrialResult
from app.campaign.trial import Course, fly_trial, load_course
from app.campaign.workers import Work, WorkerError, run_jobs
from app.log import configure_logging

TOLD_EACH_S = 30.0
"""Where there is no terminal for a bar, a line tells now and then how far it is."""


@dataclass(frozen=True, slots=True)
class Job:
    """One trial for a worker.

    Attributes:
        path: Of the scenario file.
        argument: What named it.
        seed: Of the trial.
    """

    path: Path
    argument: str
    seed: int


@dataclass(slots=True)
class Flown:
    """What is done so far.

    Attributes:
        courses: In their order.
        results: By the index of the job.
        wall_s: How long it took.
        interrupted: Ctrl-C ended it.
        fault: What a worker failed of, which ended it; None as a rule.
    """

    courses: tuple[Course, ...]
    results: dict[int, TrialResult] = field(default_factory=dict)
    wall_s: float = 0.0
    interrupted: bool = False
    fault: WorkerError | None = None

    @property
    def figures(self) -> CampaignFigures:
        """What it comes to; in the order of scenarios and seeds, whoever was done first."""
        ordered = [self.results[index] for index in sorted(self.results)]
        return CampaignFigures(
            tuple(
                ScenarioFigures(course.name, tuple(result for result in ordered if result.scenario == course.name))
                for course in self.courses
            ),
            self.wall_s,
        )


def fly_campaign(
    courses: tuple[Course, ...], paths: tuple[Path, ...], seeds: range, workers: int, console: Console
) -> Flown:
    """Fly them all. Ctrl-C keeps what is done, and so do a SIGTERM, the end of the terminal, and a worker that fails.

    Args:
        courses: The scenarios.
        paths: Their files.
        seeds: Of the trials of each.
        workers: Processes.
        console: Where to show how far it is.
    """
    jobs = [Job(path, course.argument, seed) for course, path in zip(courses, paths, strict=True) for seed in seeds]
    flown, start_s = Flown(courses), time.monotonic()
    simulated_s = 0.0
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[landed]} landed, {task.fields[rate]:.1f} simulated s a second"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    running = run_jobs(Work(_prepare, _fly), jobs, min(workers, len(jobs)))
    try:
        with _ended_by_signals(), Progress(*columns, console=console, transient=True) as progress:
            bar = progress.add_task(courses[0].name, total=len(jobs), landed=0, rate=0.0)
            told_s = start_s
            for index, result in running:
                flown.results[index] = result
                simulated_s += result.simulated_s
                landed = sum(one.landed for one in flown.results.values())
                if not console.is_terminal and time.monotonic() - told_s >= TOLD_EACH_S:
                    told_s = time.monotonic()
                    console.print(f"{len(flown.results)} of {len(jobs)} flown, {landed} landed", highlight=False)
                progress.update(
                    bar,
                    advance=1,
                    description=result.scenario,
                    landed=landed,
                    rate=simulated_s / (time.monotonic() - start_s),
                )
    except KeyboardInterrupt:
        flown.interrupted = True
    except WorkerError as fault:
        flown.fault = fault
    finally:
        running.close()
        flown.wall_s = time.monotonic() - start_s
    return flown


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """What ends a process by default is as Ctrl-C; what is ignored (nohup) stays so."""
    taken = [number for number in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(number) is signal.SIG_DFL]
    for number in taken:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


def _prepare() -> None:
    configure_logging(quiet=True)
    cv2.setNumThreads(1)


@lru_cache(maxsize=1)
def _course(path: Path, argument: str) -> Course:
    return load_course(path, argument)


def _fly(job: Job) -> TrialResult:
    return fly_trial(_course(job.path, job.argument), job.seed)
