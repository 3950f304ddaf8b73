"""Motor, devices, doctor, level and recorder, at a virtual Kinect, as libusb and the kernel's files show it."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from virtual_kinect import VirtualKinect

import physinc

PHYSINC = [sys.executable, "-c", "import sys; from physinc.cli import main; sys.exit(main())"]


def run(virtual: list[str], *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*virtual, *PHYSINC, *map(str, arguments)], capture_output=True, text=True, timeout=100, check=False)


def test_a_head_tilts_and_its_accelerometer_with_it(virtual_kinect: VirtualKinect) -> None:
    done = run(virtual_kinect(), "tilt", "-10")
    assert "tilt -10.0° above the horizon, stopped; " in done.stdout, done.stderr
    # It looks down: gravity pulls forward.
    assert "+0.00 +9.66 +1.70 m/s²" in done.stdout
    assert run(virtual_kinect(), "led", "red").returncode == 0


MISSING = [
    ([], 0, "", 0, ""),
    (["--without", "camera"], 0, "", 3, "12 V supply"),
    (["--without", "motor"], 3, "its motor isn't", 0, "no motor"),
    (["--model", "1473"], 3, "1473 is out of reach", 0, "firmware"),
    (["--model", "k4w"], 3, "K4W is out of reach", 0, "firmware"),
    (["--empty"], 3, "no Kinect found", 3, "no Kinect on the bus"),
    (["--no-bus"], 3, "physinc doctor", 3, "this machine has no USB"),
    (["--driver", "gspca_kinect"], 0, "", 0, "modprobe -r gspca_kinect"),
]


@pytest.mark.parametrize("missing", MISSING, ids=lambda missing: " ".join(missing[0]) or "nothing")
def test_what_is_missing_is_said(virtual_kinect: VirtualKinect, missing: tuple[list[str], int, str, int, str]) -> None:
    options, code, message, doctors_code, ailment = missing
    virtual = virtual_kinect(*options)
    tilt, doctor = run(virtual, "tilt", "3"), run(virtual, "doctor")
    assert (tilt.returncode, message in tilt.stderr) == (code, True), tilt.stderr
    assert (doctor.returncode, ailment in doctor.stdout) == (doctors_code, True), doctor.stdout


def test_two_kinects_are_listed_and_told_apart(virtual_kinect: VirtualKinect) -> None:
    virtual = virtual_kinect("--count", "2")
    kinects = json.loads(run(virtual, "devices", "--json").stdout)
    assert [kinect["index"] for kinect in kinects] == [0, 1]
    assert len({kinect["serial"] for kinect in kinects}) == 2
    for kinect in kinects:
        assert run(virtual, "led", "green", "--kinect", kinect["serial"]).returncode == 0
        assert run(virtual, "tilt", "--kinect", kinect["place"]).returncode == 0


def events(done: subprocess.CompletedProcess[str]) -> list[dict[str, Any]]:
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.parametrize(("tilt", "told"), [(0, 0), (3, 1)])
def test_throws_tell_whether_the_accelerometer_is_right(virtual_kinect: VirtualKinect, tilt: int, told: int) -> None:
    # The virtual accelerometer says level, whatever the scene shows.
    virtual = virtual_kinect(f"sim:bounce?seed=3&tilt_deg={tilt}")
    found = events(run(virtual, "run", "kinect", "--every-frame", "--frames", "150", "--level", "accelerometer", "--json"))
    disagreements = [event for event in found if event["event"] == "level_disagreement"]
    assert len(disagreements) == told
    assert all(0.04 < event["angle"] < 0.065 for event in disagreements)


@pytest.mark.parametrize("out", ["out.pcapng.zst", "out.npz", "out"])
def test_a_live_recording_tells_what_was_told_live(virtual_kinect: VirtualKinect, tmp_path: Path, out: str) -> None:
    made = tmp_path / out
    arguments = ["run", "kinect", "--every-frame", "--frames", "90", "--level", "accelerometer", "--json"]
    live = events(run(virtual_kinect("sim:bounce?seed=3"), *arguments, "--record", made))
    names = [event["event"] for event in live]
    assert "contact" in names
    again = [event.to_dict() for event in physinc.stream(made)]
    assert [event["event"] for event in again] == names
    assert again[0]["world_from_camera"] == live[0]["world_from_camera"]
    if out != "out":
        # The same to the last bit; fakenect's stamps begin anew.
        assert [event for event in again if event["event"] in {"contact", "surface"}] == [
            event for event in live if event["event"] in {"contact", "surface"}
        ]


@pytest.mark.parametrize("out", ["out.pcapng", "out.pcapng.gz", "out.pcapng.zst", "out.npz", "out"])
def test_a_live_recording_that_is_killed_can_be_read(virtual_kinect: VirtualKinect, tmp_path: Path, out: str) -> None:
    made = tmp_path / out
    virtual = virtual_kinect("--realtime", "sim:bounce?seed=3")
    with subprocess.Popen([*virtual, *PHYSINC, "record", "kinect", str(made)], stderr=subprocess.DEVNULL) as recorder:
        deadline = time.monotonic() + 60
        while not made.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        # So long at least, of which the last second may be missing.
        time.sleep(3.0)
        recorder.kill()
    stream = physinc.stream(made)
    with contextlib.suppress(physinc.RecordingError):
        list(stream)
    assert stream.stats.frames >= 30
