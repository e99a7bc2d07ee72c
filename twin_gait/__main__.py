"""Entry point of ``python -m twin_gait``."""

import sys

from twin_gait.cli.program import main

sys.exit(main())
