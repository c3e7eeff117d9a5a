"""``python -m slamgym``, as the command ``slamgym``."""

import sys

from slamgym.commands.cli import main

sys.exit(main())
