"""The USB devices that a Kinect v1 consists of: a hub, and behind it camera, audio and, in model 1414, a motor."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import Protocol, TypeVar

VENDOR = 0x045E
CAMERAS = (0x02AE, 0x02BF)
"""Xbox 360, Kinect for Windows."""
MOTOR = 0x02B0
AUDIOS = (0x02AD, 0x02BB, 0x02BE, 0x02C3)
PRODUCTS = (*CAMERAS, MOTOR, *AUDIOS)
RELEASE_1414 = 0x010B
"""bcdDevice of a 1414's camera; any other behaves as a 1473's."""

BEYOND_1414 = (
    "LED, tilt and accelerometer of this model are behind its audio part, after a firmware upload that physinc doesn't carry; depth, events"
    " and recordings work without them, thrown balls tell the tilt (camera_orientation), and a model 1414 has them all"
)


class Part(Protocol):
    """A USB device, as pyusb names what it says of itself."""

    @property
    def idProduct(self) -> int:  # noqa: N802
        """Of the USB product."""

    @property
    def bcdDevice(self) -> int:  # noqa: N802
        """Its release."""

    @property
    def bus(self) -> int:
        """Number of the bus."""

    @property
    def port_numbers(self) -> tuple[int, ...] | None:
        """From the root hub on."""


P = TypeVar("P", bound=Part)


def place(part: Part) -> tuple[int, tuple[int, ...]]:
    """Bus, and ports from the root hub on."""
    return part.bus, tuple(part.port_numbers or ())


def path(part: Part) -> str:
    """Bus and ports as the kernel writes them: `1-2.3`."""
    bus, ports = place(part)
    return f"{bus}-{'.'.join(map(str, ports))}"


def kinects(parts: Iterable[P]) -> list[list[P]]:
    """Group the parts that share a hub: one list a Kinect, those with a camera first, then by bus and port, as indices count them."""

    def hub(part: P) -> tuple[int, tuple[int, ...]]:
        bus, ports = place(part)
        return bus, ports[:-1]

    groups = [list(group) for _, group in groupby(sorted(parts, key=place), hub)]
    return sorted(groups, key=lambda group: camera(group) is None)


def camera(kinect: Iterable[P]) -> P | None:
    """Return the camera among the parts of a Kinect."""
    return next((part for part in kinect if part.idProduct in CAMERAS), None)


def motor(kinect: Iterable[P]) -> P | None:
    """Return the motor among the parts of a Kinect."""
    return next((part for part in kinect if part.idProduct == MOTOR), None)


def model(kinect: Iterable[P]) -> str:
    """1414, 1473, K4W, or `unknown` where no camera says it: only a 1414's motor is a device of its own."""
    parts = list(kinect)
    found = camera(parts)
    if found is None:
        return "unknown" if motor(parts) is None else "1414"
    if found.idProduct != CAMERAS[0]:
        return "K4W"
    return "1414" if found.bcdDevice == RELEASE_1414 else "1473"
