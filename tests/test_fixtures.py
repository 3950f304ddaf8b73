"""The captures in `fixtures/`: what the command line and Python make of them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import physinc

FIXTURES = Path(__file__).parents[1] / "fixtures"
ROW = re.compile(r"\| `(.+?\.pcap.*?)` \| .+? \| .+? \| (\d+) \| (\d+) \| (\d+|not known) \| (\d+) \|")
TABLE = [match.groups() for match in map(ROW.match, (FIXTURES / "README.md").read_text().splitlines()) if match]


@pytest.mark.parametrize(("name", "frames", "incomplete", "lost", "invalid"), TABLE)
def test_a_capture_is_counted_as_its_table_says(name: str, frames: str, incomplete: str, lost: str, invalid: str) -> None:
    *_, end = physinc.stream(FIXTURES / name, timeout=60)
    assert isinstance(end, physinc.StreamEnded)
    counters = end.counters
    known = [frames, incomplete, "0" if lost == "not known" else lost, invalid]
    assert [counters.frames, counters.frames_incomplete, counters.packets_lost, counters.packets_invalid] == [int(n) for n in known]


@pytest.mark.parametrize("name", ["clean.pcapng.zst", "big_endian_189.pcap.gz", "lost.pcapng.zst"])
def test_its_contacts_are_those_that_happened(name: str) -> None:
    truth = json.loads((FIXTURES / "truth.json").read_text())["contacts"]
    told = [event for event in physinc.stream(FIXTURES / name, timeout=60) if isinstance(event, physinc.Contact)]
    assert len(told) == len(truth)
    for contact, true in zip(told, truth, strict=True):
        assert contact.time_ns == pytest.approx(true["time_ns"], abs=2e6)
        assert contact.center == pytest.approx(true["center"], abs=4e-3)


def test_a_cut_capture_is_read_up_to_the_cut() -> None:
    stream = physinc.stream(FIXTURES / "cut.pcapng.zst", timeout=60)
    with pytest.raises(physinc.RecordingError, match="cut"):
        list(stream)


def test_every_whole_capture_is_in_the_table() -> None:
    files = {path.name for path in FIXTURES.iterdir() if ".pcap" in path.name}
    assert files == {row[0] for row in TABLE} | {"cut.pcapng.zst"}
