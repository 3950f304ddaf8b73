"""The motor, on a bus that answers as a Kinect does."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import usb.core
from fake_bus import AUDIO, CAMERA, MOTOR, reply

import physinc
from physinc import motor as motors
from physinc.attached import System
from physinc.cli import main


def test_the_accelerometer_tells_where_gravity_pulls_in_the_camera_frame(attach: Any) -> None:
    bus = attach(CAMERA, MOTOR, AUDIO)
    with physinc.Motor() as motor:
        np.testing.assert_allclose(motor.accelerometer(), [0, 9.80665, 0])
        # The head looks 30° down: gravity pulls forward, the accelerometer feels the opposite.
        bus.standing = reply((0, 709, -410))
        np.testing.assert_allclose(motor.accelerometer(2), [0, 9.80665 * np.cos(np.pi / 6), 9.80665 / 2], atol=0.01)
        # Leaned on its right side: gravity pulls to the right.
        bus.standing = reply((819, 0, 0))
        np.testing.assert_allclose(motor.accelerometer(), [9.80665, 0, 0])
        with pytest.raises(physinc.ConfigError, match="readings = 0"):
            motor.accelerometer(0)


def test_a_tilt_waits_until_the_head_stands(attach: Any) -> None:
    bus = attach(CAMERA, MOTOR)
    with physinc.Motor() as motor:
        assert motor.tilt(-10.2) == -10.0
        assert [value for _, request, value in bus.requests if request == 0x31] == [0x10000 - 20]
        assert not bus.replies
        bus.replies = [reply((0, 819, 0), -128, 4)]
        assert motor.tilt_degrees is None
        bus.standing = reply((0, 819, 0), 40, 1)
        assert motor.tilt_status == "at_limit"


def test_a_head_that_never_stands_is_not_waited_for_for_ever(attach: Any) -> None:
    bus = attach(MOTOR)
    motor = physinc.Motor()
    bus.replies = [reply((0, 819, 0), -128, 4)] * 1_000_000
    with pytest.raises(physinc.DeviceTimeoutError, match=r"still moving 0.05 s after a tilt to 5°"):
        motor.tilt(5, timeout=0.05)


def test_tilts_are_as_far_apart_as_the_motor_likes(attach: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    attach(MOTOR)
    monkeypatch.setattr(motors, "BETWEEN_TILTS", 5.0)
    slept: list[float] = []
    monkeypatch.setattr(motors, "time", SimpleNamespace(sleep=slept.append, monotonic=lambda: sum(slept)))
    motor = physinc.Motor()
    motor.tilt(1)
    first = sum(slept)
    motor.tilt(2)
    assert first < 5.0
    assert max(slept) == pytest.approx(5.0 - first)


@pytest.mark.parametrize("degrees", [27.5, -28, float("nan")])
def test_no_tilt_beyond_the_limits(attach: Any, degrees: float) -> None:
    bus = attach(MOTOR)
    with pytest.raises(physinc.ConfigError, match="−27 to 27"):
        physinc.Motor().tilt(degrees)
    assert all(request == 0x32 for _, request, _ in bus.requests)


def test_the_led_has_six_ways_to_shine(attach: Any) -> None:
    bus = attach(MOTOR)
    with physinc.Motor() as motor:
        for color in motors.LEDS:
            motor.led(color)
        assert bus.requests[1:] == [(0x40, 6, value) for value in (0, 1, 2, 3, 4, 6)]
        with pytest.raises(physinc.ConfigError, match="pink"):
            motor.led("pink")  # type: ignore[arg-type]


def test_kinects_are_chosen_by_index_and_serial_number(attach: Any) -> None:
    second = [(product, release, (1, *ports), serial and "B002") for product, release, ports, serial in (CAMERA, MOTOR, AUDIO)]
    lone = (0x2B0, 0x105, (1, 1), None)
    bus = attach(CAMERA, AUDIO, MOTOR, *second, lone)
    # By bus and port; one without a camera comes last.
    expected: dict[Any, int] = {None: 4, 0: 4, "1": 2, 2: 6, "A001": 2, "B002": 4, "1-2.3": 2, "1-1.2.3": 4}
    for serial, index in expected.items():
        with physinc.Motor(serial) as motor:
            assert motor._device._ctx.dev is bus.devices[index], serial
    for serial in (3, -1, "C003", "1-2.4", "ä"):
        with pytest.raises(physinc.DeviceNotFoundError, match="there are 3"):
            physinc.Motor(serial)


@pytest.mark.parametrize(
    ("devices", "message"),
    [
        ([], "no Kinect found"),
        ([CAMERA, AUDIO], "its motor isn't"),
        (
            [(0x2AE, 0x114, (2, 3), "0000000000000000"), MOTOR, AUDIO],
            "Kinect 1473 is out of reach: LED, tilt and accelerometer .* depth, events",
        ),
        ([(0x2BF, 0x200, (2, 3), "0000000000000000")], "Kinect K4W is out of reach: LED"),
    ],
)
def test_no_motor_says_what_works(attach: Any, devices: list[Any], message: str) -> None:
    attach(*devices)
    with pytest.raises(physinc.DeviceNotFoundError, match=message):
        physinc.Motor()


@pytest.mark.parametrize(
    ("number", "error", "message"),
    [
        (13, physinc.DevicePermissionError, "udev"),
        (16, physinc.DeviceBusyError, "physinc devices"),
        (19, physinc.DeviceDisconnectedError, "plug it in"),
        (32, physinc.DeviceReplyError, "refuses: refused"),
    ],
)
def test_what_the_bus_refuses_says_what_mends_it(attach: Any, number: int, error: type[Exception], message: str) -> None:
    attach(MOTOR).refuses = number
    with pytest.raises(error, match=message):
        physinc.Motor()


def test_a_motor_that_answers_wrongly_is_an_error(attach: Any) -> None:
    bus = attach(MOTOR)
    motor = physinc.Motor()
    bus.standing = b"\0" * 9
    with pytest.raises(physinc.DeviceReplyError, match="9 bytes instead of 10"):
        motor.accelerometer()
    bus.standing = reply((0, 819, 0), 0, 9)
    with pytest.raises(physinc.DeviceReplyError, match="status 9"):
        _ = motor.tilt_status
    bus.refuses = 110
    with pytest.raises(physinc.DeviceTimeoutError, match="doesn't answer"):
        motor.led("green")


@pytest.mark.parametrize(("library", "message"), [(None, "apt install libusb-1.0-0"), ("libusb-1.0.so.0", "no USB bus")])
def test_no_libusb_says_what_to_install(monkeypatch: pytest.MonkeyPatch, library: str | None, message: str) -> None:
    def find(**_: Any) -> Any:
        raise usb.core.NoBackendError("No backend available")

    monkeypatch.setattr(usb.core, "find", find)
    monkeypatch.setattr("ctypes.util.find_library", lambda _: library)
    with pytest.raises(physinc.DeviceNotFoundError, match=message):
        physinc.Motor()


def test_the_command_line_tilts_and_shines(attach: Any, capsys: pytest.CaptureFixture[str]) -> None:
    bus = attach(CAMERA, MOTOR)
    assert main(["tilt", "-10"]) == 0
    assert "tilt -10.0° above the horizon, stopped; gravity in the camera" in capsys.readouterr().out
    assert main(["led", "blink_green", "--kinect", "A001"]) == 0
    assert main(["tilt"]) == 0
    assert "+0.00 +9.81 +0.00 m/s²" in capsys.readouterr().out
    assert [request for request in bus.requests if request[0] == 0x40] == [(0x40, 0x31, 0xFFEC), (0x40, 6, 4)]
    assert main(["tilt", "40"]) == 2
    assert main(["led", "pink"]) == 2
    attach()
    assert main(["tilt", "1"]) == 3
    assert "physinc doctor" in capsys.readouterr().err


def test_a_serial_number_may_be_of_any_bytes(attach: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bus = attach(CAMERA, MOTOR)
    file = tmp_path / "sys/bus/usb/devices/1-2.3/serial"
    file.parent.mkdir(parents=True)
    monkeypatch.setattr(motors, "System", lambda: System(tmp_path))
    for told, serial in ((b"\xc3\xa4\n", "ä"), (b"\xff7\n", "\ufffd7")):
        file.write_bytes(told)
        with physinc.Motor(serial) as motor:
            assert motor._device._ctx.dev is bus.devices[1]
