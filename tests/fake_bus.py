"""A bus with Kinects on it, as pyusb sees one."""

from __future__ import annotations

import array
import struct
from types import SimpleNamespace
from typing import Any

import pytest
import usb.backend
import usb.core

from physinc import motor as motors


class Bus(usb.backend.IBackend):  # type: ignore[misc]
    """Kinects on a bus: their parts, and the state of their motors."""

    def __init__(self, *devices: tuple[int, int, tuple[int, ...], str | None]) -> None:
        super().__init__()
        self.devices = [
            SimpleNamespace(product=product, release=release, ports=ports, serial=serial) for product, release, ports, serial in devices
        ]
        self.requests: list[tuple[int, int, int]] = []
        self.replies: list[bytes] = []
        self.standing = reply((0, 819, 0))
        self.refuses: int | None = None

    def enumerate_devices(self) -> Any:
        return iter(self.devices)

    def get_device_descriptor(self, device: Any) -> Any:
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x200, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0, bMaxPacketSize0=64,
            idVendor=0x45E, idProduct=device.product, bcdDevice=device.release, iManufacturer=0, iProduct=0,
            iSerialNumber=3 if device.serial else 0, bNumConfigurations=1, address=self.devices.index(device) + 2, bus=1,
            port_number=device.ports[-1], port_numbers=device.ports, speed=3,
        )  # fmt: skip

    def open_device(self, device: Any) -> Any:
        if self.refuses is not None:
            raise usb.core.USBError("refused", -3, self.refuses)
        return device

    def close_device(self, handle: Any) -> None:
        pass

    def ctrl_transfer(self, handle: Any, kind: int, request: int, value: int, *rest: Any) -> int:
        data = rest[1]
        if (kind, request) == (0x80, 6):
            return fill(data, b"\x04\x03\x09\x04" if value & 0xFF == 0 else string(handle.serial))
        assert handle.product == 0x2B0
        if self.refuses is not None:
            error = usb.core.USBTimeoutError if self.refuses == 110 else usb.core.USBError
            raise error("refused", -4, self.refuses)
        self.requests.append((kind, request, value))
        if (kind, request) == (0xC0, 0x32):
            return fill(data, self.replies.pop(0) if self.replies else self.standing)
        if request == 0x31:
            half_degrees = value - 0x10000 if value & 0x8000 else value
            self.replies += [reply((0, 819, 0), -128, 4)] * 3
            self.standing = reply((0, 819, 0), half_degrees)
        return 0


def reply(counts: tuple[int, int, int], half_degrees: int = 0, status: int = 0) -> bytes:
    return struct.pack(">2x3hbB", *counts, half_degrees, status)


def string(text: str) -> bytes:
    encoded = text.encode("utf-16-le")
    return bytes([2 + len(encoded), 3]) + encoded


def fill(data: array.array[int], content: bytes) -> int:
    content = content[: len(data)]
    data[: len(content)] = array.array("B", content)
    return len(content)


CAMERA = (0x2AE, 0x10B, (2, 3), "A001")
MOTOR = (0x2B0, 0x105, (2, 1), None)
AUDIO = (0x2AD, 0x100, (2, 2), "A001")


@pytest.fixture
def attach(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that puts devices on the bus."""
    find = usb.core.find

    def attach(*devices: Any) -> Bus:
        bus = Bus(*devices)
        monkeypatch.setattr(usb.core, "find", lambda **options: find(backend=bus, **options))
        return bus

    monkeypatch.setattr(motors, "BETWEEN_TILTS", 0.0)
    monkeypatch.setattr(motors, "POLL", 0.0)
    return attach
