"""`python -m drivers.simulator`."""

import sys

from drivers.simulator.process import main

if __name__ == "__main__":
    sys.exit(main())
