"""`physinc tilt` and `physinc led`."""

from __future__ import annotations

import sys
from typing import Annotated

from cyclopts import Parameter, validators

from .motor import TILT_LIMIT_DEG, Led, Motor

Which = Annotated[str | None, Parameter(name="--kinect", show_default=False)]


def tilt(
    degrees: Annotated[
        float | None, Parameter(allow_leading_hyphen=True, validator=validators.Number(gte=-TILT_LIMIT_DEG, lte=TILT_LIMIT_DEG))
    ] = None,
    /,
    *,
    kinect: Which = None,
) -> int:
    """Tilt a Kinect's head to DEGREES above the horizon and wait until it stands; without, print tilt and accelerometer.

    Parameters
    ----------
    degrees
        -27 to 27; 0 looks level, even if its foot doesn't stand so.
    kinect
        Serial number, place (1-2.3) or index, as in `physinc devices`; left out, the first one.

    """
    with Motor(kinect) as motor:
        if degrees is not None:
            motor.tilt(degrees)
        state = motor.state()
        gravity = motor.accelerometer(readings=10)
    angle = "moving" if state.degrees is None else f"{state.degrees:+.1f}° above the horizon, {state.status.replace('_', ' ')}"
    x, y, z = gravity
    sys.stdout.write(f"tilt {angle}; gravity in the camera (x right, y down, z forward): {x:+.2f} {y:+.2f} {z:+.2f} m/s²\n")
    return 0


def led(color: Led, /, *, kinect: Which = None) -> int:
    """Show COLOR on a Kinect's LED.

    Parameters
    ----------
    color
        off, green, red, yellow, blink_green or blink_red_yellow.
    kinect
        Serial number, place (1-2.3) or index, as in `physinc devices`; left out, the first one.

    """
    with Motor(kinect) as motor:
        motor.led(color)
    return 0
