"""`camera.toml`, and how a pose comes into it."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
import tomlkit
from numpy.typing import NDArray

from ._physinc import dump_config

NAME = "camera.toml"
MARK = "\ufeff"
"""Some editors begin a file with it."""


def read(path: Path) -> tuple[str, list[list[float]] | None]:
    """Text of the camera file `path`, to the letter, and `world_from_camera`, 4 rows of 4, if it is told there.

    Raises `ConfigError` as whoever uses the file does.
    """
    return path.read_bytes().decode(), tomlkit.parse(dump_config(camera=path)).unwrap()["camera"].get("world_from_camera")


def with_pose(text: str, pose: NDArray[np.float64]) -> str:
    """Return the TOML `text` with `world_from_camera` = `pose`, everything else, comments too, as it was."""
    plain = text.removeprefix(MARK)
    document = tomlkit.parse(plain)
    rows = tomlkit.array()
    for row in pose:
        # −0 is written as 0.
        rows.append([round(float(x), 12) + 0.0 for x in row])
    document["world_from_camera"] = rows.multiline(multiline=True)
    return text[: len(text) - len(plain)] + tomlkit.dumps(document)


def write(path: Path, text: str) -> None:
    """Put `text` in place of the file at `path` at once: whoever reads finds the old or the new one, never a part."""
    path = path.resolve()
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    new = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        mode = path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask()
        new.chmod(mode)
        new.replace(path)
    except BaseException:
        new.unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0o022)
    os.umask(mask)
    return mask
