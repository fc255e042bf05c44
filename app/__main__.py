"""Entry point: `alight`, and `python -m app`. An error that a person can mend is one line and exit code 2."""

from __future__ import annotations

import sys

from app.errors import AlightError


def main() -> None:
    """Run the command line."""
    from app.cli import cli  # a broken installation must not hide behind an import at start

    try:
        cli()
    except AlightError as error:
        sys.stderr.write(f"alight: error: {error}\n")
        sys.exit(2)
    except KeyboardInterrupt:
        sys.stderr.write("alight: interrupted\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
