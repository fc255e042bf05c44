"""Entry point: `alight`, and `python -m app`. An error that a person can mend is one line and exit code 2."""

from __future__ import annotations

import os
import sys
import traceback

from app.errors import AlightError

INTERRUPTED = 130
"""Exit code, as shells have it for Ctrl-C."""


def main() -> None:
    """Run the command line. Nothing that it does waits for whoever reads standard error."""
    from app.log import standard_error_in_background

    with standard_error_in_background():
        try:
            code = _run()
        except Exception:  # a bug keeps its traceback, and here it waits for nobody who reads it
            sys.stderr.write(traceback.format_exc())
            code = 1
    sys.exit(code)


def _run() -> int:
    """The command's exit code."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # decoders: what they would print is said by our errors
    # Vision's matrices are small, and it has one thread; a pool of them spins on the cores that the rest needs.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from app.cli import cli  # a broken installation must not hide behind an import at start

    code: object = 0
    try:
        code = cli(sys.argv[1:] or ["--help"], prog_name="alight", standalone_mode=False)
    except AlightError as error:
        code = _told(str(error))
    except KeyboardInterrupt:
        code = INTERRUPTED
    except BrokenPipeError:
        code = 1  # whoever read our output has seen enough
    except Exception as error:
        if not hasattr(error, "format_message"):  # what typer raises for a command line that it doesn't understand
            raise
        code = _told(_usage(error))
    if code == INTERRUPTED:
        sys.stderr.write("alight: interrupted\n")
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python would try again at its end, and cry
        code = code or 1
    return code if isinstance(code, int) else 0


def _told(words: str) -> int:
    sys.stderr.write(f"alight: error: {' '.join(words.split())}\n")
    return 2


def _usage(error: object) -> str:
    """What is wrong with a command line, and where to look."""
    words = str(getattr(error, "format_message")()).replace("Value error, ", "").strip().rstrip(".")  # noqa: B009  # not in Exception
    command = getattr(getattr(error, "ctx", None), "command_path", "alight")
    return f"{words[:1].lower()}{words[1:]}; see {command} --help"


if __name__ == "__main__":
    main()
