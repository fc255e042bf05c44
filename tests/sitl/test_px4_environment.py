"""What PX4_SITL may name: a wrong value is told in words, whether there is a PX4 here or not."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent


def conftest() -> Any:
    spec = importlib.util.spec_from_file_location("sitl_conftest", HERE / "conftest.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


PX4_OF = conftest().px4_of


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("/no/such/bin/px4", "/no/such/bin/px4: no such program; give the path of a px4 binary, or udpin://HOST:PORT"),
        ("tcp://127.0.0.1:5760", "tcp://127.0.0.1:5760: not an address; write udpin://HOST:PORT"),
        (sys.executable, "init.d-posix/rcS is not there; give the px4 of a build folder"),
    ],
)
def test_px4_sitl_that_names_no_px4_is_an_error_in_words(tmp_path, value, words):
    with pytest.raises(ValueError, match="PX4_SITL=") as wrong, PX4_OF(value, tmp_path):
        pass
    assert words in str(wrong.value)


def test_px4_sitl_address_of_an_instance_gives_the_port_of_its_truth(tmp_path):
    with PX4_OF("udpin://127.0.0.1:14543", tmp_path) as running:
        assert running.address == "udpin://127.0.0.1:14543"
        assert running.truth_address == "udpin:127.0.0.1:19413"


@pytest.mark.parametrize(
    ("value", "code", "words"),
    [
        (None, 0, "PX4_SITL is not set: give it the address of a running PX4 SITL, or the path of a px4 binary"),
        ("/no/such/px4", 1, "PX4_SITL=/no/such/px4: no such program"),
    ],
    ids=["unset", "missing"],
)
def test_tests_of_px4_are_skipped_without_one_and_fail_with_a_wrong_one(value, code, words):
    environment = {name: v for name, v in os.environ.items() if name != "PX4_SITL"}
    if value is not None:
        environment["PX4_SITL"] = value
    command = [sys.executable, "-m", "pytest", "-m", "sitl", "-rs", str(HERE / "test_px4_link.py")]
    done = subprocess.run(
        command, capture_output=True, text=True, env=environment, cwd=HERE.parent.parent, timeout=120, check=False
    )
    assert done.returncode == code, done.stdout + done.stderr
    assert words in done.stdout
