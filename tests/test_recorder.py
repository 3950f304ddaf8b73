"""Recording beside a stream, on a full disk, and until the very end: what was written can be read."""

from __future__ import annotations

import contextlib
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import physinc
from physinc.cli import main

PHYSINC = [sys.executable, "-c", "import sys; from physinc.cli import main; sys.exit(main())"]
OUTS = ["out.pcapng", "out.pcapng.gz", "out.pcapng.zst", "out.npz", "out", "tum"]


def events(source: str | Path, **options: Any) -> list[dict[str, Any]]:
    """All but the first, which names the source."""
    return [event.to_dict() for event in physinc.stream(source, **options)][1:]


def frames(source: Path) -> int:
    """How many frames can be read of what may be cut."""
    stream = physinc.stream(source)
    with contextlib.suppress(physinc.RecordingError):
        list(stream)
    return stream.stats.frames


def layout(out: str) -> list[str]:
    return ["--tum"] if out == "tum" else []


@pytest.fixture(scope="module")
def packets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture of throws."""
    out = tmp_path_factory.mktemp("packets") / "throws.pcapng"
    assert main(["simulate", "bounce?throws=1&seed=2", str(out)]) == 0
    return out


@pytest.mark.parametrize("out", OUTS)
def test_events_go_on_while_it_is_recorded(packets: Path, tmp_path: Path, out: str, capsys: pytest.CaptureFixture[str]) -> None:
    source = f"{packets}?lose=0.001&seed=1"
    assert main(["run", source, "--json", "--record", str(tmp_path / out), *layout(out)]) == 0
    told = capsys.readouterr().out
    assert main(["run", source, "--json"]) == 0
    assert capsys.readouterr().out == told
    # Other formats don't say which samples a lost packet had, nor fractions of a tick.
    if out.startswith("out.pcapng"):
        assert events(tmp_path / out) == events(source)
    assert frames(tmp_path / out) == int(told.rsplit('"frames":', 1)[1].split(",")[0])


@pytest.mark.parametrize("out", ["out.npz", "out", "tum"])
def test_frames_have_what_came_and_2047_for_what_was_lost(packets: Path, tmp_path: Path, out: str) -> None:
    source = f"{packets}?lose=0.01&seed=1"
    assert main(["record", source, str(tmp_path / out), *layout(out)]) == 0
    assert main(["record", str(packets), str(tmp_path / "clean.npz")]) == 0
    if out != "out.npz":
        assert main(["record", str(tmp_path / out), str(tmp_path / "again.npz")]) == 0
    with np.load(tmp_path / "clean.npz") as archive:
        sent, sent_ns = archive["disparity"], archive["timestamps_ns"]
    with np.load(tmp_path / ("out.npz" if out == "out.npz" else "again.npz")) as archive:
        kept, kept_ns = archive["disparity"], archive["timestamps_ns"]
    which = np.abs(sent_ns - kept_ns[:, None]).argmin(axis=1)
    # fakenect's ticks.
    assert np.abs(sent_ns[which] - kept_ns).max() <= 8
    differs = kept != sent[which]
    assert (kept[differs] == 2047).all()
    end = events(source)[-1]["counters"]
    # A packet has 1748 bytes of samples, which have 11 bits.
    assert 0 < differs.sum() <= end["packets_lost"] * (1748 * 8 / 11 + 2)
    # That they were lost is not kept.
    assert end["frames_incomplete"] > 0
    assert events(tmp_path / out)[-1]["counters"]["frames_incomplete"] == 0


def test_whoever_closes_a_stream_has_a_whole_recording(packets: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.npz"
    with physinc.stream(packets, positions=True, record=out) as stream:
        next(event for event in stream if isinstance(event, physinc.Position))
        seen = stream.stats.frames
    assert not (tmp_path / "out.npz.stamps").exists()
    with np.load(out) as archive:
        assert len(archive["timestamps_ns"]) == len(archive["disparity"]) >= seen
    with pytest.raises(physinc.ConfigError, match="an iterable's own items"):
        physinc.stream([], record=out)
    with pytest.raises(physinc.ConfigError, match="never overwritten"):
        physinc.stream(packets, record=out)


@pytest.mark.parametrize("there", ["out.npz", "out.camera.toml", "out.npz.stamps"])
def test_what_is_in_the_way_is_named(packets: Path, tmp_path: Path, there: str) -> None:
    (tmp_path / there).write_text("mine")
    with pytest.raises(physinc.ConfigError, match=rf"{there}: there is something already, which is never overwritten"):
        physinc.stream(packets, record=tmp_path / "out.npz")
    assert [path.name for path in tmp_path.iterdir()] == [there]


@pytest.mark.parametrize("out", ["out.csv", "out.pcapng.bz2", "out.zst", "out.npz.gz", "out.PNG", "out.7z"])
def test_another_files_name_is_no_folders(packets: Path, tmp_path: Path, out: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["record", str(packets), str(tmp_path / out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{out}: recordings are *.npz, *.pcapng" in line
    assert not any(tmp_path.iterdir())
    (tmp_path / out).mkdir()
    assert main(["record", str(packets), str(tmp_path / out), "--frames", "1"]) == 0


def test_a_folder_may_end_with_a_date(packets: Path, tmp_path: Path) -> None:
    assert main(["record", str(packets), str(tmp_path / "throws.2026"), "--frames", "1"]) == 0
    assert frames(tmp_path / "throws.2026") == 1


def test_a_line_tells_of_frames_losses_and_bytes(packets: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.pcapng"
    assert main(["record", f"{packets}?lose=0.01&seed=1", str(out), "--frames", "20"]) == 0
    *_, line, remark = capsys.readouterr().err.splitlines()
    assert f"{out}: 20 of 20 frames, 0.6 s, " in line
    assert "faults on purpose" in remark
    lost, written = line.split(", ")[2:]
    assert 10 < int(lost.split()[0]) < 100
    assert float(written.split()[0]) == pytest.approx(out.stat().st_size / 1e6, abs=1.0)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with a name are POSIX's")
@pytest.mark.parametrize("out", OUTS)
def test_a_killed_recording_is_read_up_to_its_last_second(packets: Path, tmp_path: Path, out: str) -> None:
    pipe, made = tmp_path / "live.pcapng", tmp_path / out
    os.mkfifo(pipe)
    command = [*PHYSINC, "record", str(pipe), str(made), *layout(out)]
    whole = packets.read_bytes()
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as recorder, pipe.open("wb") as live:
        live.write(whole[: int(len(whole) * 0.9)])
        live.flush()
        # It is still listening for the rest.
        wait_until_written(made)
        recorder.kill()
    sent = frames(packets) * 0.9
    assert frames(made) >= sent - 31
    if out == "out.npz":
        with np.load(made) as archive:
            assert len(archive["timestamps_ns"]) == len(archive["disparity"]) >= sent - 31


def wait_until_written(made: Path) -> None:
    """Return once there is something and no more comes."""
    size, deadline = -1, time.monotonic() + 60
    while time.monotonic() < deadline and not size == total(made) > 0:
        size = total(made)
        time.sleep(0.7)


def total(made: Path) -> int:
    files = made.rglob("*") if made.is_dir() else [made]
    return sum(file.stat().st_size for file in files if file.exists())


def test_a_killed_npz_says_so_and_can_be_completed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made, whole = tmp_path / "out.npz", tmp_path / "whole.npz"
    command = [*PHYSINC, "record", "demo", str(made)]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as recorder:
        while not (made.exists() and made.stat().st_size > 1_000_000):
            time.sleep(0.01)
        # Right in the middle of writing.
        recorder.kill()
    saved = (tmp_path / "out.npz.stamps").stat().st_size // 8
    assert main(["record", str(made), str(whole)]) == 0
    assert f"{saved} frames are whole" in capsys.readouterr().err
    with np.load(whole) as archive:
        assert archive["disparity"].shape == (saved, 480, 640)
    assert frames(made) == frames(whole) == saved > 0


@pytest.mark.parametrize("out", OUTS[:4])
@pytest.mark.parametrize("command", ["record", "run"])
def test_a_full_disk_says_what_to_do_and_leaves_what_was_written(packets: Path, tmp_path: Path, out: str, command: str) -> None:
    made, room = tmp_path / out, tmp_path / f"room.{out.partition('.')[2]}"
    assert main(["record", str(packets), str(room)]) == 0
    # No file may become larger than this; a disk that is full refuses in the same way.
    limit = int(room.stat().st_size * 0.6)
    arguments = ["record", str(packets), str(made)] if command == "record" else ["run", str(packets), "--record", str(made)]
    done = subprocess.run(
        [*PHYSINC, *arguments],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"physinc: {made}: there is no room for more")
    assert "free some space" in last
    assert "Traceback" not in done.stderr
    assert frames(made) >= 0.6 * frames(packets) - 31


def test_a_full_disk_leaves_a_folder_of_whole_frames(packets: Path, tmp_path: Path) -> None:
    made = tmp_path / "out"
    # From the twentieth frame on no file may become as large as a frame is.
    code = (
        "import resource, sys\nfrom physinc._physinc import open_recording\n"
        "with open_recording(sys.argv[1], sys.argv[2], gravity=None, tum=False, frames=None) as recording:\n"
        "    for count, _ in recording:\n"
        "        if count == 19: resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(packets), str(made)], capture_output=True, text=True, timeout=60, check=False)
    assert "there is no room for more" in done.stderr.splitlines()[-1]
    assert frames(made) == 19
