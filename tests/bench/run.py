"""`make bench`: the eye against OpenCV's ArUco and AprilTag on the same frames; what it prints is Markdown.

It owns the order of things and the printing; how frames are drawn is in sets.py and sequences.py, what counts in
judge.py.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import sequences
import sets
from detectors import ENTRIES, Contestant
from judge import Verdict, judge, rate, summary
from optics import Optics, lens
from picture import draw_verdict
from povray_folder import FolderError, load_folder
from store import Case, cache_folder, load, load_sequence

CHUNK = 24
DEFAULT_COUNT = 96
SEQUENCES = "sequences"
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Read by numpy's libraries when they are loaded."""


Results = dict[str, dict[str, list[Verdict]]]


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


def _number(value: float, digits: int) -> str:
    return "-" if not math.isfinite(value) else f"{value:.{digits}f}"


def _pair(values: tuple[float, float], digits: int) -> str:
    return " / ".join(_number(v, digits) for v in values)


def _table(head: list[str], rows: list[list[str]]) -> str:
    widths = [max(len(row[k]) for row in [head, *rows]) for k in range(len(head))]
    lines = [" | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) for row in [head, *rows]]
    rule = "|".join("-" * (w + 2) for w in widths)
    return "\n".join([f"| {lines[0]} |", f"|{rule}|", *(f"| {line} |" for line in lines[1:])]) + "\n"


def _rate_cell(verdicts: list[Verdict]) -> str:
    if not verdicts:
        return "-"
    wrong = sum(v.outcome == "wrong" for v in verdicts)
    return f"{rate(verdicts):.1f}" + (f" ({wrong} wrong)" if wrong else "")


def _visible(verdicts: list[Verdict]) -> list[Verdict]:
    return [v for v in verdicts if v.kind == "visible"]


def main_table(results: Results, names: list[str]) -> str:
    """Rates of every set; errors on the cone, or the first set there is; processor times."""
    ran = list(results)
    stills = [s for s in ran if s != SEQUENCES]
    of_errors = "cone" if "cone" in ran else ran[0]
    head = ["detector", *(f"{s} %" for s in ran)]
    head += [f"distance error {of_errors} p50 / p90 %", f"yaw {of_errors} p50 / p90 deg", "ms p50 / p90"]
    head += ["sequence ms p50 / p90"] if SEQUENCES in ran else []
    rows = []
    for name in names:
        row = [ENTRIES[name].title]
        for one in ran:
            verdicts = results[one].get(name, [])
            row.append(_rate_cell(_visible(verdicts) if one == SEQUENCES else verdicts))
        errors = summary(results[of_errors].get(name, []))
        times = summary([v for s in stills for v in results[s].get(name, [])])
        row += [_pair(errors["distance_percent"], 2), _pair(errors["yaw_deg"], 2), _pair(times["ms"], 2)]
        if SEQUENCES in ran:
            row.append(_pair(summary(results[SEQUENCES].get(name, []))["ms"], 2))
        rows.append(row)
    return _table(head, rows)


def kind_table(set_name: str, verdicts: dict[str, list[Verdict]], by: Callable[[Verdict], str]) -> str:
    """Rates of one set by height, kind or sequence."""
    first = next(iter(verdicts.values()))
    kinds = list(dict.fromkeys(by(v) for v in first))
    if set_name == "cone":
        kinds.sort()
    head = [set_name, "frames", *(ENTRIES[name].title for name in verdicts)]
    rows = []
    for kind in kinds:
        row = [kind, str(sum(by(v) == kind for v in first))]
        row += [_rate_cell([v for v in verdicts[name] if by(v) == kind]) for name in verdicts]
        rows.append(row)
    return _table(head, rows)


def error_table(results: Results, names: list[str]) -> str:
    """Errors and times set by set."""
    head = ["set", "detector", "distance p50 / p90 %", "bias %", "yaw p50 / p90 deg", "corner p50 / p90 px"]
    head += ["detection ms p50 / p90", "pose ms p50 / p90"]
    rows = []
    for set_name, verdicts in results.items():
        for name in names:
            if name in verdicts:
                s = summary(verdicts[name])
                rows.append(
                    [
                        set_name,
                        ENTRIES[name].title,
                        _pair(s["distance_percent"], 2),
                        _number(s["distance_bias_percent"], 2),
                        _pair(s["yaw_deg"], 2),
                        _pair(s["corner_px"], 2),
                        _pair(s["detect_ms"], 2),
                        _pair(s["pose_ms"], 2),
                    ]
                )
    return _table(head, rows)


def _by_kind(verdict: Verdict) -> str:
    return verdict.kind


def _by_sequence(verdict: Verdict) -> str:
    return verdict.set_name.removeprefix("seq-")


def _machine() -> str:
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        found = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        model = found[0] if found else model
    return f"{model}, one thread, OpenCV {cv2.__version__}"


def report(results: Results, names: list[str], count: int, unseen: bool, took_s: float) -> str:
    """Everything that is printed."""
    part = "unseen" if unseen else "tuning"
    parts = [
        f"\n## Detections in % of frames ({part} part; {count} frames a set; {_machine()}; {took_s:.0f} s)\n\n",
        main_table(results, names),
    ]
    for set_name, verdicts in results.items():
        if set_name == SEQUENCES:
            seen = {name: _visible(vs) for name, vs in verdicts.items()}
            parts += ["\n", kind_table(SEQUENCES, seen, _by_sequence)]
        else:
            parts += ["\n", kind_table(set_name, verdicts, _by_kind)]
    parts += ["\n", error_table(results, names)]
    return "".join(parts)


def to_json(results: Results, unseen: bool) -> dict[str, Any]:
    """Figures and every verdict."""

    def clean(value: Any) -> Any:
        if isinstance(value, float):
            return value if math.isfinite(value) else None
        if isinstance(value, dict):
            return {k: clean(v) for k, v in value.items()}
        return [clean(v) for v in value] if isinstance(value, list | tuple) else value

    sets_json = {
        set_name: {
            name: {"summary": summary(verdicts), "frames": [asdict(v) for v in verdicts]}
            for name, verdicts in by_name.items()
        }
        for set_name, by_name in results.items()
    }
    cleaned: dict[str, Any] = clean(
        {"part": "unseen" if unseen else "tuning", "machine": _machine(), "sets": sets_json}
    )
    return cleaned


def _names(text: str, known: list[str], what: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in known:
            raise argparse.ArgumentTypeError(f"no {what} {name!r}; there are {', '.join(known)}")
    return list(dict.fromkeys(names))


def main(arguments: list[str] | None = None) -> int:
    """Run what was asked for, and print it."""
    every_set = [*sets.STILL_SETS, SEQUENCES]
    parser = argparse.ArgumentParser(prog="make bench ARGS=...", description=__doc__)
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
    cv2.setNumThreads(1)
    names: list[str] = options.detectors
    progress = Progress()
    results: Results = {}
    if options.folder is not None:
        names, options.sets, options.unseen = ["alight"], [], True
        try:
            results = run_folder(options.folder, names, options.save, progress)
        except FolderError as fault:
            parser.error(str(fault))
        options.count = max(len(verdicts["alight"]) for verdicts in results.values())
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
    return 0


if __name__ == "__main__":
    if ONE_THREAD.items() <= os.environ.items():
        sys.exit(main())
    os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **ONE_THREAD})
