"""Where a stream comes from."""

from __future__ import annotations

import atexit
import math
import os
import weakref
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._physinc import Position, Stream, open_iterable, open_source
from .arrays import Law
from .config import CameraConfig, Config
from .errors import ConfigError
from .level import Level, gravity_of

Depth: TypeAlias = NDArray[np.uint16] | NDArray[np.float32]
"""A depth image [H, W]: uint16 in mm, 0 where there is no reading, or float32 in m, NaN where there is none."""
Item: TypeAlias = tuple[int, Depth] | Position | list[Position]
"""What an iterable may yield: a frame and its stamp in ns, a position, or all positions of one instant.

Positions that follow each other with equal stamps are one instant, too."""
Source: TypeAlias = str | os.PathLike[str] | Iterable[Item]
"""What may be streamed."""

DEMO = Path(__file__).with_name("demo.pcapng.zst")
"""The recording inside the package."""


def stream(
    source: Source | None = None,
    *,
    config: str | os.PathLike[str] | Mapping[str, Any] | Config | None = None,
    camera: str | os.PathLike[str] | Mapping[str, Any] | CameraConfig | None = None,
    positions: bool = False,
    provisional: bool = False,
    frames: bool = False,
    level: Level | None = None,
    record: str | os.PathLike[str] | None = None,
    timeout: float | None = 2.0,
    reconnect: bool | float = False,
    law: Law | None = None,
) -> Stream:
    """Iterate over what happens in `source`.

    `source` is `"demo"`, the path of an `*.npz` (depth frames), of a `*.pcapng` or `*.pcap` (a usbmon capture of a Kinect, also `.gz` or
    `.zst`; `?lose=0.05&seed=3` behind it loses packets on purpose), of a folder with `INDEX.txt` (fakenect) or `depth.txt` (TUM RGB-D), or
    of a `*.csv` (positions), `"-"` (a CSV on stdin), a simulated scene `"sim:SCENE"` (`"sim:bounce?seed=3"`; `physinc simulate --help`
    names all), or an iterable of `(timestamp_ns, depth)` or `Position`.
    Left out it is a live Kinect, as is `"kinect"`; `"kinect:SERIAL"` is the one of that serial number (or place, `1-2.1`, or index),
    `"kinect?transfers=16&packets=8"` has so many transfers of so many packets under way: fewer packets come sooner, and cost more.

    `config` is the path of a TOML file, a dict of the same shape, or a `Config`; `camera` likewise a camera file, a dict or a
    `CameraConfig`, in place of the file beside a recording. `[camera]` in `config` wins over both.

    With `positions` every position is told, with `provisional` also events that a later one will replace.
    With `frames` the stream's `frame` is the newest depth image, whatever the events have come to: images that nobody looked at are gone,
    events are not.
    With `level="accelerometer"` the world of a live Kinect is level, as far as its accelerometer knows, unless `world_from_camera` is
    given: z is up, y forward. Where thrown balls show another gravity, that is told (`level_disagreement`).
    With `record`, what the source delivers is recorded there, too, as `physinc record` does: closing the stream completes the recording.
    After `timeout` seconds without input `StreamTimeoutError` is raised (`None`: wait as long as it takes), also while a pipe is
    opened; iterables are waited for.
    Of a live Kinect there is video as well: `"kinect?video=color"`, or `infrared`, and the stream's `video` is the newest image.
    With `reconnect` a device that is unplugged is awaited (if it is a number, for so many seconds), and the stream goes on; otherwise
    `DeviceDisconnectedError` is raised then.

    With `law` objects that nobody touches move by a law of your own instead of gravity and the air: `law(t, position, velocity)` returns
    the whole acceleration [3] (m/s², gravity included) at `t` seconds after a track began, for a position [3] (m) and a velocity [3] (m/s),
    in the world. It is called once for each track and frame in which the track is measured, with the state by the law so far (velocity is
    zero in a track's first frame), on the thread that reads the source. The engine integrates what it answers, linear in time between
    frames, and holds the last answer beyond. Gravity is taken as known (`laws.gravity`) then: nothing is learned of it. Beside it
    `laws.law = "free_fall"`, `laws.method = "best"` and a camera that doesn't move are needed.

    Raises `PhysincError`s that say what happened and what mends it; what an iterable or `law` raises passes unchanged,
    after `stream_ended` (reason `disconnected`) if the stream had begun.
    """
    config, camera = _plain(config), _plain(camera)
    away = None if reconnect is False else math.inf if reconnect is True else float(reconnect)
    if away is not None and not away >= 0:
        raise ConfigError(f"reconnect = {reconnect}: expected True, False, or seconds, at least 0")
    if source is None:
        source = "kinect"
    if isinstance(source, (str, os.PathLike)):
        return open_named(
            source,
            config=config,
            camera=camera,
            positions=positions,
            provisional=provisional,
            images=frames,
            level=level,
            record=record,
            reconnect=away,
            timeout=timeout,
            law=law,
        )
    gravity_of(source, level)
    if record is not None:
        raise ConfigError(f"record = {os.fspath(record)}: an iterable's own items can't be recorded; only what physinc reads itself")
    return open_iterable(source, config=config, camera=camera, positions=positions, provisional=provisional, images=frames, law=law)


def open_named(
    source: str | os.PathLike[str],
    *,
    config: Any = None,
    camera: Any = None,
    positions: bool = False,
    provisional: bool = False,
    images: bool = False,
    level: Level | None = None,
    frames: int | None = None,
    duration: float | None = None,
    every_frame: bool = False,
    reconnect: float | None = None,
    record: str | os.PathLike[str] | None = None,
    tum: bool = False,
    timeout: float | None = 2.0,
    law: Law | None = None,
) -> Stream:
    """Open a source by name, as the command line does: at most `frames` inputs, and `duration` seconds of them.

    A live device waits for the reader with `every_frame`, and may be away for `reconnect` seconds.
    """
    opened = open_source(
        path_of(source),
        name=text_of(source),
        config=config,
        camera=camera,
        positions=positions,
        provisional=provisional,
        images=images,
        gravity=gravity_of(os.fspath(source), level),
        frames=frames,
        duration=duration,
        every_frame=every_frame,
        reconnect=reconnect,
        record=record,
        tum=tum,
        timeout=timeout,
        law=law,
    )
    if law is not None:
        _LAWFUL.add(opened)
    return opened


def text_of(source: str | os.PathLike[str]) -> str:
    """Return a source's name as the engine reads it: in UTF-8, whatever the locale's encoding."""
    try:
        return os.fsencode(source).decode()
    except UnicodeError:
        raise ConfigError(f"{os.fspath(source)!a}: a source's name must be UTF-8; rename the file, or link to it") from None


def path_of(source: str | os.PathLike[str]) -> str:
    """Return what the engine opens for a source by name."""
    name, mark, faults = text_of(source).partition("?")
    return f"{DEMO}{mark}{faults}" if name == "demo" else f"{name}{mark}{faults}"


def _plain(mapping: Any) -> Any:
    return dict(mapping) if isinstance(mapping, Mapping) else mapping


_LAWFUL: weakref.WeakSet[Stream] = weakref.WeakSet()
"""Streams whose threads call Python: none may when the interpreter is gone."""


@atexit.register
def _let_go() -> None:
    for stream in list(_LAWFUL):
        stream.close()
