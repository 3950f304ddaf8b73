"""Which way is down, by a live Kinect's own accelerometer."""

from __future__ import annotations

import time
from typing import Literal

import numpy as np

from .errors import ConfigError, DeviceReplyError
from .motor import POLL, Motor, State

Level = Literal["accelerometer"]
"""What may tell a stream's level."""

READINGS = 25
"""Half a second; their mean is finer than one step of the accelerometer."""
PATIENCE = 10.0
"""As long as a head may take to come to rest, s."""
PLAUSIBLE = (8.3, 11.3)
"""Gravity is 9.8 m/s², and a unit's zero may be off by 0.5 an axis."""


def gravity_of(source: object, level: Level | None) -> list[float] | None:
    """Gravity in the camera frame [3], m/s², of the live Kinect `source`, where `level` asks for it.

    Raises `ConfigError` where the source has no accelerometer, and what `physinc.Motor` raises.
    """
    if level is None:
        return None
    if level != "accelerometer":
        raise ConfigError(f"level = {level!r}: expected 'accelerometer', or None")
    # Behind a question mark are details of the transfers.
    name, _, which = source.partition("?")[0].partition(":") if isinstance(source, str) else ("", "", "")
    if name != "kinect":
        what = source if isinstance(source, str) else "an iterable"
        raise ConfigError(
            f"level = 'accelerometer': {what} has none, only a live Kinect has (a recording keeps what it said in camera.toml)"
        )
    # `kinect` is the first one, here as for the stream.
    with Motor(which or 0) as motor:
        at_rest(motor)
        gravity = motor.accelerometer(READINGS)
    size = float(np.linalg.norm(gravity))
    if not PLAUSIBLE[0] <= size <= PLAUSIBLE[1]:
        raise DeviceReplyError(f"the accelerometer says that gravity is {size:.1f} m/s²: let the Kinect stand still, or leave level out")
    return [float(component) for component in gravity]


def at_rest(motor: Motor) -> State:
    """Wait until the head stands, or has had the time to."""
    until = time.monotonic() + PATIENCE
    while (state := motor.state()).status == "moving" and time.monotonic() < until:
        time.sleep(POLL)
    return state
