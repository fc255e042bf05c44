"""`alight campaign`: from what was typed to what is printed and written."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path

from rich.console import Console

from app.campaign.campaign import fly_campaign
from app.campaign.page import page_of
from app.campaign.scenario import scenario_path
from app.campaign.tables import print_campaign
from app.campaign.trial import load_course
from app.errors import AlightError, ConfigError
from app.wiring import CONFIGS
from app.wiring_virtual import check_parameters

SCENARIOS = CONFIGS / "scenarios"


def run_campaign(
    names: str,
    trials: int,
    seed: int,
    *,
    workers: int,
    json_file: Path | None,
    html_file: Path | None,
    output: Console,
    progress: Console,
) -> bool:
    """Fly a campaign, print what it came to and write the files.

    Args:
        names: Scenarios, separated by commas: names of those that ship, or paths.
        trials: Of each scenario; their seeds count up from `seed`.
        seed: Of the first trial.
        workers: Processes.
        json_file: Figures to write; None for none.
        html_file: Page to write; None for none.
        output: Where the table goes.
        progress: Where the progress bar goes.

    Returns:
        Whether every trial landed.

    Raises:
        AlightError: A scenario is missing or wrong, or a file can't be written; nothing was flown then.
        KeyboardInterrupt: It was interrupted; what was done has been printed and written.
        WorkerError: A worker failed; the same.
    """
    for file in (json_file, html_file):
        if file is not None:
            _check_writable(file)
    arguments = [name.strip() for name in names.split(",") if name.strip()]
    if not arguments:
        raise ConfigError("no scenario is named", "give --scenario a name, or several with commas between them")
    paths = tuple(scenario_path(argument, SCENARIOS) for argument in arguments)
    courses = tuple(load_course(path, argument) for path, argument in zip(paths, arguments, strict=True))
    by_name = {course.name: course.argument for course in courses}
    if len(by_name) < len(courses):
        raise ConfigError(f"a scenario is named twice in {names!r}", "name each once; --trials says how often")
    for path, course in zip(paths, courses, strict=True):
        check_parameters(path, course.scenario.vehicle.parameters)
    flown = fly_campaign(courses, paths, range(seed, seed + trials), workers, progress)
    figures = flown.figures
    print_campaign(figures, by_name, output)
    if json_file is not None:
        _write(json_file, json.dumps(figures.to_json(), indent=2, allow_nan=False) + "\n")
    if html_file is not None:
        title = f"alight campaign --scenario {names} --trials {trials} --seed {seed}"
        _write(html_file, page_of(figures, by_name, title))
    if flown.interrupted:
        raise KeyboardInterrupt
    if flown.fault is not None:
        raise flown.fault
    return all(not scenario.failures for scenario in figures.scenarios)


def _check_writable(file: Path) -> None:
    """Before hours of flying, not after them."""
    if not file.parent.is_dir() or not os.access(file.parent, os.W_OK) or file.is_dir():
        raise AlightError(f"{file}: can't be written", "give a file in a folder that is there and can be written to")


def _write(file: Path, text: str) -> None:
    """Whole, or not at all."""
    part = file.with_name(f".{file.name}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(file)
    except OSError as fault:
        with suppress(OSError):
            part.unlink()
        raise AlightError(f"{file}: can't be written ({fault.strerror})", "free some space, or name another") from None
