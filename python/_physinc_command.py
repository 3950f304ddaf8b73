"""The command `physinc`: Ctrl-C is quiet from here on, while all that it needs is still being loaded."""

import os
import signal
from typing import Any


def main() -> int:
    """Load the command line and run it; its exit code."""
    # What is half loaded may turn an exception into another one.
    heard: Any = signal.signal(signal.SIGINT, lambda *_: os._exit(130))
    from physinc.cli import main as run  # noqa: PLC0415 - this may be interrupted

    signal.signal(signal.SIGINT, heard)
    return run()
