"""`python -m identify` is `stickslip`."""

import sys

from identify.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
