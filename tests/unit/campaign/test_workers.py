"""Workers: all results whoever is first, faults told, and Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap

import pytest

from app.campaign.workers import Work, WorkerError, run_jobs


def nothing() -> None:
    """Prepares nothing."""


def square(job: int) -> int:
    return job * job


def fail_at_three(job: int) -> int:
    if job == 3:
        raise ValueError("three")
    return job


def end_at_three(job: int) -> int:
    if job == 3:
        os._exit(7)
    return job


WORKERS = pytest.mark.parametrize("workers", [1, 3])
"""The functions above are found by the spawned workers through PYTHONPATH."""


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """--import-mode=importlib leaves the tests' own folder off the path that workers inherit."""
    folder = os.path.dirname(__file__)
    monkeypatch.syspath_prepend(folder)
    module = __import__("test_workers")
    return module


@WORKERS
def test_workers_give_every_result_with_its_jobs_index(importable, workers):
    results = dict(run_jobs(Work(importable.nothing, importable.square), [4, 5, 6, 7], workers))
    assert results == {0: 16, 1: 25, 2: 36, 3: 49}


def test_worker_that_fails_says_where(importable):
    with pytest.raises(WorkerError, match="three"):
        list(run_jobs(Work(importable.nothing, importable.fail_at_three), [3], 1))


def test_worker_that_ends_is_told_with_its_exit_code(importable):
    with pytest.raises(WorkerError, match="exit code 7"):
        list(run_jobs(Work(importable.nothing, importable.end_at_three), [3], 1))


SLOW_CAMPAIGN = textwrap.dedent(
    """
    import os, signal, sys
    from app.campaign import campaign
    from app.__main__ import main
    from app.campaign.outcome import TrialResult

    file, number = sys.argv[1], int(sys.argv[2])
    # As in a shell, whatever these tests are run under.
    signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)

    def flown(work, jobs, workers):
        yield 0, TrialResult("static", jobs[0].seed, None, 0.05, 0.03, 0.04, 0.6, 20.0, 1, 30.0, 9.0)
        os.kill(os.getpid(), number)
        yield 1, None

    campaign.run_jobs, campaign.TOLD_EACH_S = flown, 0.0
    sys.argv = ["alight", "campaign", "--scenario", "static", "--trials", "9", "--json", file]
    main()
    """
)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_campaign_that_is_interrupted_keeps_what_is_done(tmp_path, number):
    file = tmp_path / "figures.json"
    done = subprocess.run(
        [sys.executable, "-c", SLOW_CAMPAIGN, str(file), str(int(number))],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 128 + signal.SIGINT, done.stderr
    assert "1 of 9 flown, 1 landed" in done.stderr
    assert "1/1" in done.stdout
    (scenario,) = json.loads(file.read_text(encoding="utf-8"))["scenarios"]
    assert (scenario["trials"], scenario["successes"]) == (1, 1)
