"""The command line, called inside the test's process."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from unittest.mock import patch

from explicitfe.app.cli.main import main


def command(arguments: Sequence[str]) -> int:
    """Run ``explicitfe ARGUMENTS``; give its exit code."""
    with patch.object(sys, "argv", ["explicitfe", *arguments]):
        try:
            main()
        except SystemExit as end:
            return int(end.code or 0)
    return 0
