"""What Linux tells of attached Kinects without touching them: sysfs, device files, and who has them open."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from . import parts


@dataclass(frozen=True)
class Device:
    """A part of a Kinect, as sysfs tells."""

    place: str
    """Bus and ports: `1-2.3`."""
    idProduct: int  # noqa: N815
    bcdDevice: int  # noqa: N815
    bus: int
    address: int
    serial: str | None
    """None where it is zeros, or none."""
    speed_mbps: float
    driver: str | None
    """The kernel driver that has its first interface; `usbfs` is a program's."""

    @property
    def port_numbers(self) -> tuple[int, ...]:
        """From the root hub on."""
        return tuple(int(port) for port in self.place.partition("-")[2].split("."))

    @property
    def node(self) -> str:
        """The file by which programs open it."""
        return f"/dev/bus/usb/{self.bus:03}/{self.address:03}"


@dataclass(frozen=True)
class System:
    """The machine, or a tree of files that stands for one."""

    root: Path = Path("/")

    def path(self, absolute: str | Path) -> Path:
        """Where that file is."""
        return self.root / str(absolute).lstrip("/")

    def read(self, absolute: str | Path) -> str | None:
        """Return what the file says, without space around it; None where it can't be read."""
        try:
            return self.path(absolute).read_text(encoding="utf-8", errors="replace").strip()
        except OSError:
            return None

    def devices(self) -> list[Device]:
        """All parts of Kinects, in no order."""
        return [device for path in entries(self.path("/sys/bus/usb/devices")) if (device := self.device(path.name)) is not None]

    def device(self, place: str) -> Device | None:
        """Return the part of a Kinect that is plugged in there."""
        folder = Path("/sys/bus/usb/devices") / place
        fields = {name: self.read(folder / name) for name in ("idVendor", "idProduct", "bcdDevice", "busnum", "devnum", "serial", "speed")}
        # While one is being unplugged, anything may be missing.
        with contextlib.suppress(ValueError, TypeError):
            vendor, product = (int(fields[name] or "", 16) for name in ("idVendor", "idProduct"))
            if vendor == parts.VENDOR and product in parts.PRODUCTS and "-" in place:
                return Device(
                    place=place,
                    idProduct=product,
                    bcdDevice=int(fields["bcdDevice"] or "", 16),
                    bus=int(fields["busnum"] or ""),
                    address=int(fields["devnum"] or ""),
                    serial=fields["serial"] if (fields["serial"] or "").strip("0") else None,
                    speed_mbps=float(fields["speed"] or "nan"),
                    driver=self.link(folder / f"{place}:1.0" / "driver"),
                )
        return None

    def link(self, absolute: Path) -> str | None:
        """Return the name of what a link leads to."""
        try:
            return self.path(absolute).readlink().name
        except OSError:
            return None

    def may_use(self, device: Device) -> bool:
        """Whether this user may read and write its file."""
        return os.access(self.path(device.node), os.R_OK | os.W_OK)

    def holders(self, device: Device) -> list[str]:
        """Name the other programs that have its file open, as far as this user may know: `cheese (process 4711)`."""
        return [
            f"{self.read(f'/proc/{process.name}/comm') or 'a program'} (process {process.name})"
            for process in entries(self.path("/proc"))
            if process.name.isdecimal() and int(process.name) != os.getpid() and self.has_open(process, device.node)
        ]

    def has_open(self, process: Path, node: str) -> bool:
        """Whether a process has the file `node` open."""
        for descriptor in entries(process / "fd"):
            with contextlib.suppress(OSError):
                if str(descriptor.readlink()).endswith(node.lstrip("/")):
                    return True
        return False


def entries(folder: Path) -> Iterator[Path]:
    """All that is in a folder; nothing where it isn't there or can't be read."""
    with contextlib.suppress(OSError):
        yield from sorted(folder.iterdir())


@dataclass(frozen=True)
class Attached:
    """A Kinect: its parts, and what people call it."""

    index: int
    devices: list[Device]

    @property
    def camera(self) -> Device | None:
        """Its camera, if it is there."""
        return parts.camera(self.devices)

    @property
    def motor(self) -> Device | None:
        """Its motor, if it is there and a device of its own."""
        return parts.motor(self.devices)

    @property
    def main(self) -> Device:
        """The part that speaks for all: the camera, else the first."""
        return self.camera or self.devices[0]

    @property
    def model(self) -> str:
        """1414, 1473, K4W or unknown."""
        return parts.model(self.devices)

    @property
    def serial(self) -> str | None:
        """The camera's serial number; of models whose camera has none, the audio part's."""
        return self.main.serial or next((device.serial for device in self.devices if device.serial), None)


def attached(system: System) -> list[Attached]:
    """All Kinects, by index."""
    return [Attached(index, devices) for index, devices in enumerate(parts.kinects(system.devices()))]
