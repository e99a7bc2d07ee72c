"""``python -m twin_gait``."""

import sys

from twin_gait.cli.main import main

sys.exit(main())
