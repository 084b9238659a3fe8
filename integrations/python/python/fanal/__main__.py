"""``python -m fanal``: as the command ``fanal``."""

import sys

from ._command import main

sys.exit(main())
