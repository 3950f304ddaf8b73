"""`camera.toml`: where it stands beside a source, and how a pose comes into it."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np
import tomlkit
from numpy.typing import NDArray

from ._physinc import dump_config

NAME = "camera.toml"
PACKED = (".gz", ".zst")
MARK = "\ufeff"
"""Some editors begin a file with it."""


def beside(source: str) -> Path:
    """Return the camera file of `source`, or the one that it will have.

    `camera.toml` in a folder; of a file `NAME.camera.toml`, or `camera.toml` beside it if that is there alone. What has no place (a
    live Kinect, a simulated scene, the demo) has it in the working directory.
    """
    path = Path(source)
    if path.is_dir():
        return path / NAME
    # Behind a question mark are faults that are put in on purpose.
    path = path if path.is_file() else Path(source.partition("?")[0])
    if not path.is_file():
        return Path(NAME)
    own = (path.with_suffix("") if path.suffix in PACKED else path).with_suffix(f".{NAME}")
    shared = path.with_name(NAME)
    return shared if shared.is_file() and not own.is_file() else own


def read(path: Path) -> tuple[str, NDArray[np.float64] | None]:
    """Text of the camera file `path`, to the letter, and `world_from_camera` [4, 4], if it is told there.

    Raises `ConfigError` as whoever uses the file does.
    """
    pose = tomlkit.parse(dump_config(camera=path)).unwrap()["camera"].get("world_from_camera")
    return path.read_bytes().decode(), None if pose is None else np.array(pose, dtype=float)


def level_pose(gravity: NDArray[np.float64], known: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """`world_from_camera` [4, 4] that makes `gravity` [3] (camera frame) point down the world's z.

    With a `known` pose its heading and its place are kept: it is turned as little as makes it level. Else y is as forward as a level
    direction can be, and the camera stands at the origin.
    """
    up = -gravity / np.linalg.norm(gravity)
    pose = np.eye(4)
    if known is None:
        # Where it looks straight down the top of the image is forward, where it looks up the bottom.
        forward = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < 1 - 1e-9 else np.array([0.0, up[2], 0.0])
    else:
        pose[:3, 3] = known[:3, 3]
        forward = known[1, :3]
        if abs(up @ forward) > 0.9:
            # y was nearly upright: x tells the heading better.
            forward = np.cross(up, known[0, :3])
    y = forward - up * (up @ forward)
    y /= np.linalg.norm(y)
    pose[:3, :3] = np.cross(y, up), y, up
    return pose


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
