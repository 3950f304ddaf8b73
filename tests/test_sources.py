"""Sources: what they deliver, and one clear error for everything that isn't what it should be."""

from __future__ import annotations

import contextlib
import io
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import frames
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import physinc


def refusal(source: Any, **options: Any) -> str:
    """The one line by which `source` is refused."""
    with pytest.raises(physinc.RecordingError) as raised:
        list(physinc.stream(source, **options))
    message = str(raised.value)
    assert "\n" not in message
    return message


def write(path: Path, **arrays: Any) -> Path:
    np.savez(path, **arrays)
    return path


def test_npz_deflated_and_stored_disparity_and_big_endian_are_read(tmp_path: Path, npz: Path) -> None:
    arrays = frames()
    stored = write(tmp_path / "stored.npz", **arrays)
    swapped = write(
        tmp_path / "swapped.npz", timestamps_ns=arrays["timestamps_ns"].astype(">i8"), depth_mm=arrays["depth_mm"].astype(">u2")
    )
    disparity = write(tmp_path / "disparity.npz", timestamps_ns=arrays["timestamps_ns"], disparity=arrays["depth_mm"] // 3)
    streams = [physinc.stream(path) for path in (npz, stored, swapped, disparity)]
    ends = [list(stream)[-1] for stream in streams]
    for end in ends:
        assert isinstance(end, physinc.StreamEnded)
        assert (end.counters.frames, end.timestamp_ns, end.reason) == (5, 4 * 33_333_333, "end_of_source")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"timestamps_ns": None}, "no `timestamps_ns`"),
        ({"depth_mm": None}, r"neither `depth_mm` nor `disparity` among its arrays \(timestamps_ns\)"),
        ({"disparity": np.zeros((5, 480, 640), np.uint16)}, "both `depth_mm` and `disparity`"),
        ({"depth_mm": np.zeros((5, 480, 640), np.float32)}, "`depth_mm` is of type .*: uint16"),
        ({"timestamps_ns": np.zeros(5)}, "`timestamps_ns` is of type .*: int64"),
        ({"timestamps_ns": np.zeros(4, np.int64)}, "4 timestamps_ns for 5 frames"),
        ({"timestamps_ns": np.zeros((5, 1), np.int64)}, r"\[N\] and \[N, height, width\]"),
        ({"depth_mm": np.zeros((480, 640), np.uint16)}, r"\[N\] and \[N, height, width\]"),
        ({"depth_mm": np.zeros((5, 240, 320), np.uint16)}, "320×240 px, the camera is 640×480"),
        ({"depth_mm": np.asfortranarray(np.zeros((5, 480, 640), np.uint16))}, "Fortran order"),
        ({"depth_mm": np.array([{}], object)}, "pickled"),
        ({"timestamps_ns": np.array([None] * 5, object)}, "pickled"),
        ({"depth_mm": np.zeros(5, [("z", "u2")])}, "of type"),
    ],
)
def test_npz_that_is_not_what_it_should_be(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    arrays = {key: array for key, array in (frames() | change).items() if array is not None}
    path = write(tmp_path / "bad.npz", **arrays)
    text = refusal(path)
    assert text.startswith(f"{path}: ")
    with pytest.raises(physinc.RecordingError, match=message):
        physinc.stream(path)


def test_npz_of_another_size_never_gets_the_kinects_intrinsics(tmp_path: Path) -> None:
    path = write(tmp_path / "small.npz", timestamps_ns=np.arange(2), depth_mm=np.zeros((2, 240, 320), np.uint16))
    camera = tmp_path / "small.camera.toml"
    camera.write_text("width = 320\nheight = 240\nfx = 288.0\nfy = 288.0\ncx = 160.0\n")
    with pytest.raises(physinc.ConfigError, match=r"camera\.cy: expected"):
        physinc.stream(path)
    camera.write_text(camera.read_text() + "cy = 120.0\n")
    assert isinstance(list(physinc.stream(path))[-1], physinc.StreamEnded)


def test_a_header_that_claims_too_much_costs_no_memory(tmp_path: Path) -> None:
    header = "{'descr': '<u2', 'fortran_order': False, 'shape': (%s), }"
    for shape in ("1000000000, 480, 640", "18446744073709551615, 480, 640", f"{2**60}, 480, 640"):
        text = (header % shape).encode().ljust(118) + b"\n"
        npy = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text
        assert "claims the shape" in refusal(archive(tmp_path, npy))
    endless = b"\x93NUMPY\x03\x00" + (2**32 - 1).to_bytes(4, "little") + b"{" * 64
    assert "absurdly long" in refusal(archive(tmp_path, endless))
    assert "no numpy array" in refusal(archive(tmp_path, b"\x93NUM"))


def archive(folder: Path, depth: bytes, compression: int = zipfile.ZIP_DEFLATED) -> Path:
    path = folder / "crafted.npz"
    stamps = io.BytesIO()
    np.save(stamps, frames()["timestamps_ns"])
    with zipfile.ZipFile(path, "w", compression) as file:
        file.writestr("timestamps_ns.npy", stamps.getvalue())
        file.writestr("depth_mm.npy", depth)
    return path


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_packings_are_named(tmp_path: Path, compression: int) -> None:
    depth = io.BytesIO()
    np.save(depth, frames()["depth_mm"])
    assert "np.savez" in refusal(archive(tmp_path, depth.getvalue(), compression))


def test_a_cut_or_changed_file_is_never_read_as_if_it_were_whole(tmp_path: Path, npz: Path) -> None:
    whole = npz.read_bytes()
    path = tmp_path / "cut.npz"
    for length in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        assert "cut" in refusal(path)
    stored = bytearray(write(tmp_path / "stored.npz", **frames()).read_bytes())
    stored[len(stored) // 2] ^= 1
    path.write_bytes(stored)
    stream = physinc.stream(path)
    with pytest.raises(physinc.RecordingError, match="checksum"):
        list(stream)
    assert list(stream) == []


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1, exclude_max=True), byte=st.integers(0, 255))
def test_a_wrong_byte_anywhere_is_an_error_or_harmless(tmp_path: Path, place: float, byte: int) -> None:
    small = {"timestamps_ns": np.arange(2), "depth_mm": np.zeros((2, 16, 16), np.uint16)}
    path = write(tmp_path / "byte.npz", **small)
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] = byte
    path.write_bytes(content)
    with contextlib.suppress(physinc.RecordingError):
        list(physinc.stream(path, camera={"width": 16, "height": 16, "fx": 16, "fy": 16, "cx": 8, "cy": 8}))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("t,x,y,z\n", "empty"),
        ("1,2,3,4\n", "no column `t`"),
        ("t,x,y\n1,2,3\n", "no column `z`"),
        ("t,x,y,z\n0,1,2,inf\n", "line 2: positions must be finite"),
        ("t,x,y,z\n0,1,2,3\n0.1,1,2\n", "line 3: 3 fields"),
        ("t,x,y,z\n0,1,2,3\n0.1,1,2,3,4\n", "line 3: 5 fields, the header has 4"),
        ("t,x,y,z,z\n0,1,2,3,4\n", "line 1: two columns are called `z`"),
        ("t,x,y,z\nnan,1,2,3\n", 'line 2: t = "nan"'),
        ("t,x,y,z\n1e30,1,2,3\n", 'line 2: t = "1e30"'),
        ("\x00\x01\x02\xff" * 100, "line 1"),
        ("x" * 100_000, "64 KiB"),
    ],
)
def test_csv_that_is_not_what_it_should_be(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text, encoding="latin-1")
    assert message in refusal(path)


def test_a_csv_that_breaks_off_tells_what_it_had(tmp_path: Path, csv: Path) -> None:
    csv.write_text(csv.read_text() + "soon,1,2,3\n")
    stream = physinc.stream(csv)
    events: list[Any] = []
    with pytest.raises(physinc.RecordingError, match="line 202"):
        events.extend(iter_into(events, stream))
    assert any(isinstance(event, physinc.Contact) for event in events)
    assert events[-1].reason == "disconnected"
    assert list(stream) == []


def iter_into(events: list[Any], stream: physinc.Stream) -> list[Any]:
    for event in stream:
        events.append(event)  # noqa: PERF402 - what came before an error is kept
    return []


def test_csv_stamps_are_exact_and_missing_positions_are_instants(tmp_path: Path) -> None:
    path = tmp_path / "ball.csv"
    path.write_text("z,y,x,t\n1,2,3,1305031102.175304001\n,,,1305031102.2\nnan,nan,nan,1305031102.3\n")
    events = list(physinc.stream(path))
    assert events[0].timestamp_ns == 1305031102175304001
    assert isinstance(events[-1], physinc.StreamEnded)
    assert events[-1].counters.frames == 3


def test_a_csv_may_have_its_rows_in_any_order(tmp_path: Path, csv: Path) -> None:
    header, *rows = csv.read_text().splitlines()
    rows = [f"{row},1" for row in rows]
    # The same ball again, a metre beside.
    others = [f"{t},{float(x) + 1},{y},{z},2" for t, x, y, z, _ in (row.split(",") for row in rows)]

    def told(name: str, lines: list[str]) -> list[physinc.Event]:
        path = tmp_path / name
        path.write_text("\n".join([f"{header},track", *lines]) + "\n")
        stream = physinc.stream(path)
        events = list(stream)[1:]
        assert stream.remarks == []
        return events

    both = [row for pair in zip(rows, others, strict=True) for row in pair]
    expected = told("sorted.csv", both)
    assert sum(isinstance(event, physinc.Contact) for event in expected) == 6
    assert told("long.csv", rows + others) == expected
    assert told("reversed.csv", both[::-1]) == told("other_first.csv", others[::-1] + rows) == told("pairs.csv", [*others, *rows])
    (tmp_path / "bad.csv").write_text("t,x,y,z\n1,1,2,3\n0,1,2,3\n2,1,2,far\n")
    assert 'line 4: "far" is no number' in refusal(tmp_path / "bad.csv")
    (tmp_path / "many.csv").write_text("t,x,y,z\n1,0,0,0\n" + "0,1,2,3\n" * 17)
    assert "line 19: more than 16 positions at one time" in refusal(tmp_path / "many.csv")


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rows=st.lists(st.lists(st.one_of(st.floats(-5, 5), st.floats()), min_size=4, max_size=4), max_size=30))
def test_any_numbers_in_a_csv_give_finite_events_or_an_error(tmp_path: Path, rows: list[list[float]]) -> None:
    path = tmp_path / "any.csv"
    path.write_text("t,x,y,z\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows))
    try:
        events = list(physinc.stream(path, positions=True, provisional=True))
    except physinc.RecordingError:
        return
    stamps = [event.timestamp_ns for event in events]
    assert stamps == sorted(stamps)
    assert all("NaN" not in event.to_json() for event in events)


@pytest.mark.parametrize("stamps", [[0, 0, 0, 0], [5, 4, 3, 2], [0, 10**18, 5, 2 * 10**18], [2**63 - 2, 2**63 - 1, -(2**63), 0]])
@pytest.mark.parametrize("filled", [0, 2000, 2047, 65535])
def test_stamps_that_stand_jump_or_wrap_and_blank_frames(tmp_path: Path, stamps: list[int], filled: int) -> None:
    depth = np.full((4, 480, 640), filled, np.uint16)
    path = write(tmp_path / "stamps.npz", timestamps_ns=np.array(stamps, np.int64), depth_mm=depth)
    events = list(physinc.stream(path, provisional=True))
    told = [event.timestamp_ns for event in events]
    assert told == sorted(told)
    end = events[-1]
    assert isinstance(end, physinc.StreamEnded)
    refused = sum(stamp <= max(stamps[:i]) for i, stamp in enumerate(stamps) if i)
    assert (end.counters.frames, end.counters.frames_dropped) == (4, refused)
    assert any(isinstance(event, physinc.Gap) for event in events) == (refused > 0)


def test_missing_foreign_and_unknown_sources_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"nowhere\.npz: no such file"):
        physinc.stream(tmp_path / "nowhere.npz")
    picture = tmp_path / "picture.npz"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n" + os.urandom(1000))
    assert "no npz archive" in refusal(picture)
    (tmp_path / "picture.png").write_bytes(b"\x89PNG")
    for source in (tmp_path, tmp_path / "picture.png"):
        assert "sources are kinect, " in refusal(source)
    for unknown in ("sim:nowhere", "sim:bounce?seed=-1", "", tmp_path):
        with pytest.raises(physinc.UnknownSourceError):
            physinc.stream(unknown)
    assert "there is no scene" in refusal("sim:nowhere")
    for device in (None, "kinect", "kinect:A00364A13567047A"):
        with pytest.raises(physinc.DeviceNotFoundError, match="physinc run demo"):
            physinc.stream(device)


def test_a_simulated_scene_is_the_recording_of_it(tmp_path: Path) -> None:
    physinc._physinc.simulate("drop", tmp_path / "drop.npz")
    simulated, recorded = (list(physinc.stream(source))[1:] for source in ("sim:drop", tmp_path / "drop.npz"))
    assert simulated == recorded
