"""`make bench`: the eye against OpenCV's ArUco and AprilTag on the same frames; what it prints is Markdown.

It owns the order of things and the printing; how frames are drawn is in sets.py and sequences.py, what counts in
judge.py.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

import cv2
import sequences
import sets
from detectors import ENTRIES, Contestant
from judge import Verdict, judge
from optics import Optics, lens
from picture import draw_verdict
from povray_folder import FolderError, load_folder
from report import SEQUENCES, Results, report, to_json
from store import Case, cache_folder, load, load_sequence

CHUNK = 24
DEFAULT_COUNT = 96
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Read by numpy's libraries when they are loaded."""


class Progress:
    """One line on the terminal that says where it is; a line now and then elsewhere."""

    def __init__(self) -> None:
        self._begin = time.monotonic()
        self._told = -math.inf
        self._terminal = sys.stderr.isatty()

    def tell(self, what: str) -> None:
        """Where it is."""
        now = time.monotonic()
        if now - self._told < (0.2 if self._terminal else 15.0):
            return
        self._told = now
        line = f"bench: {now - self._begin:4.0f} s  {what}"
        sys.stderr.write(f"\r{line:<78}" if self._terminal else line + "\n")
        sys.stderr.flush()

    def end(self) -> float:
        """Clear the line; seconds since the start."""
        if self._terminal:
            sys.stderr.write("\r" + " " * 78 + "\r")
        return time.monotonic() - self._begin


def _chunks(cases: Iterator[Case], size: int) -> Iterator[list[Case]]:
    while chunk := list(islice(cases, size)):
        yield chunk


def _warm(contestant: Contestant, case: Case, marker: str) -> None:
    """First calls load and allocate what later ones have."""
    for _ in range(2):
        contestant.look(case.frame(marker), 0.0, 0)


def _look(
    chunk: list[Case], names: list[str], contestants: dict[str, Contestant], save: Path | None
) -> Iterator[tuple[str, Verdict]]:
    for name in names:
        marker = ENTRIES[name].marker
        for case in chunk:
            answer = contestants[name].look(case.frame(marker), case.t_s, case.index)
            verdict = judge(case, answer)
            if save is not None and verdict.outcome != "right":
                draw_verdict(save, name, case, case.frame(marker), answer, verdict)
            yield name, verdict


def _prepare(chunk: list[Case], names: list[str], say: Callable[[str], None]) -> None:
    markers = sorted({ENTRIES[name].marker for name in names})
    for case in chunk:
        say(f"{case.set_name}: frame {case.index + 1}")
        case.prepare(markers)


def run_stills(
    set_name: str, count: int, names: list[str], unseen: bool, save: Path | None, progress: Progress
) -> dict[str, list[Verdict]]:
    """A set of single frames: verdicts of each detector."""
    optics = lens("B" if set_name.endswith("-B") else "A")
    return _run(load(set_name, count, unseen), optics, names, save, progress)


def run_folder(folder: Path, names: list[str], save: Path | None, progress: Progress) -> Results:
    """The sets that povray.py left in a folder. In its sets "none" there is no landmark: what is found is wrong."""
    return {
        set_name: _run(iter(cases), cases[0].optics, names, save, progress)
        for set_name, cases in load_folder(folder).items()
    }


def _run(
    cases: Iterator[Case], optics: Optics, names: list[str], save: Path | None, progress: Progress
) -> dict[str, list[Verdict]]:
    contestants = {name: ENTRIES[name].make(optics, True) for name in names}
    verdicts: dict[str, list[Verdict]] = {name: [] for name in names}
    warm = False
    for chunk in _chunks(cases, CHUNK):
        _prepare(chunk, names, progress.tell)
        if not warm:
            for name in names:
                _warm(contestants[name], chunk[0], ENTRIES[name].marker)
            warm = True
        for name, verdict in _look(chunk, names, contestants, save):
            verdicts[name].append(verdict)
            progress.tell(f"{verdict.name}: {name}")
    return verdicts


def run_sequences(names: list[str], unseen: bool, save: Path | None, progress: Progress) -> dict[str, list[Verdict]]:
    """All sequences: verdicts of each detector that follows them, on every frame."""
    verdicts: dict[str, list[Verdict]] = {name: [] for name in names if ENTRIES[name].sequences}
    for sequence in sequences.NAMES:
        frames = list(load_sequence(sequence, unseen))
        _prepare(frames, list(verdicts), progress.tell)
        contestants: dict[str, Contestant] = {}
        for name in verdicts:
            # The first call is slow, and what is followed starts anew: one to warm up, one to run.
            _warm(ENTRIES[name].make(frames[0].optics, False), frames[0], ENTRIES[name].marker)
            contestants[name] = ENTRIES[name].make(frames[0].optics, False)
        for name, verdict in _look(frames, list(verdicts), contestants, save):
            verdicts[name].append(verdict)
            progress.tell(f"{verdict.name}: {name}")
    return verdicts


def _names(text: str, known: list[str], what: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in known:
            raise argparse.ArgumentTypeError(f"no {what} {name!r}; there are {', '.join(known)}")
    return list(dict.fromkeys(names))


def _arguments(arguments: list[str] | None) -> tuple[argparse.ArgumentParser, argparse.Namespace]:
    every_set = [*sets.STILL_SETS, SEQUENCES]
    parser = argparse.ArgumentParser(
        prog="make bench ARGS=...", description="The eye against OpenCV's ArUco and AprilTag on the same frames."
    )
    parser.add_argument(
        "--sets", type=lambda t: _names(t, every_set, "set"), default=every_set, help=f"of {','.join(every_set)}"
    )
    parser.add_argument(
        "--detectors",
        type=lambda t: _names(t, list(ENTRIES), "detector"),
        default=list(ENTRIES),
        help=f"of {','.join(ENTRIES)}",
    )
    parser.add_argument("--count", type=int, default=DEFAULT_COUNT, help="frames of each set of stills")
    parser.add_argument("--unseen", action="store_true", help="the part that is not looked at while tuning")
    parser.add_argument("--json", type=Path, help="write every figure and verdict to this file")
    parser.add_argument("--save", type=Path, help="write a picture of every frame that was missed or wrong here")
    parser.add_argument("--folder", type=Path, help="frames by povray.py, with Alight alone, in place of the sets")
    options = parser.parse_args(arguments)
    if options.count < 1:
        parser.error("--count: give at least 1")
    return parser, options


def _run_all(options: argparse.Namespace) -> None:
    # What can't be written is found out before minutes of work, not after.
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.touch()
    if options.save is not None:
        options.save.mkdir(parents=True, exist_ok=True)
    progress = Progress()
    results: Results = {}
    if options.folder is not None:
        options.detectors, options.sets, options.unseen = ["alight"], [], True
        results = run_folder(options.folder, options.detectors, options.save, progress)
        options.count = max(len(verdicts["alight"]) for verdicts in results.values())
    names: list[str] = options.detectors
    for set_name in options.sets:
        if set_name == SEQUENCES:
            results[SEQUENCES] = run_sequences(names, options.unseen, options.save, progress)
        else:
            results[set_name] = run_stills(set_name, options.count, names, options.unseen, options.save, progress)
    took_s = progress.end()
    sys.stdout.write(report(results, names, options.count, options.unseen, took_s))
    sys.stdout.write(f"\nFrames are kept in {cache_folder()}.\n")
    if options.json is not None:
        options.json.write_text(json.dumps(to_json(results, options.unseen)), encoding="utf-8")


def main(arguments: list[str] | None = None) -> int:
    """Run what was asked for, and print it."""
    parser, options = _arguments(arguments)
    cv2.setNumThreads(1)
    try:
        _run_all(options)
    except FolderError as fault:
        parser.error(str(fault))
    except OSError as fault:
        parser.error(f"{fault}; name a folder that can be written (--json, --save, or ALIGHT_BENCH_CACHE)")
    except ModuleNotFoundError as fault:
        parser.error(f"{fault}; `make bench` installs what it needs, or leave it out: --detectors alight,aruco4,aruco6")
    except KeyboardInterrupt:
        parser.exit(130, "\nbench: stopped; the frames that were rendered are kept\n")
    return 0


if __name__ == "__main__":
    if ONE_THREAD.items() <= os.environ.items():
        sys.exit(main())
    os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **ONE_THREAD})
