"""Folders of images: what they deliver, what is refused, and that what is recorded is read back to the same events."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import physinc
from physinc.cli import main

SMALL = "width = 32\nheight = 16\nfx = 30\nfy = 30\ncx = 16\ncy = 8\n"
Samples = NDArray[np.uint16]


def wall(count: int, seed: int = 0) -> Samples:
    """Noise that differs from frame to frame, [count, 16, 32]."""
    return np.random.default_rng(seed).integers(600, 1000, (count, 16, 32), np.uint16)


def pgm(samples: Samples) -> bytes:
    height, width = samples.shape
    return b"P5 %d %d 65535\n" % (width, height) + samples.astype("<u2").tobytes()


def png(samples: NDArray[Any], color: int = 0) -> bytes:
    """Grey unless `color` says otherwise (2: RGB), of as many bits as the samples have."""
    height, width = samples.shape[:2]
    rows = b"".join(b"\0" + row.astype(row.dtype.newbyteorder(">")).tobytes() for row in samples)
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8 * samples.dtype.itemsize, color, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows)),
        (b"IEND", b""),
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content)) for kind, content in chunks
    )


def fakenect(folder: Path, frames: dict[str, bytes], index: list[str] | None = None) -> Path:
    """A recording of small frames: files by name, and the index that names them in order."""
    folder.mkdir(exist_ok=True)
    (folder / "camera.toml").write_text(SMALL)
    for name, content in frames.items():
        (folder / name).write_bytes(content)
    (folder / "INDEX.txt").write_text("\n".join(index if index is not None else list(frames)) + "\n")
    return folder


def tum(folder: Path, frames: dict[str, bytes], index: str | None = None) -> Path:
    """The same in TUM's layout; a frame's time is its name's."""
    folder.mkdir(exist_ok=True)
    (folder / "depth").mkdir(exist_ok=True)
    (folder / "camera.toml").write_text(SMALL)
    for name, content in frames.items():
        (folder / "depth" / f"{name}.png").write_bytes(content)
    lines = "".join(f"{name} depth/{name}.png\n" for name in frames)
    (folder / "depth.txt").write_text("# depth maps\n# timestamp filename\n\n" + lines if index is None else index)
    return folder


def refusal(source: Path) -> str:
    with pytest.raises(physinc.RecordingError) as raised:
        list(physinc.stream(source))
    message = str(raised.value)
    assert "\n" not in message
    assert message.startswith(f"{source}: ")
    return message


def read_back(source: Path, out: Path) -> tuple[NDArray[np.int64], Samples]:
    """What physinc reads of `source`, by way of an npz."""
    assert main(["record", str(source), str(out)]) == 0
    arrays = np.load(out)
    return arrays["timestamps_ns"], arrays["disparity" if "disparity" in arrays else "depth_mm"]


def test_fakenect_samples_are_little_endian_and_ticks_are_unwrapped(tmp_path: Path) -> None:
    samples = wall(4)
    ticks = [4_290_000_000, 4_292_000_000, 4_294_000_000, 4_296_000_000 - 2**32]
    names = [f"d-131481.{i:06}-{tick}.pgm" for i, tick in enumerate(ticks)]
    content = dict(zip(names, map(pgm, samples), strict=True))
    index = ["r-131481.000000-1.ppm", names[0], "a-131481.0-2.dump", "", *names[1:], "INDEX"]
    stamps, found = read_back(fakenect(tmp_path / "rec", content, index), tmp_path / "out.npz")
    np.testing.assert_array_equal(found, samples)
    assert stamps.tolist() == [71_500_000_000, 71_533_333_333, 71_566_666_667, 71_600_000_000]
    started = next(physinc.stream(tmp_path / "rec"))
    assert isinstance(started, physinc.StreamStarted)
    assert started.camera is not None
    assert (started.camera.width, started.camera.height, started.timestamp_ns) == (32, 16, 71_500_000_000)


def test_fakenect_counts_several_wraps_by_the_hosts_clock(tmp_path: Path) -> None:
    names = ["d-100.0-60.pgm", f"d-300.0-{(60 + 200 * 60_000_000) % 2**32}.pgm"]
    content = dict(zip(names, map(pgm, wall(2)), strict=True))
    stamps, _ = read_back(fakenect(tmp_path / "rec", content), tmp_path / "out.npz")
    assert stamps.tolist() == [1000, 200_000_001_000]


def test_tum_stamps_are_decimal_text_and_units_are_5000_a_metre(tmp_path: Path) -> None:
    depth = wall(2) * 10
    folder = tum(tmp_path / "rec", {"1305031102.160407": png(depth[0]), "1305031102.194330001": png(depth[1])})
    stamps, found = read_back(folder, tmp_path / "out.npz")
    assert stamps.tolist() == [1305031102160407000, 1305031102194330001]
    np.testing.assert_array_equal(found, np.floor(depth / 5 + 0.5))
    (folder / "camera.toml").write_text(SMALL + "depth_scale = 1000.0\n")
    np.testing.assert_array_equal(read_back(folder, tmp_path / "mm.npz")[1], depth)
    (folder / "camera.toml").write_text(SMALL + "disparity = true\n")
    assert read_back(folder, tmp_path / "raw.npz")[1].tolist() == depth.tolist()
    assert "disparity" in np.load(tmp_path / "raw.npz")


def test_the_cameras_file_may_make_fakenect_depth(tmp_path: Path) -> None:
    folder = fakenect(tmp_path / "rec", {"d-1.0-1.pgm": pgm(wall(1)[0])})
    (folder / "camera.toml").write_text(SMALL + "depth_scale = 1000.0\n")
    read_back(folder, tmp_path / "out.npz")
    assert "depth_mm" in np.load(tmp_path / "out.npz")
    (folder / "camera.toml").write_text(SMALL + "radius = 1\n")
    with pytest.raises(physinc.ConfigError, match="unknown field `radius`"):
        physinc.stream(folder)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "no binary PGM"),
        (pgm(wall(1)[0])[:-1], "cut"),
        (pgm(wall(1)[0]) + b"\0", "goes on"),
        (pgm(wall(1)[0][:8]), "32×8 px, the camera is 32×16"),
        (b"P5 100000 100000 65535\n", "100000×100000 px"),
        (b"P5 32 16 255\n" + bytes(512), "up to 255"),
        (png(wall(1)[0]), "no binary PGM"),
    ],
)
def test_a_fakenect_frame_that_is_not_what_it_should_be(tmp_path: Path, content: bytes, message: str) -> None:
    text = refusal(fakenect(tmp_path / "rec", {"d-1.0-0.pgm": pgm(wall(1)[0]), "d-1.1-2000000.pgm": content}))
    assert message in text
    assert "INDEX.txt, line 2: " in text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "cut"),
        (png(wall(1)[0])[:-1], "cut"),
        (png(wall(1)[0])[:400], "cut"),
        (b"\0" * 1000, "no PNG"),
        (png(wall(1)[0].astype(np.uint8)), "Grayscale of 8 bits: 16-bit grey is expected"),
        (png(np.zeros((16, 32, 3), np.uint8), color=2), "Rgb of 8 bits"),
        (png(np.zeros((16, 32, 3), np.uint16), color=2), "Rgb of 16 bits"),
        (png(wall(1)[0].T), "16×32 px, the camera is 32×16"),
    ],
)
def test_a_png_that_is_not_what_it_should_be(tmp_path: Path, content: bytes, message: str) -> None:
    text = refusal(tum(tmp_path / "rec", {"1.0": png(wall(1)[0]), "1.1": content}))
    assert message in text
    assert "depth.txt, line 5: " in text


def test_a_png_that_claims_much_costs_no_memory(tmp_path: Path) -> None:
    header = struct.pack(">IIBBBBB", 2**31 - 1, 2**31 - 1, 16, 0, 0, 0, 0)
    huge = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + header + struct.pack(">I", zlib.crc32(b"IHDR" + header))
    assert "2147483647×2147483647 px" in refusal(tum(tmp_path / "rec", {"1.0": huge}))


@pytest.mark.parametrize(
    ("index", "message"),
    [
        ("d-1.1-5.pgm\nd-1.0-0.pgm\n", "line 1: .*is missing"),
        ("../d-1.0-0.pgm\n", "leaves the folder"),
        ("/etc/d-1.0-0.pgm\n", "leaves the folder"),
        ("d-now-0.pgm\n", "tells no time"),
        ("d-1.0.pgm\n", "tells no time"),
        ("d-1.0-99999999999999999999.pgm\n", "tells no time"),
        ("d-1.0-18446744073709551615.pgm\n", "tells no time"),
        ("d-folder-0.pgm\n", "tells no time"),
        ("d-2.0-0.pgm\n", "is no file"),
        ("x" * 100_000, "more than 8 KiB"),
        ("", "empty"),
        ("r-1.0-0.ppm\n", "empty"),
        ("\udcff\udcfe\n", "not text"),
    ],
)
def test_an_index_that_is_not_what_it_should_be(tmp_path: Path, index: str, message: str) -> None:
    folder = fakenect(tmp_path / "rec", {"d-1.0-0.pgm": pgm(wall(1)[0])})
    (folder / "d-2.0-0.pgm").mkdir()
    (folder / "INDEX.txt").write_text(index, errors="surrogateescape")
    with pytest.raises(physinc.RecordingError, match=message):
        list(physinc.stream(folder))


@pytest.mark.parametrize(
    ("index", "message"),
    [
        ("1.0 depth/nowhere.png\n", "is missing"),
        ("1.0 ../secret.png\n", "leaves the folder"),
        ("1.0 /etc/passwd\n", "leaves the folder"),
        ("1.0 depth\n", "is no file"),
        ("1.0\n", "is not `timestamp filename`"),
        ("soon depth/1.0.png\n", "is not `timestamp filename`"),
        ("1e30 depth/1.0.png\n", "is not `timestamp filename`"),
        ("# nothing\n", "empty"),
        ("", "empty"),
    ],
)
def test_a_depth_txt_that_is_not_what_it_should_be(tmp_path: Path, index: str, message: str) -> None:
    assert message in refusal(tum(tmp_path / "rec", {"1.0": png(wall(1)[0])}, index))


@pytest.mark.parametrize("layout", ["fakenect", "tum"])
def test_a_missing_image_is_a_frame_lost(tmp_path: Path, layout: str) -> None:
    if layout == "fakenect":
        folder = fakenect(tmp_path / "rec", {f"d-{i}.0-{2_000_000 * i}.pgm": pgm(frame) for i, frame in enumerate(wall(12))})
        (folder / "d-8.0-16000000.pgm").unlink()
    else:
        folder = tum(tmp_path / "rec", {f"1.{i:02}": png(frame) for i, frame in enumerate(wall(12))})
        (folder / "depth" / "1.08.png").unlink()
    events = list(physinc.stream(folder))
    assert [(gap.reason, gap.frames) for gap in events if isinstance(gap, physinc.Gap)] == [("frames_lost", 1)]
    end = events[-1]
    assert isinstance(end, physinc.StreamEnded)
    assert (end.reason, end.counters.frames) == ("end_of_source", 11)


def test_a_pipe_in_a_folder_is_not_waited_for(tmp_path: Path) -> None:
    folder = fakenect(tmp_path / "rec", {}, ["d-1.0-0.pgm"])
    os.mkfifo(folder / "d-1.0-0.pgm")
    assert "is no file" in refusal(folder)


def test_a_folder_without_an_index_is_named(tmp_path: Path) -> None:
    assert "neither INDEX.txt nor depth.txt" in refusal(tmp_path)


def test_a_byte_order_mark_is_no_part_of_the_first_line(tmp_path: Path) -> None:
    names, samples = ["d-10.0-60000.pgm", "d-10.1-2060000.pgm"], wall(2)
    raw = fakenect(tmp_path / "fakenect", dict(zip(names, map(pgm, samples), strict=True)))
    plain = tum(tmp_path / "tum", {"0.5": png(samples[0]), "0.6": png(samples[1])}, "0.5 depth/0.5.png\n0.6 depth/0.6.png\n")
    for folder, index in ((raw, "INDEX.txt"), (plain, "depth.txt")):
        (folder / index).write_text((folder / index).read_text(), encoding="utf-8-sig")
        *_, end = physinc.stream(folder)
        assert isinstance(end, physinc.StreamEnded)
        assert end.counters.frames == 2


def test_doubled_and_unsorted_frames_are_counted(tmp_path: Path) -> None:
    order = [0, 1, 1, 2, 4, 3, 5, 6, 12, 13]
    raw = [f"d-10.{i:06}-{i * 2_000_000}.pgm" for i in range(14)]
    folders = [
        fakenect(tmp_path / "fakenect", dict.fromkeys(raw, pgm(wall(1)[0])), [raw[i] for i in order]),
        tum(
            tmp_path / "tum",
            dict.fromkeys([f"{i / 30:.6f}" for i in range(14)], png(wall(1)[0])),
            "".join(f"{i / 30:.6f} depth/{i / 30:.6f}.png\n" for i in order),
        ),
    ]
    for folder in folders:
        stream = physinc.stream(folder)
        events = list(stream)
        gaps = [(event.reason, event.frames) for event in events if isinstance(event, physinc.Gap)]
        assert gaps[0] == ("stalled", 1)
        assert ("frames_lost", 5) in gaps
        end = events[-1]
        assert isinstance(end, physinc.StreamEnded)
        assert (end.counters.frames, end.counters.frames_dropped) == (10, 2)
        (remark,) = stream.remarks
        assert "time stands still or goes back in line 3; not used for that: 2; sort" in remark


def events(source: str | Path) -> list[dict[str, Any]]:
    """Its events, all but what it is called and how many packets they took."""
    dicts = [event.to_dict() for event in physinc.stream(source, positions=True, timeout=60)]
    assert dicts[0].pop("source") == str(source)
    dicts[-1]["counters"].pop("packets")
    return dicts


@pytest.mark.parametrize(("out", "options"), [("demo.npz", []), ("tum", ["--tum"])])
def test_the_recorded_demo_tells_the_same_to_the_last_bit(tmp_path: Path, out: str, options: list[str]) -> None:
    assert main(["record", "demo", str(tmp_path / out), *options]) == 0
    assert events(tmp_path / out) == events("demo")
    assert not list(tmp_path.glob("*.part"))


def test_the_demo_as_fakenect_tells_the_same_with_stamps_at_ticks(tmp_path: Path) -> None:
    assert main(["record", "demo", str(tmp_path / "demo.npz")]) == 0
    arrays = dict(np.load(tmp_path / "demo.npz"))
    # The demo's stamps are ticks; those of others may be up to half a tick beside.
    np.savez(tmp_path / "beside.npz", **(arrays | {"timestamps_ns": arrays["timestamps_ns"] + 5}))
    (tmp_path / "beside.camera.toml").write_text((tmp_path / "demo.camera.toml").read_text())
    told = events("demo")
    for source, out in (("beside.npz", "fakenect"), ("fakenect", "again.npz"), ("again.npz", "twice")):
        assert main(["record", str(tmp_path / source), str(tmp_path / out), "--every-frame"]) == 0
        assert events(tmp_path / out) == told


def test_depth_is_recorded_in_its_own_units_by_folders_and_in_mm_by_npz(tmp_path: Path) -> None:
    folder = tum(tmp_path / "rec", {f"{i / 30:.9f}": png(frame * 10) for i, frame in enumerate(wall(3))})
    for out, options in (("tum", ["--tum"]), ("fakenect", [])):
        assert main(["record", str(folder), str(tmp_path / out), *options]) == 0
        assert "depth_scale = 5000.0" in (tmp_path / out / "camera.toml").read_text()
        np.testing.assert_array_equal(read_back(tmp_path / out, tmp_path / f"{out}.npz")[1], wall(3) * 2)
    assert "depth_scale = 1000.0" in (tmp_path / "tum.camera.toml").read_text()


def npz(path: Path, stamps: list[int]) -> Path:
    np.savez(path, timestamps_ns=np.array(stamps, np.int64), disparity=wall(len(stamps)))
    path.with_suffix(".camera.toml").write_text(SMALL)
    return path


def test_fakenect_moves_a_stamp_by_half_a_tick_at_most(tmp_path: Path) -> None:
    exact = [71_599_999_999, 10**18 + 17, 5 * 10**18 + 10**9]
    source = npz(tmp_path / "in.npz", exact)
    assert main(["record", str(source), str(tmp_path / "fakenect")]) == 0
    stamps, samples = read_back(tmp_path / "fakenect", tmp_path / "out.npz")
    assert np.abs(stamps - exact).max() <= 8
    np.testing.assert_array_equal(samples, wall(3))
    assert main(["record", str(source), str(tmp_path / "tum"), "--tum"]) == 0
    assert read_back(tmp_path / "tum", tmp_path / "exact.npz")[0].tolist() == exact


def test_stamps_that_stand_go_back_or_are_below_zero_are_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stamps = [100_000_000_000, 100_000_000_000, 100_000_000_000, 0, 100_000_000_000]
    source = npz(tmp_path / "in.npz", stamps)
    for out, options in (("fakenect", []), ("tum", ["--tum"])):
        assert main(["record", str(source), str(tmp_path / out), *options]) == 0
        found, samples = read_back(tmp_path / out, tmp_path / f"{out}.npz")
        assert found.tolist() == stamps
        np.testing.assert_array_equal(samples, wall(5))
    early = npz(tmp_path / "early.npz", [-1, 0])
    assert main(["record", str(early), str(tmp_path / "early"), "--tum"]) == 0
    assert read_back(tmp_path / "early", tmp_path / "again.npz")[0].tolist() == [-1, 0]
    assert main(["record", str(early), str(tmp_path / "refused")]) == 1
    assert "no stamps below 0" in capsys.readouterr().err


def test_nothing_is_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = str(npz(tmp_path / "in.npz", [0, 1]))
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter").write_text("dear")
    (tmp_path / "file").write_text("dear")
    (tmp_path / "file.npz").write_text("dear")
    (tmp_path / "other.camera.toml").write_text(SMALL)
    before = sorted(tmp_path.rglob("*"))
    for out in ("full", "file", "file.npz", "other.npz", "in.npz"):
        assert main(["record", source, str(tmp_path / out)]) == 2
        assert "never overwritten" in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty.npz").touch()
    assert main(["record", source, str(tmp_path / "empty")]) == 0
    assert main(["record", source, str(tmp_path / "empty.npz")]) == 0


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["sim:drop", "out.pcapng"], 2, "captures hold packets"),
        (["sim:drop", "out.pcapng.zst"], 2, "captures hold packets"),
        (["sim:drop", "out.PCAP.gz"], 2, "*.pcapng (of packets"),
        (["demo", "out.npz", "--tum"], 2, "layout of a folder"),
        (["-", "out.npz"], 2, "-"),
        (["ball.csv", "out.npz"], 2, "only frames are recorded"),
        (["empty", "out"], 1, "empty"),
        (["empty", "out.npz"], 1, "empty"),
        (["nowhere.npz", "out"], 1, "no such file"),
        (["kinect", "out"], 3, "physinc run demo"),
        (["demo", "/dev/null/out"], 1, "/dev/null/out"),
        (["demo", "out", "--frames", "0"], 2, "frames"),
    ],
)
def test_what_can_not_be_recorded_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], *, arguments: list[str], code: int, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ball.csv").write_text("t,x,y,z\n0,1,2,3\n")
    fakenect(tmp_path / "empty", {}, [])
    assert main(["record", *arguments]) == code
    assert message in "".join(capfd.readouterr())
    assert {path.name for path in tmp_path.iterdir()} == {"ball.csv", "empty"}


def test_frames_before_a_break_are_kept_and_progress_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = fakenect(tmp_path / "rec", {f"d-1.{i}-{i * 2_000_000}.pgm": pgm(frame) for i, frame in enumerate(wall(5))})
    assert main(["record", str(folder), str(tmp_path / "two.npz"), "--frames", "2"]) == 0
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "two.npz: 2 of 2 frames, 0.0 s" in printed.err
    (folder / "d-1.3-6000000.pgm").write_bytes(b"P5")
    for out in ("out.npz", "out"):
        assert main(["record", str(folder), str(tmp_path / out)]) == 1
        assert "line 4" in capsys.readouterr().err
        assert len(list(physinc.stream(tmp_path / out))) == 2
    assert read_back(tmp_path / "out", tmp_path / "again.npz")[0].tolist() == [0, 33_333_333, 66_666_667]


@pytest.mark.parametrize("tum_layout", [False, True])
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_recording_that_is_ended_early_can_be_read(tmp_path: Path, tum_layout: bool, how: signal.Signals) -> None:
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-c",
        "import sys; from physinc.cli import main; sys.exit(main())",
        "record",
        "sim:bounce?throws=50",
        str(out),
    ]
    with subprocess.Popen([*command, *(["--tum"] if tum_layout else [])], stderr=subprocess.PIPE) as process:
        index = out / ("depth.txt" if tum_layout else "INDEX.txt")
        deadline = time.monotonic() + 60
        while not (index.exists() and index.read_text().count("\n") > 8) and time.monotonic() < deadline:
            time.sleep(0.01)
        process.send_signal(how)
        _, told = process.communicate(timeout=60)
    assert process.returncode == (130 if how == signal.SIGINT else -how)
    end = list(physinc.stream(out))[-1]
    assert isinstance(end, physinc.StreamEnded)
    assert end.counters.frames == sum(line[0] != "#" for line in index.read_text().splitlines())
    assert end.reason == "end_of_source"
    if how == signal.SIGINT:
        assert f"{out}: {end.counters.frames} frames, ".encode() in told
