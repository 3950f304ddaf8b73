"""What sysfs, device files and /proc tell of Kinects, and what the doctor makes of it."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from physinc import device_commands, doctor
from physinc.attached import System, attached
from physinc.cli import main


class Tree:
    """A machine of files: a USB 2 bus, and what is plugged in."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.system = System(root)
        self.write("/sys/bus/usb/devices/usb1/product", "EHCI Host Controller")
        self.write("/sys/module/usbcore/parameters/usbfs_memory_mb", "16")
        self.write("/etc/udev/rules.d/60-physinc.rules", doctor.RULE)
        (root / "dev/bus/usb").mkdir(parents=True)

    def write(self, path: str, text: str) -> Path:
        file = self.root / path.lstrip("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text + "\n")
        return file

    def plug(self, place: str, address: int, product: int, release: int = 0x10B, /, **fields: str) -> Path:
        bus = int(place.partition("-")[0])
        defaults = {
            "idVendor": "045e", "idProduct": f"{product:04x}", "bcdDevice": f"{release:04x}", "busnum": str(bus), "devnum": str(address),
            "speed": "480",
        }  # fmt: skip
        for name, text in (defaults | fields).items():
            self.write(f"/sys/bus/usb/devices/{place}/{name}", text)
        return self.write(f"/dev/bus/usb/{bus:03}/{address:03}", "")

    def kinect(self, hub: str = "1-2", address: int = 3, **fields: str) -> Tree:
        self.plug(f"{hub}.1", address, 0x2B0)
        self.plug(f"{hub}.2", address + 1, 0x2AD, serial="A001")
        self.plug(f"{hub}.3", address + 2, 0x2AE, **{"serial": "A001", **fields})
        return self

    def bind(self, place: str, driver: str) -> Tree:
        link = self.root / f"sys/bus/usb/devices/{place}/{place}:1.0/driver"
        link.parent.mkdir()
        link.symlink_to(f"../../../bus/usb/drivers/{driver}")
        return self

    def hold(self, process: int, name: str, node: str) -> Tree:
        self.write(f"/proc/{process}/comm", name)
        link = self.root / f"proc/{process}/fd/7"
        link.parent.mkdir()
        link.symlink_to(node)
        return self

    def remove(self, path: str) -> Tree:
        (self.root / path.lstrip("/")).unlink()
        return self

    def findings(self) -> dict[str, doctor.Finding]:
        """By what they are about; all is well in the others."""
        found = doctor.examine(self.system, lambda _: "libusb-1.0.so.0")
        return {finding.what: finding for finding in found if finding.verdict != "good"}

    @property
    def code(self) -> int:
        return doctor.code(attached(self.system), list(doctor.examine(self.system, lambda _: "libusb-1.0.so.0")))


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    return Tree(tmp_path)


def test_a_kinect_that_is_all_well(tree: Tree) -> None:
    tree.kinect()
    assert tree.findings() == {}
    assert tree.code == 0


def crowd(tree: Tree) -> None:
    for i in range(3):
        tree.kinect(f"1-{i + 2}", 10 * (i + 1))


def no_permission(tree: Tree) -> None:
    tree.kinect()
    tree.system = Refusing(tree.root)


class Refusing(System):
    """The tests may run as root, who may everything."""

    def may_use(self, device: Any) -> bool:
        return "02ad" in hex(device.idProduct)


USBFS_MEMORY = "/sys/module/usbcore/parameters/usbfs_memory_mb"

AILMENTS: list[tuple[Callable[[Tree], object], int, str, str, str | None]] = [
    (no_permission, 1, "permission", "no permission for /dev/bus/usb/001/003 and /dev/bus/usb/001/005", "doctor --udev"),
    (lambda t: t.kinect().bind("1-2.3", "gspca_kinect"), 0, "kernel driver", "gspca_kinect has the camera", "modprobe -r"),
    (lambda t: t.kinect().hold(42, "cheese", "/dev/bus/usb/001/005"), 1, "in use", r"cheese \(process 42\)", "end that"),
    (lambda t: t.kinect(speed="12"), 1, "speed", "12 of 480", "another port"),
    (lambda t: t.kinect("1-2.4"), 0, "hub", "behind a hub", "into the machine"),
    (lambda t: t.kinect().write("/sys/bus/usb/devices/usb1/product", "xHCI Host Controller"), 0, "USB 3", "USB 3", "controller"),
    (crowd, 1, "bandwidth", "3 Kinects on bus 1", "another controller"),
    (lambda t: t.kinect().remove(doctor.RULE_PATH), 0, "udev rule", "none", "without root"),
    (lambda t: t.kinect().write(USBFS_MEMORY, "2"), 1, "usbfs memory", "2 MB, of which 4", "tee /sys/module/usbcore"),
    (lambda _: None, 3, "device", "no Kinect on the bus", "12 V"),
    (lambda t: t.plug("1-2.1", 3, 0x2B0), 3, "device", "model 1414, at 1-2.1: no camera", "12 V"),
    (lambda t: t.plug("1-2.3", 3, 0x2AE), 0, "device", "no motor", "depth works"),
    (lambda t: t.plug("1-2.3", 3, 0x2AE, 0x114), 0, "device", "model 1473.* depth", None),
]


@pytest.mark.parametrize("ailment", AILMENTS)
def test_each_ailment_has_its_evidence_and_its_fix(tree: Tree, ailment: Any) -> None:
    ail, code, what, evidence, fix = ailment
    ail(tree)
    findings = tree.findings()
    assert list(findings) == [what]
    assert re.search(evidence, findings[what].evidence)
    assert fix is None or fix in (findings[what].fix or "")
    assert tree.code == code


@pytest.mark.parametrize(
    ("version", "controllers", "evidence", "fix"),
    [
        ("Linux", False, "no USB", "--device /dev/bus/usb"),
        ("Linux", True, "no /dev/bus/usb", "--device"),
        ("Microsoft WSL2", False, "WSL", "usbipd"),
    ],
)
def test_a_machine_without_a_bus(tmp_path: Path, version: str, controllers: bool, evidence: str, fix: str) -> None:
    (tmp_path / "proc").mkdir()
    (tmp_path / "proc/version").write_text(version)
    if controllers:
        (tmp_path / "sys/bus/usb/devices/usb1").mkdir(parents=True)
    finding = next(doctor.examine(System(tmp_path), lambda _: None))
    assert finding.verdict == "bad"
    assert evidence in finding.evidence
    assert fix in (finding.fix or "")
    assert doctor.code(attached(System(tmp_path)), [finding]) == 3


def test_no_libusb_is_a_note(tree: Tree) -> None:
    tree.kinect()
    *_, last = doctor.examine(tree.system, lambda _: None)
    assert (last.verdict, last.what) == ("note", "libusb")
    assert "apt install libusb-1.0-0" in (last.fix or "")


def test_sysfs_that_makes_no_sense_is_no_kinect(tree: Tree) -> None:
    tree.plug("1-2.3", 3, 0x2AE, busnum="one")
    tree.plug("1-2.2", 4, 0x2AD, idVendor="")
    tree.write("/sys/bus/usb/devices/1-2.1/idVendor", "045e")
    assert attached(tree.system) == []


def test_kinects_are_listed(tree: Tree, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    tree.kinect("1-3", 20, serial="0000000000000000", bcdDevice="0114")
    tree.plug("1-2.1", 9, 0x2B0)
    tree.kinect("1-10", 30, serial="B[2]")
    tree.bind("1-3.3", "usbfs")
    tree.hold(42, "cheese", "/dev/bus/usb/001/022")
    monkeypatch.setattr(device_commands, "System", lambda: tree.system)
    assert main(["devices", "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    rows = json.loads(out)
    # By port, as numbers; what has no camera is last.
    assert [(row["index"], row["place"], row["model"], row["serial"]) for row in rows] == [
        (0, "1-3.3", "1473", "A001"),
        (1, "1-10.3", "1414", "B[2]"),
        (2, "1-2.1", "1414", None),
    ]
    assert {name: rows[0][name] for name in ("node", "driver", "parts", "permission", "speed_mbps", "in_use_by")} == {
        "node": "/dev/bus/usb/001/022",
        "driver": "usbfs",
        "parts": ["camera", "motor", "audio"],
        "permission": True,
        "speed_mbps": 480.0,
        "in_use_by": ["cheese (process 42)"],
    }
    assert main(["devices"]) == 0
    out = capsys.readouterr().out
    assert all(text in out for text in ("1-10.3", "B[2]", "cheese"))


def test_without_one_the_list_is_empty(tree: Tree, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(device_commands, "System", lambda: tree.system)
    assert main(["devices", "--json"]) == 3
    out, err = capsys.readouterr()
    assert json.loads(out) == []
    assert "physinc doctor" in err
    assert main(["doctor"]) == 3
    assert "✗ device: no Kinect on the bus" in capsys.readouterr().out


def test_the_udev_rule_is_the_one_that_is_shipped(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--udev"]) == 0
    assert capsys.readouterr().out == (Path(__file__).parents[1] / "udev/60-physinc.rules").read_text()


def test_who_has_a_file_open_is_found_in_the_real_proc(tmp_path: Path) -> None:
    held = tmp_path / "dev/bus/usb/001/005"
    held.parent.mkdir(parents=True)
    held.touch()
    (tmp_path / "proc").symlink_to("/proc")
    tree = Tree(tmp_path / "tree")
    tree.kinect()
    camera = attached(tree.system)[0].main
    with held.open() as file, subprocess.Popen(["sleep", "60"], stdin=file) as sleeper:
        holders = System(tmp_path).holders(camera)
        sleeper.kill()
    assert [re.sub(".* ", "", holder) for holder in holders] == [f"{sleeper.pid})"]
