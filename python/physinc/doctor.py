"""`physinc doctor`: what may keep a Kinect from working, and what mends it."""

from __future__ import annotations

import ctypes.util
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

from . import parts
from .attached import Attached, System, attached, entries

RULE_PATH = "/etc/udev/rules.d/60-physinc.rules"
RULE = f"""# Kinect v1: for whoever sits at the machine (uaccess), and for the group plugdev, over the network too.
# physinc doctor --udev | sudo tee {RULE_PATH}; sudo udevadm control --reload; then plug it in again.
SUBSYSTEM=="usb", ENV{{DEVTYPE}}=="usb_device", ATTR{{idVendor}}=="{parts.VENDOR:04x}", \
ATTR{{idProduct}}=="{"|".join(f"{product:04x}" for product in parts.PRODUCTS)}", TAG+="uaccess", GROUP="plugdev", MODE="0660"
"""
"""The udev rule."""
RULE_FIX = f"`physinc doctor --udev | sudo tee {RULE_PATH}`, `sudo udevadm control --reload`, then plug the Kinect in again"
RULE_FOLDERS = ("/etc/udev/rules.d", "/run/udev/rules.d", "/usr/local/lib/udev/rules.d", "/usr/lib/udev/rules.d", "/lib/udev/rules.d")

STREAM_MB = 4
"""16 transfers of 64 packets of 1920 bytes are 2 MB; depth and images together twice that."""
STREAMS_A_BUS = 2
"""A Kinect's depth reserves 1920 of the about 6000 bytes that a bus gives away in a microframe."""

Verdict = Literal["good", "note", "bad"]
"""A note keeps nothing from working."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    verdict: Verdict
    what: str
    evidence: str
    fix: str | None = None


def examine(system: System, find_library: Callable[[str], str | None] = ctypes.util.find_library) -> Iterator[Finding]:
    """Look at all that may keep a Kinect from working, from the bus to the programs that hold it; what is missing first."""
    yield from bus(system)
    kinects = attached(system)
    yield from devices(kinects)
    for kinect in kinects:
        yield from permission(system, kinect)
        yield from kernel_driver(kinect)
        yield from holders(system, kinect)
        yield from speed(system, kinect)
    yield from crowd(kinects)
    yield from rule(system)
    yield from memory(system, len(kinects))
    yield from library(find_library)


def code(kinects: list[Attached], findings: list[Finding]) -> int:
    """Exit code: 3 no camera there, 1 something to mend, 0 all is well."""
    if not any(kinect.camera for kinect in kinects):
        return 3
    return 1 if any(finding.verdict == "bad" for finding in findings) else 0


def bus(system: System) -> Iterator[Finding]:
    """Look at the bus itself."""
    files, controllers = system.path("/dev/bus/usb"), list(entries(system.path("/sys/bus/usb/devices")))
    if files.is_dir() and controllers:
        yield Finding("good", "bus", "/dev/bus/usb")
    elif "microsoft" in (system.read("/proc/version") or "").lower():
        yield Finding("bad", "bus", "no USB in this WSL", "in Windows: `usbipd list`, then `usbipd attach --wsl --busid BUSID`")
    elif controllers:
        fix = "in a container, start it with `--device /dev/bus/usb`; else mount devtmpfs on /dev"
        yield Finding("bad", "bus", "sysfs has USB devices, but there is no /dev/bus/usb", fix)
    else:
        fix = "in a container, start it with `--device /dev/bus/usb`; in a virtual machine, hand the USB controller or the Kinect on to it"
        yield Finding("bad", "bus", "this machine has no USB", fix)


def devices(kinects: list[Attached]) -> Iterator[Finding]:
    """Look which Kinects there are, and which of their parts."""
    if not kinects:
        yield Finding(
            "bad", "device", "no Kinect on the bus", "plug in its USB cable, and its 12 V supply; `lsusb -d 045e:` shows its parts"
        )
    for kinect in kinects:
        name = f"Kinect {kinect.index}, model {kinect.model}, at {kinect.main.place}"
        if kinect.camera is None:
            fix = "plug in its 12 V supply: without it a Kinect's camera is off"
            yield Finding("bad", "device", f"{name}: no camera", fix)
        elif kinect.model != "1414":
            yield Finding("note", "device", f"{name}: {parts.BEYOND_1414}")
        elif kinect.motor is None:
            fix = "for tilt, LED and accelerometer unplug it and plug it in again; depth works without"
            yield Finding("note", "device", f"{name}: no motor", fix)
        else:
            yield Finding("good", "device", name)


def permission(system: System, kinect: Attached) -> Iterator[Finding]:
    """Whether this user may open its parts."""
    refused = [device.node for device in kinect.devices if device.idProduct not in parts.AUDIOS and not system.may_use(device)]
    if refused:
        yield Finding("bad", "permission", f"no permission for {' and '.join(refused)} (Kinect {kinect.index})", RULE_FIX)
    else:
        yield Finding("good", "permission", f"Kinect {kinect.index}")


def kernel_driver(kinect: Attached) -> Iterator[Finding]:
    """Look for the webcam driver that Linux has for it."""
    driver = kinect.camera and kinect.camera.driver
    if driver and driver != "usbfs":
        keep_out = f"`echo blacklist {driver} | sudo tee /etc/modprobe.d/physinc.conf`, `sudo modprobe -r {driver}`"
        evidence = f"{driver} has the camera of Kinect {kinect.index}; physinc takes it for as long as it streams"
        yield Finding("note", "kernel driver", evidence, f"to keep it out: {keep_out}")


def holders(system: System, kinect: Attached) -> Iterator[Finding]:
    """Programs that use it now."""
    if kinect.camera is not None and (programs := system.holders(kinect.camera)):
        yield Finding("bad", "in use", f"Kinect {kinect.index} is in use by {' and '.join(programs)}", "end that")


def speed(system: System, kinect: Attached) -> Iterator[Finding]:
    """Look at its connection, and at what is between it and the machine."""
    if kinect.camera is None:
        return
    if kinect.camera.speed_mbps < 480:
        fix = "plug it into another port, with another cable, without a hub"
        yield Finding("bad", "speed", f"Kinect {kinect.index} runs at {kinect.camera.speed_mbps:g} of 480 Mbit/s", fix)
        return
    # One hub is inside of each Kinect.
    outer = len(kinect.camera.port_numbers) - 2
    if outer > 0:
        evidence = f"Kinect {kinect.index} is behind {'a hub' if outer == 1 else f'{outer} hubs'}"
        yield Finding("note", "hub", evidence, "if packets are lost, or it comes and goes: plug it into the machine itself")
    controller = system.read(f"/sys/bus/usb/devices/usb{kinect.camera.bus}/product") or ""
    if "xhci" in controller.lower():
        fix = "if no frames come, or packets are lost: another port, of another controller (`lsusb -t`), or a USB 2 hub between"
        yield Finding("note", "USB 3", f"Kinect {kinect.index} is at a USB 3 controller; most work, some lose its packets", fix)


def crowd(kinects: list[Attached]) -> Iterator[Finding]:
    """Whether several share a bus."""
    cameras = sorted(kinect.camera.bus for kinect in kinects if kinect.camera is not None)
    for number, group in groupby(cameras):
        if (count := len(list(group))) > STREAMS_A_BUS:
            evidence = f"{count} Kinects on bus {number}, which has room for {STREAMS_A_BUS}"
            yield Finding("bad", "bandwidth", evidence, "plug the others into ports of another controller (`lsusb -t`)")


def rule(system: System) -> Iterator[Finding]:
    """Whether a udev rule lets people use it."""
    wanted = f"{parts.CAMERAS[0]:04x}"
    for folder in RULE_FOLDERS:
        for path in entries(system.path(folder)):
            if path.suffix == ".rules" and wanted in (system.read(f"{folder}/{path.name}") or ""):
                yield Finding("good", "udev rule", f"{folder}/{path.name}")
                return
    yield Finding("note", "udev rule", "none for a Kinect", f"to use it without root: {RULE_FIX}")


def memory(system: System, kinects: int) -> Iterator[Finding]:
    """Memory that the kernel lends to USB programs."""
    name = "/sys/module/usbcore/parameters/usbfs_memory_mb"
    told = system.read(name) or ""
    needed = STREAM_MB * max(kinects, 1)
    if told.isdecimal() and 0 < int(told) < needed:
        fix = f"`echo 64 | sudo tee {name}`; for good, `usbcore.usbfs_memory_mb=64` on the kernel's command line"
        yield Finding("bad", "usbfs memory", f"{told} MB, of which {needed} are needed", fix)
    elif told.isdecimal():
        yield Finding("good", "usbfs memory", "no limit" if told == "0" else f"{told} MB")


def library(find_library: Callable[[str], str | None]) -> Iterator[Finding]:
    """Look for the system's libusb, which the motor needs."""
    found = find_library("usb-1.0")
    if found is None:
        fix = "for tilt, LED and accelerometer: `sudo apt install libusb-1.0-0`; depth works without"
        yield Finding("note", "libusb", "none on this machine", fix)
    else:
        yield Finding("good", "libusb", found)
