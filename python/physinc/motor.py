"""The motor of a Kinect v1, model 1414: tilt, LED, accelerometer. Nothing else needs it."""

from __future__ import annotations

import contextlib
import ctypes.util
import errno
import struct
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np
import usb.core
import usb.util
from numpy.typing import NDArray

from . import parts
from .attached import System
from .doctor import RULE_FIX
from .errors import (
    ConfigError,
    DeviceBusyError,
    DeviceDisconnectedError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceReplyError,
    DeviceTimeoutError,
)

if TYPE_CHECKING:
    from typing_extensions import Self

Led = Literal["off", "green", "red", "yellow", "blink_green", "blink_red_yellow"]
"""What the LED can show."""
TiltStatus = Literal["stopped", "at_limit", "moving"]
"""What the motor is doing; `at_limit` is held by the end of its way."""

LEDS: dict[Led, int] = dict(zip(get_args(Led), (0, 1, 2, 3, 4, 6), strict=True))
STATUSES: dict[int, TiltStatus] = {0: "stopped", 1: "at_limit", 4: "moving"}
TILT_LIMIT_DEG = 27.0
"""What its maker allows. The head's way ends at about 31°, where plastic gears press against a stop."""
BETWEEN_TILTS = 20 / 15
"""Its maker allows 15 tilts in 20 s; s."""
COUNTS_PER_G = 819
STANDARD_GRAVITY = 9.80665
"""m/s²"""
POLL = 0.1
"""s; a motor that starts says so within two of these."""


class State(NamedTuple):
    """One reading."""

    gravity_in_camera: NDArray[np.float64]
    """[3], m/s²."""
    degrees: float | None
    """Of the head above the horizon; None while it moves."""
    status: TiltStatus


class Motor:
    """Tilt, LED and accelerometer of a Kinect v1, model 1414; a context manager.

    `serial` is the serial number of its camera, its place (`"1-2.3"`), or an index: Kinects are counted from 0 by bus and port, as
    `physinc devices` lists them. Left out it is the first one with a motor. The camera may be streaming, in use by another program, or
    missing.

    Raises `DeviceNotFoundError` (none there, or a model whose motor is behind firmware), `DevicePermissionError`, and, of each
    method, `DeviceTimeoutError`, `DeviceDisconnectedError` and `DeviceReplyError`.

        with physinc.Motor() as motor:
            motor.led("green")
            motor.tilt(-10)
    """

    def __init__(self, serial: str | int | None = None) -> None:
        self._device = find(serial)
        self._may_tilt = -float("inf")
        self.state()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let the device go. LED and tilt stay as they are."""
        usb.util.dispose_resources(self._device)

    def state(self) -> State:
        """Read accelerometer, angle and status at once."""
        with told():
            reply = bytes(self._device.ctrl_transfer(0xC0, 0x32, 0, 0, 10))
        if len(reply) != 10:
            raise DeviceReplyError(f"the Kinect's motor told its state in {len(reply)} bytes instead of 10: unplug it and plug it in again")
        x, y, z, half_degrees, status = struct.unpack(">2x3hbB", reply)
        if status not in STATUSES:
            raise DeviceReplyError(f"the Kinect's motor has status {status}, expected 0, 1 or 4: unplug it and plug it in again")
        # At rest the accelerometer tells what holds it up, not what pulls; its x goes left, y up, z forward.
        gravity = np.array((x, y, -z)) * (STANDARD_GRAVITY / COUNTS_PER_G)
        moving = STATUSES[status] == "moving"
        return State(gravity, None if moving else half_degrees / 2, STATUSES[status])

    @property
    def tilt_status(self) -> TiltStatus:
        """What it is doing now."""
        return self.state().status

    @property
    def tilt_degrees(self) -> float | None:
        """Angle of the head above the horizon, in steps of half a degree; None while it moves."""
        return self.state().degrees

    def accelerometer(self, readings: int = 1) -> NDArray[np.float64]:
        """Gravity in the camera frame [3], m/s² (x right, y down, z forward): the mean of so many `readings`, 20 ms apart.

        This is where gravity pulls, `[0, 9.81, 0]` if the camera is level: what `camera_orientation` calls `gravity_in_camera`. An
        accelerometer at rest feels the opposite, the proper acceleration; while the head is shaken, this is gravity less that motion.
        It sits in the head: the motor's tilt is in it. One step is 12 mm/s² (0.07°); a unit's own error may be 3°, and drifts with its
        temperature.
        """
        if readings < 1:
            raise ConfigError(f"readings = {readings}: expected 1 or more")
        samples: list[NDArray[np.float64]] = []
        for i in range(readings):
            if i:
                time.sleep(0.02)
            samples.append(self.state().gravity_in_camera)
        mean: NDArray[np.float64] = np.mean(samples, axis=0)
        return mean

    def tilt(self, degrees: float, *, timeout: float = 10.0) -> float:
        """Tilt the head to `degrees` above the horizon, −27 to 27, and wait until it stands; the angle at which it does.

        The horizon is gravity's, not the foot's. Its maker allows ±27° (a way of plastic gears that ends at about 31°), and 15 tilts in
        20 s: a sooner one waits. A motor that is still moving after `timeout` s is a `DeviceTimeoutError`. At a limit of
        its way, on a slanted shelf, it stands before it is there.
        """
        if not -TILT_LIMIT_DEG <= degrees <= TILT_LIMIT_DEG:
            raise ConfigError(f"tilt = {degrees}: expected −27 to 27 degrees above the horizon")
        time.sleep(max(0.0, self._may_tilt - time.monotonic()))
        with told():
            self._device.ctrl_transfer(0x40, 0x31, round(2 * degrees) & 0xFFFF)
        self._may_tilt = time.monotonic() + BETWEEN_TILTS
        until, standing = time.monotonic() + timeout, 0
        while True:
            time.sleep(POLL)
            state = self.state()
            standing = 0 if state.degrees is None else standing + 1
            if state.degrees is not None and standing == 3:
                return state.degrees
            if time.monotonic() > until:
                raise DeviceTimeoutError(f"the Kinect's head is still moving {timeout:g} s after a tilt to {degrees:g}°: is it held?")

    def led(self, color: Led) -> None:
        """Show `color`: off, green, red, yellow, blink_green or blink_red_yellow."""
        if color not in LEDS:
            raise ConfigError(f"led = {color!r}: expected {', '.join(LEDS)}")
        with told():
            self._device.ctrl_transfer(0x40, 0x06, LEDS[color])


def find(serial: str | int | None) -> Any:
    """Return the USB device that is the motor of the Kinect `serial`."""
    found = parts.kinects(attached())
    if not found:
        raise DeviceNotFoundError("no Kinect found: plug in its USB cable and its 12 V supply; `physinc doctor` says what is missing")
    chosen = next((kinect for kinect in found if turns(kinect)), found[0]) if serial is None else named(found, str(serial))
    if turns(chosen):
        return parts.motor(chosen)
    if parts.model(chosen) == "1414":
        raise DeviceNotFoundError("this Kinect's camera is there, its motor isn't: unplug it and plug it in again, then `physinc doctor`")
    raise DeviceNotFoundError(f"the motor of a Kinect {parts.model(chosen)} is out of reach: {parts.BEYOND_1414}")


def turns(kinect: list[Any]) -> bool:
    """Whether it has a motor that answers: later models show one that doesn't."""
    return parts.motor(kinect) is not None and parts.model(kinect) == "1414"


def attached() -> list[Any]:
    """All parts of Kinects on the bus."""

    def is_part(device: Any) -> bool:
        return device.idVendor == parts.VENDOR and device.idProduct in parts.PRODUCTS

    try:
        return list(usb.core.find(find_all=True, custom_match=is_part))
    except usb.core.NoBackendError:
        if ctypes.util.find_library("usb-1.0") is None:
            raise DeviceNotFoundError("no libusb-1.0 on this machine: `sudo apt install libusb-1.0-0`") from None
        raise DeviceNotFoundError("libusb finds no USB bus on this machine: `physinc doctor` says what is missing") from None


def named(found: list[list[Any]], name: str) -> list[Any]:
    """Return the Kinect of that serial number, at that place, or with that index."""
    for kinect in found:
        if any(name in (parts.path(part), serial_of(part)) for part in kinect):
            return kinect
    if name.isdecimal() and int(name) < len(found):
        return found[int(name)]
    there = "there is 1" if len(found) == 1 else f"there are {len(found)}"
    raise DeviceNotFoundError(f"no Kinect {name}: {there}; `physinc devices` lists them")


def serial_of(part: Any) -> str | None:
    """Return a serial number: as the system has read it, for which nobody needs permission, else as the device tells."""
    if not part.iSerialNumber:
        return None
    serial: str | None = System().read(f"/sys/bus/usb/devices/{parts.path(part)}/serial")
    if serial is None:
        with told():
            serial = part.serial_number
    return serial


@contextlib.contextmanager
def told() -> Iterator[None]:
    """Tell what the bus refuses as errors that say what mends it."""
    try:
        yield
    except usb.core.USBTimeoutError as error:
        raise DeviceTimeoutError("the Kinect's motor doesn't answer: unplug it and plug it in again") from error
    except usb.core.USBError as error:
        match error.errno:
            case errno.EACCES | errno.EPERM:
                raise DevicePermissionError(f"no permission for the Kinect's motor: {RULE_FIX}") from error
            case errno.EBUSY:
                raise DeviceBusyError("another program holds the Kinect's motor: `physinc devices` says which") from error
            case errno.ENODEV | errno.ENOENT | errno.EIO:
                raise DeviceDisconnectedError("the Kinect's motor is gone: plug it in again") from error
            case _:
                raise DeviceReplyError(f"the Kinect's motor refuses: {error.strerror}; unplug it and plug it in again") from error
