"""``python -m snakeslam`` is the same as ``snakeslam``."""

import sys

from snakeslam.cli import main

sys.exit(main())
