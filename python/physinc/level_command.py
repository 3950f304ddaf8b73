"""`physinc level SOURCE`: throw a ball, have a calibrated camera."""

from __future__ import annotations

import math
import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomlkit
from cyclopts import Parameter, validators
from numpy.typing import NDArray

from ._physinc import CameraOrientation, StreamStarted, camera_file, dump_config, level_pose
from .camera_file import NAME, read, with_pose, write
from .errors import ConfigError, RecordingError
from .interrupting import interruptible
from .narration import count
from .options import Flag, Frames
from .streaming import DEMO, open_named, path_of

USUAL = 9.81
"""m/s²; within 0.3 % anywhere on Earth."""


def level(
    source: str,
    /,
    *,
    camera: Path | None = None,
    out: Annotated[Path | None, Parameter(show_default=False)] = None,
    config: Path | None = None,
    frames: Frames = None,
    duration: Annotated[float | None, Parameter(validator=validators.Number(gte=0))] = None,
    every_frame: Annotated[bool, Flag] = False,
    dry_run: Annotated[bool, Flag] = False,
) -> int:
    """Find which way is down from the balls that fly in SOURCE, and write the camera's pose into camera.toml.

    Throw a ball through the view a few times: each flight tells gravity in the camera, all together roll and pitch with their σ.
    Everything else in camera.toml stays, comments too. What has no place of its own, a live Kinect say, has it in the working directory;
    such a file is used by run --camera. Of a live Kinect, stop by Ctrl-C or --duration: what was found until then is written; after
    Ctrl-C the exit code is 130, as of run.

    Parameters
    ----------
    source
        Any source of depth frames, as for run.
    camera
        Camera file, instead of the one beside SOURCE; the pose is written there.
    out
        Write the pose there instead; the rest is copied from the camera file in force.
    config
        TOML file, as for run: radius, mass and drag of the ball.
    frames
        Stop after so many frames.
    duration
        Stop after so many seconds of the stream.
    every_frame
        Live devices wait instead of dropping frames.
    dry_run
        Write nothing.

    """
    beside = camera_file(path_of(source))
    # The demo's is everybody's.
    own = None if beside is None or beside.parent == DEMO.parent else beside
    file, target = camera or beside, out or camera or own or Path(NAME)
    # What stands where the pose will be is kept; where nothing stands yet, what is in force goes along.
    basis = target if target.is_file() else file
    text, known = read(basis) if basis is not None and basis.is_file() else ("", None)
    found: CameraOrientation | None = None
    # Whatever pose is told, gravity's direction is to be found.
    stream = open_named(source, config=_tilted(config), camera=camera, frames=frames, duration=duration, every_frame=every_frame)
    with interruptible(stream, source) as interruption:
        for event in stream:
            match event:
                case StreamStarted(camera=None):
                    raise ConfigError(f"{source}: these are positions in the world, and no camera to be levelled; depth frames have one")
                case CameraOrientation(final=True):
                    found = event
                    sys.stderr.write(f"{count(event.flights, 'flight')}: {_angles(event)}\n")
    code = 130 if interruption.came else 0
    if found is None:
        nothing = RecordingError(
            f"{source}: no flight was seen, so nothing tells which way is down:"
            " throw the ball so that it flies freely in view for half a second"
        )
        if not interruption.came:
            raise nothing
        sys.stderr.write(f"physinc: {nothing}\n")
        return code
    gravity = np.asarray(found.gravity_in_camera)
    sys.stdout.write(_report(found, gravity))
    pose = level_pose(gravity, known)
    if known is None:
        sys.stdout.write("heading: no flight tells it; y is where the camera looks, its place is the origin\n")
    else:
        sys.stdout.write(f"heading: no flight tells it; it is kept from {basis}, and so is the camera's place\n")
    new = with_pose(text, pose)
    if dry_run:
        sys.stdout.write(f"{target} would be:\n{new}")
    else:
        write(target, new)
        sys.stdout.write(f"{target}: world_from_camera written\n")
        if own is None or own.resolve() != target.resolve():
            sys.stdout.write(f"it is used by: physinc run {shlex.quote(source)} --camera {shlex.quote(str(target))}\n")
    return code


def _tilted(config: Path | None) -> dict[str, Any]:
    """Return what `config` says, with the direction of gravity unknown."""
    keys: dict[str, Any] = tomlkit.parse(dump_config(config=config)).unwrap()
    keys["assume"]["camera"] = "tilted"
    return keys


def angle_sds(gravity: NDArray[np.float64], covariance: NDArray[np.float64]) -> tuple[float, float]:
    """σ of roll and pitch, rad, by linear propagation."""
    x, y, z = gravity
    level2 = x * x + y * y
    level = math.sqrt(level2)
    roll = np.array([y, -x, 0.0]) / level2
    pitch = np.array([x * z / level, y * z / level, -level]) / (level2 + z * z)
    return math.sqrt(roll @ covariance @ roll), math.sqrt(pitch @ covariance @ pitch)


def _angles(found: CameraOrientation) -> str:
    roll_sd, pitch_sd = angle_sds(np.asarray(found.gravity_in_camera), np.asarray(found.covariance))
    roll, pitch = math.degrees(found.roll), math.degrees(found.pitch)
    return f"roll {roll:+.2f} ± {math.degrees(roll_sd):.2f}°, pitch {pitch:+.2f} ± {math.degrees(pitch_sd):.2f}°"


def _report(found: CameraOrientation, gravity: NDArray[np.float64]) -> str:
    covariance = np.asarray(found.covariance)
    size = float(np.linalg.norm(gravity))
    down = gravity / size
    sd = math.sqrt(down @ covariance @ down)
    vector = ", ".join(f"{x:+.3f}" for x in gravity)
    lines = [
        f"gravity in the camera (x right, y down, z forward): ({vector}) m/s²,"
        f" size {size:.3f} ± {sd:.3f}, of {count(found.flights, 'flight')}",
        f"{_angles(found)} (roll: turned about its axis, pitch: looking up)",
    ]
    if abs(size - USUAL) > max(4 * sd, 0.02 * USUAL):
        lines.append(f"its size is not {USUAL}: was the camera moved, or is the ball not as configured (radius, mass)?")
    return "\n".join(lines) + "\n"
