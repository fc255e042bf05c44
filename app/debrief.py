"""What a flight leaves behind: its folder, which no two flights share, and result.json."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.errors import AlightError
from app.flying import Ended, Flown, Plan
from app.review.flight import Flight, collect_flight
from app.review.record_reader import read_record
from app.review.report import read_truth, summarise

RESULT = "result.json"


@contextmanager
def own_folder(folder: Path) -> Iterator[Path]:
    """Make a folder, and keep every other Alight out of it; one that it made and left empty is taken away again.

    Raises:
        AlightError: It can't be made or written, or another Alight is writing there.
    """
    made = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError as fault:
        raise AlightError(f"{folder}: can't be made ({fault.strerror})", "give another folder with --out") from None
    try:
        if not os.access(folder, os.W_OK | os.X_OK):
            raise AlightError(f"{folder}: can't be written to", "give another folder with --out")
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise AlightError(f"{folder}: another Alight writes there", "give another folder with --out") from None
        except OSError:
            pass  # a file system without locks
        yield folder
    finally:
        os.close(handle)
        if made:
            with suppress(OSError):
                folder.rmdir()


def files_of(plan: Plan) -> list[Path]:
    """What a flight writes into its folder while it lasts."""
    return [path for path in (plan.record, plan.truth) if path is not None]


def clear(*paths: Path) -> None:
    """Remove what an earlier flight left, so that it can't be taken for this one's.

    Raises:
        AlightError: A file can't be removed.
    """
    for path in paths:
        try:
            path.unlink(missing_ok=True)
        except OSError as fault:
            raise AlightError(
                f"{path}: can't be replaced ({fault.strerror})", "give another folder with --out"
            ) from None


def set_aside(*paths: Path) -> None:
    """Rename what an earlier flight left after the time it was written: a real flight's record is not to be lost.

    Raises:
        AlightError: A file can't be renamed.
    """
    for path in paths:
        try:
            if path.exists():
                written = datetime.fromtimestamp(path.stat().st_mtime, UTC)
                path.rename(path.with_stem(f"{path.stem}-{written:%Y-%m-%dT%H-%M-%SZ}"))
        except OSError as fault:
            raise AlightError(
                f"{path}: can't be renamed ({fault.strerror})", "give another folder with --out"
            ) from None


def review(plan: Plan, flown: Flown) -> tuple[Flight, dict[str, Any]]:
    """The record of a flight as arrays, and its entry of result.json.

    Raises:
        RecorderError: The record can't be read.
    """
    flight = Flight() if plan.record is None else collect_flight(read_record(plan.record, images=False))
    truth = read_truth(plan.truth) if plan.truth is not None and plan.truth.exists() else []
    entry = summarise(plan.title, flight, truth, ended=flown.ended.value, cpu_percent=flown.cpu_percent)
    return flight, entry


def failed(plan: Plan, error: AlightError) -> dict[str, Any]:
    """The entry of result.json of a flight that ended with an error, from as much of a record as there is."""
    try:
        entry = review(plan, Flown(Ended.INTERRUPTED))[1]
    except AlightError:
        entry = summarise(plan.title, Flight(), [], cpu_percent={})
    return {**entry, "outcome": "failed", "reason": str(error)}


def write_result(folder: Path, results: list[dict[str, Any]]) -> dict[str, Any]:
    """Write result.json, whole or not at all.

    Returns:
        What it holds.

    Raises:
        AlightError: It can't be written.
    """
    found = {"experiments": results}
    path = folder / RESULT
    part = path.with_suffix(".part")
    try:
        part.write_text(json.dumps(found, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        part.replace(path)
    except OSError as fault:
        raise AlightError(f"{path}: can't be written ({fault.strerror})", "free some space, or use --out") from None
    return found
