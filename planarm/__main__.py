"""The `planarm` command, also ``python -m planarm``; importing the package has checked the names of its parts."""

import sys

from agents.cli import main

if __name__ == "__main__":
    sys.exit(main())
