"""The world that an accelerometer makes level, and balls that disagree with it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_bus import AUDIO, CAMERA, MOTOR, reply

import physinc
from physinc import streaming
from physinc.cli import main


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Throws before a camera that looks 20° down, of which no pose is told."""
    out = tmp_path_factory.mktemp("room") / "room.npz"
    assert main(["simulate", "bounce?tilt_deg=20&pose=false&throws=2&seed=4", str(out)]) == 0
    return out


def down(degrees: float) -> list[float]:
    angle = math.radians(degrees)
    return [0.0, 9.81 * math.cos(angle), 9.81 * math.sin(angle)]


def told(room: Path, degrees: float) -> tuple[physinc.StreamStarted, list[physinc.LevelDisagreement]]:
    events = list(physinc.stream(room, config={"camera": {"gravity_in_camera": down(degrees)}}))
    assert isinstance(events[0], physinc.StreamStarted)
    return events[0], [event for event in events if isinstance(event, physinc.LevelDisagreement)]


def test_a_level_that_is_right_makes_the_world_upright_and_is_not_told(room: Path) -> None:
    started, disagreements = told(room, 20.0)
    rotation = np.array(started.world_from_camera)[:3, :3]
    np.testing.assert_allclose(rotation @ down(20.0), [0, 0, -9.81], atol=1e-9)
    # y is forward, x to the right.
    np.testing.assert_allclose(rotation @ [0, 0, 1], [0, math.cos(math.radians(20)), -math.sin(math.radians(20))], atol=1e-9)
    assert not disagreements


@pytest.mark.parametrize("degrees", [17.0, 23.0])
def test_a_level_that_is_3_degrees_off_is_told(room: Path, degrees: float, capsys: pytest.CaptureFixture[str]) -> None:
    _, disagreements = told(room, degrees)
    (event,) = disagreements
    assert math.degrees(event.angle) == pytest.approx(3.0, abs=0.5)
    assert event.p_value < 1e-3
    assert event.final
    assert event.track is None
    np.testing.assert_allclose(event.gravity_by_accelerometer, down(degrees))
    np.testing.assert_allclose(event.gravity_in_camera, down(20.0), atol=0.1)
    assert set(event.to_dict()) == {
        *("event", "timestamp_ns", "track", "final", "flights"),
        *("gravity_in_camera", "gravity_by_accelerometer", "angle", "sd", "p_value"),
    }
    config = room.with_suffix(".toml")
    config.write_text(f"[camera]\ngravity_in_camera = {down(degrees)}\n")
    assert main(["run", str(room), "--config", str(config)]) == 0
    assert f"the accelerometer is {math.degrees(event.angle):.1f} ± " in capsys.readouterr().out


def test_a_recording_keeps_what_the_accelerometer_said(room: Path, tmp_path: Path) -> None:
    camera = tmp_path / "camera.toml"
    camera.write_text(room.with_suffix(".camera.toml").read_text() + f"gravity_in_camera = {down(23.0)}\n")
    (tmp_path / "room.npz").write_bytes(room.read_bytes())
    out = tmp_path / "out.npz"
    assert main(["record", str(tmp_path / "room.npz"), str(out)]) == 0
    first, second = (list(physinc.stream(source))[1:] for source in (tmp_path / "room.npz", out))
    assert first == second
    assert any(isinstance(event, physinc.LevelDisagreement) for event in second)


def test_a_live_kinects_accelerometer_is_asked(attach: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    bus = attach(CAMERA, MOTOR, AUDIO)
    bus.standing = reply((0, 770, -280))
    bus.replies = [reply((0, 0, 0), -128, 4)] * 5
    opened: dict[str, Any] = {}
    monkeypatch.setattr(streaming, "open_source", lambda _, **options: opened.update(options))
    physinc.stream("kinect:A001", level="accelerometer")
    np.testing.assert_allclose(opened["gravity"], np.array([0, 770, 280]) * 9.80665 / 819)
    # The head was still moving, then 25 readings.
    assert len([request for request in bus.requests if request[1] == 0x32]) == 1 + 5 + 25
    physinc.stream(level="accelerometer")
    assert opened["gravity"] is not None
    physinc.stream("kinect")
    assert opened["gravity"] is None


def test_a_kinect_that_is_being_shaken_has_no_level(attach: Any) -> None:
    attach(CAMERA, MOTOR).standing = reply((0, 300, 0))
    with pytest.raises(physinc.DeviceReplyError, match=r"3\.6 m/s²: let the Kinect stand still"):
        physinc.stream(level="accelerometer")


@pytest.mark.parametrize("source", ["demo", "kinect.npz", [(0, np.zeros((480, 640), np.uint16))]])
def test_what_has_no_accelerometer_says_so(source: Any) -> None:
    with pytest.raises(physinc.ConfigError, match="only a live Kinect has"):
        physinc.stream(source, level="accelerometer")
    with pytest.raises(physinc.ConfigError, match="expected 'accelerometer'"):
        physinc.stream(source, level="spirit")  # type: ignore[arg-type]
