"""Ctrl-C ends a stream, not the program: what was seen until then counts."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ._physinc import Stream
from .narration import remark


class Interruption:
    """Whether Ctrl-C came."""

    came = False


@contextmanager
def interruptible(stream: Stream, source: str) -> Iterator[Interruption]:
    """Let the first Ctrl-C end `stream`, and a second one the program.

    In the end the stream is closed, and what there is to be said of `source` is told.
    """
    interruption = Interruption()

    def interrupt(*_: Any) -> None:
        interruption.came = True
        stream.interrupt()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield interruption
    finally:
        stream.close()
        remark(source, stream.remarks)
