"""Text on a stream of any encoding: what it can't carry is escaped as in JSON, so that JSON stays JSON."""

from __future__ import annotations

import codecs
import io
import json
import sys


def _escaped(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return json.dumps(error.object[error.start : error.end])[1:-1], error.end


codecs.register_error("physinc", _escaped)


def escape_output() -> None:
    """Let stdout and stderr take any text."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="physinc")
