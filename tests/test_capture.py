"""usbmon captures: read to the same events as frames, recorded, refused where they are none; and read by tshark."""

from __future__ import annotations

import functools
import gzip
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import physinc
from physinc.cli import main
from physinc.streaming import DEMO

PAYLOAD = 1748
Transfer = tuple[int, list[bytes]]


def pack(disparity: NDArray[np.uint16]) -> bytes:
    """11 bits a sample, the most significant first."""
    bits = np.unpackbits(disparity.astype(">u2").view(np.uint8).reshape(-1, 2), axis=1)[:, 5:]
    return np.packbits(bits).tobytes()


def transfers(stamps_ns: Iterable[int], images: Iterable[NDArray[np.uint16]]) -> Iterator[Transfer]:
    """What a Kinect sends: 242 packets a frame, 16 in a transfer of 2 ms; and when each transfer ended, µs."""
    sequence = 0
    for stamp_ns, image in zip(stamps_ns, images, strict=True):
        packed, ticks, packets = pack(image), (int(stamp_ns) * 3 + 25) // 50, []
        for i in range(242):
            flag = 0x71 if i == 0 else 0x75 if i == 241 else 0x72
            payload = packed[i * PAYLOAD : (i + 1) * PAYLOAD]
            header = struct.pack(">2sBBBBHBBBB", b"RB", 0, flag, 0, sequence % 256, len(payload) + 12, 0, 0, 0, 0)
            packets.append(header[:8] + struct.pack("<I", (ticks if i else 0) % 2**32) + payload)
            sequence += 1
        for i in range(0, 242, 16):
            yield int(stamp_ns) // 1000 + 2000 * (i // 16), packets[i : i + 16]


def usbmon(path: Path, sent: Iterable[Transfer], order: str = "<", link_type: int = 220) -> Path:
    """A pcap of completed transfers, as tcpdump writes it."""
    with path.open("wb") as file:
        file.write(struct.pack(f"{order}IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 262144, link_type))
        for at_us, packets in sent:
            seconds, us = divmod(at_us, 1_000_000)
            lengths = [len(packet) for packet in packets]
            head = struct.pack(f"{order}Q4BHBBqii", 7, ord("C"), 0, 0x82, 5, 1, ord("-"), 0, seconds, us, 0)
            head += struct.pack(f"{order}IIii", sum(lengths), 1936 * len(packets), 0, len(packets))
            if link_type == 220:
                head += struct.pack(f"{order}iiII", 1, 0, 0x202, len(packets))
            head += b"".join(struct.pack(f"{order}iIII", 0, 1920 * i, length, 0) for i, length in enumerate(lengths))
            record = head + b"".join(packet.ljust(1920, b"\0") for packet in packets)
            file.write(struct.pack(f"{order}IIII", seconds, us, len(record), len(record)) + record)
    return path


@functools.cache
def frames() -> dict[str, NDArray[Any]]:
    """The demo's first frames."""
    with tempfile.TemporaryDirectory() as folder:
        assert main(["record", "demo", f"{folder}/demo.npz", "--frames", "100"]) == 0
        return dict(np.load(f"{folder}/demo.npz"))


def demo(count: int | None = None) -> Iterator[Transfer]:
    """The packets of the demo's frames."""
    arrays = frames()
    return transfers(arrays["timestamps_ns"][:count], arrays["disparity"][:count])


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture of some of the demo: a throw and its bounces, with the camera's file beside it."""
    path = usbmon(tmp_path_factory.mktemp("capture") / "throw.pcap", demo(100))
    shutil.copy(DEMO.with_name("demo.camera.toml"), path.with_suffix(".camera.toml"))
    return path


def events(source: Path | str) -> list[dict[str, Any]]:
    """All events but for what the source calls itself, and what only packets have."""
    told = [event.to_dict() for event in physinc.stream(source, positions=True)]
    assert told[0].pop("source") == str(source)
    for counter in ("packets", "packets_lost", "packets_invalid"):
        told[-1]["counters"].pop(counter)
    return told


@pytest.mark.parametrize("out", ["a.pcapng", "a.pcapng.gz", "a.pcapng.zst", "a.npz", "fakenect", "tum"])
def test_what_is_recorded_tells_the_same(capture: Path, tmp_path: Path, out: str) -> None:
    options = ["--tum"] if out == "tum" else []
    assert main(["record", str(capture), str(tmp_path / out), *options]) == 0
    told = events(capture)
    assert sum(event["event"] == "contact" for event in told) >= 2
    assert events(tmp_path / out) == told


@pytest.mark.parametrize("limit", [["--frames", "7"], ["--duration", "1.25"]])
def test_limits_are_those_of_frames(capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], limit: list[str]) -> None:
    assert main(["record", str(capture), str(tmp_path / "frames.npz")]) == 0
    ends = []
    for source in (capture, tmp_path / "frames.npz"):
        assert main(["run", str(source), "--json", "--positions", *limit]) == 0
        ends.append(capsys.readouterr().out.splitlines())
    assert len(ends[0]) == len(ends[1])
    assert ends[0][1:-1] == ends[1][1:-1]
    assert '"limit"' in ends[0][-1]


def test_a_capture_tells_what_its_frames_do(capture: Path) -> None:
    whole = [event for event in physinc.stream("demo") if isinstance(event, physinc.Contact)]
    # Of the last one the capture doesn't show all that comes after.
    contacts = [event for event in physinc.stream(capture) if isinstance(event, physinc.Contact)][:-1]
    assert contacts
    for contact, other in zip(contacts, whole, strict=False):
        assert abs(contact.time_ns - other.time_ns) < 1000
        np.testing.assert_allclose(contact.center, other.center, atol=1e-5)


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("link_type", [189, 220])
def test_tshark_reads_what_is_read_and_what_is_written(tmp_path: Path, order: str, link_type: int) -> None:
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("tshark is not installed (Debian: apt-get install tshark)")
    source = usbmon(tmp_path / "source.pcap", demo(3), order, link_type)
    assert main(["record", str(source), str(tmp_path / "out.pcapng")]) == 0
    fields = ["usb.urb_type", "usb.transfer_type", "usb.endpoint_address", "usb.iso.numdesc", "usb.iso.iso_len"]
    for path in (source, tmp_path / "out.pcapng"):
        command = [tshark, "-r", str(path), "-T", "fields", *(word for field in fields for word in ("-e", field))]
        result = subprocess.run(command, capture_output=True, text=True, check=True)
        assert not [line for line in result.stderr.splitlines() if "Running as user" not in line], result.stderr
        rows = [line.split("\t") for line in result.stdout.splitlines()]
        completions = [row for row in rows if row[0] == "'C'" and row[1] == "0x00"]
        assert len(completions) == 3 * 16
        assert all(row[2] == "0x82" for row in completions)
        lengths = [int(length) for row in completions for length in row[4].split(",")]
        assert lengths == (241 * [1760] + [1144]) * 3
    assert shown(tshark, tmp_path / "out.pcapng", "_ws.malformed") == ""
    assert "0x02ae" in shown(tshark, tmp_path / "out.pcapng", "usb.idProduct")


def shown(tshark: str, path: Path, condition: str) -> str:
    """All that tshark says of the records that meet a condition."""
    return subprocess.run([tshark, "-r", str(path), "-V", "-Y", condition], capture_output=True, text=True, check=True).stdout


def refusal(source: Path | str) -> str:
    with pytest.raises(physinc.RecordingError) as raised:
        list(physinc.stream(source))
    message = str(raised.value)
    assert "\n" not in message
    assert message.startswith(f"{source}: ")
    return message


def bomb(path: Path) -> Path:
    """256 MiB of zeros, in one, behind the beginning of a capture."""
    with gzip.open(path, "wb", 1) as file:
        file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 262144, 220))
        for _ in range(64):
            file.write(bytes(1 << 22))
    return path


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("empty.pcap", lambda path: path.write_bytes(b""), "empty"),
        ("empty.pcapng.zst", lambda path: path.write_bytes(b""), "empty"),
        ("foreign.pcap", lambda path: path.write_bytes(b"PK\3\4" + bytes(100)), "begins with 50 4b 03 04"),
        ("text.pcapng", lambda path: path.write_text("a ball, thrown"), "no pcap or pcapng"),
        ("cut.pcap", lambda path: path.write_bytes(usbmon(path, demo(1)).read_bytes()[:1000]), "cut in the middle of a block"),
        ("cut.pcap.gz", lambda path: path.write_bytes(gzip.compress(bytes(1000))[:-9]), "begins with 00 00 00 00"),
        ("ethernet.pcap", lambda path: usbmon(path, [], link_type=1), r"link type is 1 \(Ethernet\)"),
        ("silent.pcap", lambda path: usbmon(path, []), "no Kinect in it"),
        ("webcam.pcap", lambda path: usbmon(path, [(0, [bytes(1000)] * 9)] * 9), "no Kinect in it"),
        ("frameless.pcap", lambda path: usbmon(path, [next(demo(1))]), "neither frames nor positions"),
        ("bomb.pcap.gz", bomb, "no Kinect in "),
    ],
)
def test_what_is_no_capture_of_a_kinect_is_refused(tmp_path: Path, name: str, write: Callable[[Path], Any], message: str) -> None:
    path = tmp_path / name
    write(path)
    assert re.search(message, refusal(path))


def test_what_comes_before_a_cut_is_told_then_the_error(capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = capture.read_bytes()
    cut = tmp_path / "cut.pcap"
    cut.write_bytes(whole[: len(whole) * 3 // 5])
    shutil.copy(capture.with_suffix(".camera.toml"), tmp_path / "cut.camera.toml")
    assert main(["run", str(cut), "--json"]) == 1
    out, err = capsys.readouterr()
    assert out.count('"event": "contact"') + out.count('"event":"contact"') >= 1
    assert '"disconnected"' in out.splitlines()[-1]
    assert err.startswith(f"physinc: {cut}: the file is cut")
    assert err.count("\n") == 1


def test_losses_are_told_and_counted(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = f"{capture}?lose=0.05&seed=3"
    told = list(physinc.stream(source, positions=True))
    end = told[-1]
    assert isinstance(end, physinc.StreamEnded)
    gaps = [event for event in told if isinstance(event, physinc.Gap)]
    assert {gap.reason for gap in gaps} == {"packets_lost"}
    assert sum(gap.packets or 0 for gap in gaps) == end.counters.packets_lost > 900
    assert end.counters.frames_incomplete > 80
    assert sum(isinstance(event, physinc.Contact) for event in told) >= 2
    assert main(["run", source]) == 0
    out, err = capsys.readouterr()
    assert "faults on purpose: " in err
    assert f", {end.counters.packets_lost} of " in out
    assert out.count("nothing for") == sum(bool(gap.frames) for gap in gaps)
    assert "no fault `loose`" in refusal(f"{capture}?loose=1")


def test_faults_are_those_of_packets(tmp_path: Path, csv: Path, npz: Path) -> None:
    *_, end = physinc.stream("demo?lose=0.05&seed=3")
    assert isinstance(end, physinc.StreamEnded)
    assert end.counters.packets_lost > 900
    for source in (csv, npz, "sim:drop?seed=1"):
        with pytest.raises(physinc.UnknownSourceError, match="faults happen to packets, and it delivers none: captures do, the demo"):
            physinc.stream(f"{source}?lose=0.1")


def test_only_packets_are_recorded_in_captures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["record", "sim:drop", str(tmp_path / "out.pcapng")]) == 2
    assert "captures hold packets" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_silent_pipe_can_be_interrupted(tmp_path: Path) -> None:
    pipe = tmp_path / "live.pcap"
    os.mkfifo(pipe)
    command = [sys.executable, "-c", "import sys; from physinc.cli import main; sys.exit(main())", "run", str(pipe)]
    # Once both ends are open it waits for the first byte.
    with subprocess.Popen(command, stderr=subprocess.PIPE) as process, pipe.open("wb"):
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130


@pytest.mark.parametrize("name", ["live.pcap", "live.pcapng?lose=0.1&seed=1", "live.csv"])
@pytest.mark.parametrize("opened", [False, True])
def test_a_silent_pipe_is_a_timeout(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, opened: bool) -> None:
    pipe = tmp_path / name.partition("?")[0]
    os.mkfifo(pipe)
    writer = os.open(pipe, os.O_RDWR) if opened else None
    begun = time.monotonic()
    with pytest.raises(physinc.errors.StreamTimeoutError, match=r"no input for 0\.\d s; timeout="):
        list(physinc.stream(tmp_path / name, timeout=0.2))
    assert time.monotonic() - begun < 2
    assert main(["run", str(tmp_path / name)]) == 1
    error = capsys.readouterr().err
    assert "no input for 2." in error
    assert " s; `physinc doctor` looks why" in error
    assert "timeout=" not in error
    if writer is not None:
        os.close(writer)


def test_faults_are_recorded_like_anything_else(capture: Path, tmp_path: Path) -> None:
    source, out = f"{capture}?lose=0.02&double=0.01&foreign=0.01&late=0.01&seed=1", tmp_path / "out.pcapng.zst"
    assert main(["record", source, str(out)]) == 0
    assert events(out) == events(source)
