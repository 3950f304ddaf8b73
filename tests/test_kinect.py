"""A live Kinect that isn't there: the driver, from `physinc run kinect` down to real libusb."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from virtual_kinect import VirtualKinect, truth

PHYSINC = [sys.executable, "-c", "import sys; from physinc.cli import main; sys.exit(main(sys.argv[1:]))"]


def run(*command: str, timeout: float = 120) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)


def events(result: subprocess.CompletedProcess[str]) -> list[dict[str, Any]]:
    return [json.loads(line) for line in result.stdout.splitlines()]


def of(told: list[dict[str, Any]], *names: str) -> list[dict[str, Any]]:
    return [event for event in told if event["event"] in names]


def without_source(told: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{**event, "source": None} if "source" in event else event for event in told]


SCENE = "sim:bounce?throws=2"


DEVICES = ["", "--model 1473", "--model k4w", "--driver gspca_kinect", "--without motor,audio"]


@pytest.mark.parametrize("device", DEVICES)
def test_every_model_tells_what_its_scene_tells(virtual_kinect: VirtualKinect, tmp_path: Path, device: str) -> None:
    capture, camera = tmp_path / "scene.pcapng", tmp_path / "scene.camera.toml"
    assert run(*PHYSINC, "simulate", SCENE.removeprefix("sim:"), str(capture)).returncode == 0
    options = ["--camera", str(camera), "--json", "--positions", "--frames", "120"]
    live = run(*virtual_kinect(SCENE, *device.split()), *PHYSINC, "run", "kinect", "--every-frame", *options)
    assert (live.returncode, live.stderr) == (0, "")
    assert without_source(events(live)) == without_source(events(run(*PHYSINC, "run", str(capture), *options)))


def test_a_recording_is_what_was_sent_and_tells_the_same(virtual_kinect: VirtualKinect, tmp_path: Path) -> None:
    capture, sent, arrays = tmp_path / "live.pcapng.zst", tmp_path / "sent", tmp_path / "frames.npz"
    recorded = run(*virtual_kinect(SCENE, "--truth", str(sent)), *PHYSINC, "record", "kinect", str(capture), "--frames", "120")
    assert recorded.returncode == 0, recorded.stderr
    assert run(*PHYSINC, "record", str(capture), str(arrays)).returncode == 0
    frames = np.load(arrays)["disparity"]
    assert [zlib.crc32(frame.tobytes()) for frame in frames] == [frame["crc32"] for frame in truth(sent)[: len(frames)]]
    assert len(frames) == 120
    replayed = events(run(*PHYSINC, "run", str(capture), "--json", "--positions"))
    live = run(*virtual_kinect(SCENE), *PHYSINC, "run", "kinect", "--json", "--positions", "--frames", "120", "--every-frame")
    ignored = "stream_started", "stream_ended"
    assert [e for e in replayed if e["event"] not in ignored] == [e for e in events(live) if e["event"] not in ignored]


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Any]:
    """The first frames that a virtual Kinect sends, by their stamps."""
    path = tmp_path_factory.mktemp("sent") / "sent.npz"
    assert run(*PHYSINC, "record", f"{SCENE}&packets=1", str(path), "--frames", "80").returncode == 0
    arrays = np.load(path)
    return dict(zip(arrays["timestamps_ns"].tolist(), arrays["disparity"], strict=True))


@pytest.mark.parametrize("kind", ["lose", "zero", "short", "error", "double", "foreign"])
def test_faults_are_counted_and_no_frame_is_torn(virtual_kinect: VirtualKinect, tmp_path: Path, sent: dict[int, Any], kind: str) -> None:
    virtual = virtual_kinect(SCENE, "--faults", f"{kind}=0.01&seed=1")
    recorded = tmp_path / "faulty.npz"
    assert run(*virtual, *PHYSINC, "record", "kinect", str(recorded), "--frames", "60").returncode == 0
    arrays = np.load(recorded)
    for stamp, frame in zip(arrays["timestamps_ns"].tolist(), arrays["disparity"], strict=True):
        # Where a last packet is lost, the stamp is the one's before.
        original = sent[min(sent, key=lambda other: abs(other - stamp))]
        assert np.all((frame == original) | (frame == 2047))
    live = run(*virtual, *PHYSINC, "run", "kinect", "--json", "--frames", "60", "--every-frame")
    assert live.returncode == 0, live.stderr
    counters = events(live)[-1]["counters"]
    assert counters["frames"] == 60
    if kind in ("lose", "zero", "short", "error"):
        assert 60 * 242 * 0.005 < counters["packets_lost"] < 60 * 242 * 0.02
        assert counters["frames_incomplete"] > 30
    else:
        assert counters["packets_lost"] == counters["frames_incomplete"] == 0
    assert (counters["packets_invalid"] > 0) == (kind in ("short", "double", "foreign"))
    assert ("packets that USB lost" in live.stderr) == (kind == "error")


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--empty"], 3, "no Kinect is attached: is its power supply plugged in?"),
        (["--no-bus"], 3, "there is no USB here"),
        (["--busy"], 1, "/dev/bus/usb/001/005 is in use by "),
        (["--refuse", "ENOSPC"], 1, "no room for it"),
        (["--refuse", "ENOMEM"], 1, "usbfs_memory_mb"),
        (["--reply", "never"], 1, "command 0x16 (0x41): no reply to 500 polls"),
        (["--reply", "tag:3"], 1, "reply with another tag"),
        (["--reply", "command"], 1, "reply to another command, 0x17"),
        (["--reply", "magic"], 1, "control message begins with 0x4d47"),
        (["--reply", "short"], 1, "claims 8 bytes of payload and has 6"),
        (["--reply", "cut:1"], 1, "a reply of "),
        (["--reply", "status:6"], 1, "refused, status 0x"),
        (["--reply", "stall"], 1, "LIBUSB_ERROR_PIPE"),
        (["--unplug", "command:3"], 4, "the connection broke (LIBUSB_ERROR_NO_DEVICE)"),
    ],
)
def test_what_keeps_it_from_opening_says_so(virtual_kinect: VirtualKinect, options: list[str], code: int, said: str) -> None:
    result = run(*virtual_kinect(*options), *PHYSINC, "run")
    assert (result.returncode, result.stdout) == (code, "")
    assert said in result.stderr
    assert result.stderr.count("\n") == 1, "one line"


def test_late_replies_are_awaited(virtual_kinect: VirtualKinect) -> None:
    assert run(*virtual_kinect("--reply", "late"), *PHYSINC, "run", "--frames", "3").returncode == 0


TWO = """
import sys, physinc
streams = [physinc.stream(f"kinect:{name}") for name in sys.argv[1:]]
for stream in streams:
    started = next(stream)
    print(started.source, type(started).__name__)
try:
    physinc.stream("kinect:" + sys.argv[1])
except physinc.DeviceBusyError as error:
    print("busy")
for stream in streams:
    stream.close()
# What was closed can be opened again.
with physinc.stream("kinect:1") as stream:
    next(stream)
try:
    physinc.stream("kinect:2")
except physinc.DeviceNotFoundError as error:
    print(error)
"""


@pytest.mark.parametrize("names", [["V0000000000100AA", "V0000000000100BA"], ["1-1.3", "1-2.3"], ["0", "1"]])
@pytest.mark.parametrize("model", ["1414", "1473"])
def test_two_at_once(virtual_kinect: VirtualKinect, names: list[str], model: str) -> None:
    result = run(*virtual_kinect("--count", "2", "--model", model), sys.executable, "-c", TWO, *names)
    assert result.returncode == 0, result.stderr
    started = [f"kinect:{name} StreamStarted" for name in names]
    missing = "kinect:2: no such Kinect is attached, of those that are name one: V0000000000100AA, V0000000000100BA; "
    *told, error = result.stdout.splitlines()
    assert told == [*started, "busy"]
    assert error.startswith(missing)


def test_a_killed_session_harms_no_next_one(virtual_kinect: VirtualKinect) -> None:
    script = """
import os, signal, subprocess, sys
physinc = [sys.executable, "-c", "from physinc.cli import main; import sys; sys.exit(main(sys.argv[1:]))"]
physinc += ["run", "kinect", "--json", "--every-frame"]
for _ in range(3):
    first = subprocess.Popen(physinc, stdout=subprocess.PIPE)
    first.stdout.readline()
    first.kill()
    first.wait()
sys.exit(subprocess.run([*physinc, "--frames", "30"]).returncode)
"""
    result = run(*virtual_kinect(), sys.executable, "-c", script)
    assert result.returncode == 0, result.stderr
    counters = events(result)[-1]["counters"]
    assert (counters["frames"], counters["packets_lost"], counters["packets_invalid"]) == (30, 0, 0)


DRIVER = """
import sys, physinc, usb.core
camera = usb.core.find(idVendor=0x045E, idProduct=0x02AE)
print(camera.is_kernel_driver_active(0))
with physinc.stream() as stream:
    next(stream)
    print(usb.core.find(idVendor=0x045E, idProduct=0x02AE).is_kernel_driver_active(0))
print(usb.core.find(idVendor=0x045E, idProduct=0x02AE).is_kernel_driver_active(0))
"""


def test_the_kernels_driver_gets_it_back(virtual_kinect: VirtualKinect) -> None:
    result = run(*virtual_kinect("--driver", "gspca_kinect"), sys.executable, "-c", DRIVER)
    assert result.stdout.split() == ["True", "False", "True"], result.stderr


def test_unplugged_it_ends_as_disconnected(virtual_kinect: VirtualKinect) -> None:
    result = run(*virtual_kinect("--unplug", "frame:50"), *PHYSINC, "run", "--json")
    assert result.returncode == 4
    *_, gone, ended = of(events(result), "disconnected", "stream_ended")
    assert (gone["reason"], ended["reason"]) == ("unplugged", "disconnected")
    assert 45 <= ended["counters"]["frames"] <= 50
    assert "LIBUSB_ERROR_NO_DEVICE" in result.stderr


def test_plugged_in_again_it_goes_on(virtual_kinect: VirtualKinect) -> None:
    virtual = virtual_kinect("--unplug", "frame:50:0.5:2")
    result = run(*virtual, *PHYSINC, "run", "--json", "--positions", "--frames", "200", "--reconnect", "20")
    assert result.returncode == 0, result.stderr
    told = events(result)
    stamps = [event["timestamp_ns"] for event in told]
    assert stamps == sorted(stamps)
    happened = of(told, "disconnected", "reconnected", "gap")
    assert [event["event"] for event in happened] == ["disconnected", "reconnected", "gap"] * 2
    for gap in of(happened, "gap"):
        seconds = (gap["end_ns"] - gap["start_ns"]) * 1e-9
        assert gap["reason"] == "disconnected"
        assert seconds > 0.5
        assert gap["frames"] == round(seconds * 30) - 1
    assert told[-1]["counters"]["frames"] == 200


def test_too_long_away_it_is_given_up(virtual_kinect: VirtualKinect) -> None:
    result = run(*virtual_kinect("--unplug", "frame:50:60:1"), *PHYSINC, "run", "--json", "--reconnect", "0.3")
    assert result.returncode == 4
    assert events(result)[-1]["reason"] == "disconnected"


RECONNECT = """
import physinc
with physinc.stream(reconnect=True, timeout=0.2) as stream:
    for event in stream:
        if event.event in ("disconnected", "reconnected"):
            print(event.event, event.reason)
        if event.event == "gap":
            break
try:
    for event in physinc.stream():
        pass
except physinc.DeviceDisconnectedError as error:
    print(type(error).__mro__[2].__name__)
"""


def test_in_python(virtual_kinect: VirtualKinect) -> None:
    result = run(*virtual_kinect("--unplug", "frame:50:1:2"), sys.executable, "-c", RECONNECT)
    assert result.stdout.splitlines() == ["disconnected unplugged", "reconnected same_serial", "ConnectionError"], result.stderr


VIDEO = """
import sys, physinc
for kind in ("color", "infrared"):
    with physinc.stream(f"kinect?video={kind}", frames=True) as stream:
        for event in stream:
            if stream.video is not None and stream.frame is not None:
                break
        video = stream.video
        print(video.kind, video.pixels.dtype, video.pixels.shape, video.missing, stream.frame.depth_mm.shape)
        assert video.pixels.std() > 1
"""


def test_video_comes_beside_depth(virtual_kinect: VirtualKinect) -> None:
    result = run(*virtual_kinect(), sys.executable, "-c", VIDEO)
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines() == ["color uint8 (480, 640) [] (480, 640)", "infrared uint16 (488, 640) [] (480, 640)"]


def test_ctrl_c_ends_it_in_order(virtual_kinect: VirtualKinect) -> None:
    command = [*virtual_kinect("--realtime"), *PHYSINC, "run", "--json", "--positions"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        *_, last = process.stdout
        assert process.wait(timeout=20) == 130
    assert json.loads(last)["reason"] == "interrupted"


@pytest.mark.parametrize("name", ["kinect?packets=200", "kinect?lose=0.1", "kinect:0?video=x"])
def test_impossible_names_say_what_is_possible(name: str) -> None:
    result = run(*PHYSINC, "run", name)
    assert result.returncode == 2
    assert "expected" in result.stderr or "there are" in result.stderr
