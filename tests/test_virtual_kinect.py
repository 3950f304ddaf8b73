"""The virtual Kinect, judged by programs that others wrote: libfreenect, libusb, lsusb, udev's listeners."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from virtual_kinect import VirtualKinect, truth

JUDGE = Path(__file__).parent / "judge/frames.c"


def run(*command: str | Path, timeout: float = 60) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)


def python(virtual: list[str], script: str) -> str:
    result = run(*virtual, sys.executable, "-c", script)
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.fixture(scope="session")
def judge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    program = tmp_path_factory.mktemp("judge") / "frames"
    subprocess.run(["cc", "-O2", "-I/usr/include/libusb-1.0", JUDGE, "-o", program, "-lfreenect"], check=True)
    return program


@pytest.mark.parametrize(("bits", "options"), [(11, []), (10, []), (11, ["--model", "1473"]), (11, ["--driver", "gspca_kinect"])])
def test_libfreenect_gets_every_frame(virtual_kinect: VirtualKinect, judge: Path, tmp_path: Path, bits: int, options: list[str]) -> None:
    told = tmp_path / "truth"
    result = run(*virtual_kinect("sim:bounce?seed=3", "--truth", str(told), *options), judge, str(bits), "60")
    assert result.returncode == 0, result.stderr
    lines = [line for line in result.stdout.splitlines() if line[:1].isdigit()]
    delivered = [(int(ticks), int(crc)) for ticks, crc in map(str.split, lines)]
    sent = [(frame["ticks"], frame["crc32"]) for frame in truth(told)]
    # It delivers nothing while its start goes on.
    first = sent.index(delivered[0])
    assert len(delivered) == 60
    assert delivered == sent[first : first + 60]
    if bits == 10:
        return
    assert len({crc for _, crc in delivered}) > 1, "something moves"


def test_lsusb_shows_a_kinect(virtual_kinect: VirtualKinect) -> None:
    shown = run(*virtual_kinect(), "lsusb", "-v", "-d", "045e:02ae").stdout
    for line in ["bcdDevice            1.0b", "wMaxPacketSize     0x0bc0  2x 960 bytes", "bEndpointAddress     0x82  EP 2 IN"]:
        assert line in shown
    assert shown.count("Transfer Type            Isochronous") == 2


FIND = """
import usb.core
for product in (0x02AE, 0x02AD, 0x02B0):
    for device in usb.core.find(find_all=True, idVendor=0x045E, idProduct=product):
        serial = device.serial_number if device.iSerialNumber else None
        print(f"{product:04x} {device.bcdDevice:04x} {device.product} {serial}")
"""


@pytest.mark.parametrize(
    ("options", "seen"),
    [
        ([], ["02ae 010b Xbox NUI Camera V0000000000100AA", "02ad 0100 Xbox NUI Audio V0000000000100AA", "02b0 0105 Xbox NUI Motor None"]),
        (
            ["--model", "1473", "--without", "motor"],
            ["02ae 0110 Xbox NUI Camera 0000000000000000", "02ad 0100 Xbox NUI Audio V0000000000100AA"],
        ),
        (["--count", "2", "--without", "motor,audio"], [f"02ae 010b Xbox NUI Camera V0000000000100{x}A" for x in "AB"]),
        (["--without", "camera,audio"], ["02b0 0105 Xbox NUI Motor None"]),
        (["--empty"], []),
        (["--no-bus"], []),
    ],
)  # fmt: skip
def test_the_systems_libusb_sees_what_is_attached(virtual_kinect: VirtualKinect, options: list[str], seen: list[str]) -> None:
    assert sorted(python(virtual_kinect(*options), FIND).splitlines()) == sorted(seen)


MOTOR = """
import time, usb.core
motor = usb.core.find(idVendor=0x045E, idProduct=0x02B0)
motor.ctrl_transfer(0x40, 0x06, 1, 0)
motor.ctrl_transfer(0x40, 0x31, 20, 0)
sense = lambda: bytes(motor.ctrl_transfer(0xC0, 0x32, 0, 0, 10))
moving = sense()
while sense()[9] == 4:
    time.sleep(0.01)
print(moving[8:].hex(), sense().hex())
try:
    motor.ctrl_transfer(0x40, 0x77, 0, 0)
except usb.core.USBError as error:
    print(error.errno)
"""


def test_the_motor_moves_and_refuses(virtual_kinect: VirtualKinect) -> None:
    # 819 counts at 10°: 807 up and 142 forward; EPIPE.
    assert python(virtual_kinect(), MOTOR).split() == ["8004", "000000000327008e1400", "32"]


@pytest.mark.parametrize(
    ("options", "errno"),
    [(["--busy"], 16), (["--denied"], 13), (["--unplug", "command:1"], 19), (["--reply", "stall"], 32)],
)
def test_what_is_refused_has_its_error_number(virtual_kinect: VirtualKinect, options: list[str], errno: int) -> None:
    script = """
import usb.core, usb.util
camera = usb.core.find(idVendor=0x045E, idProduct=0x02AE)
try:
    usb.util.claim_interface(camera, 0)
    camera.ctrl_transfer(0x40, 0, 0, 0, bytes.fromhex("474d0100020001001700"))
    while not camera.ctrl_transfer(0xC0, 0, 0, 0, 0x200):
        pass
except usb.core.USBError as error:
    print(error.errno)
"""
    assert python(virtual_kinect(*options), script).split() == [str(errno)]


def test_a_kinect_is_pulled_and_comes_back(virtual_kinect: VirtualKinect) -> None:
    script = """
import time, usb.core
find = lambda: usb.core.find(idVendor=0x045E, idProduct=0x02AE)
camera = find()
print(camera.address)
try:
    while True:
        camera.ctrl_transfer(0xC0, 0, 0, 0, 0x200)
except usb.core.USBError as error:
    print(error.errno)
# udev's message takes it off libusb's list, another puts the new one on it.
while find() is not None:
    time.sleep(0.01)
while find() is None:
    time.sleep(0.01)
print(find().address, find().product)
"""
    assert python(virtual_kinect("--unplug", "command:5:0.3"), script).split() == ["5", "19", "9", "Xbox", "NUI", "Camera"]


def test_a_wrong_option_says_what_there_is(virtual_kinect: VirtualKinect) -> None:
    for options, message in [
        (["--model", "7"], "no model 7: 1414, 1473, k4w"),
        (["--faults", "loose=1"], "no fault `loose`"),
        (["sim:bounced"], "there is no scene"),
        (["none.pcap"], "none.pcap: No such file"),
    ]:
        result = run(*virtual_kinect(*options), "true")
        assert result.returncode == 2
        assert message in result.stderr
