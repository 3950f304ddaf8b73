"""What a real kernel's usbmon saw of the virtual Kinect while physinc ran beside it: replayed, it tells the same as it did live."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from virtual_kinect import truth

CAPTURES = Path(os.environ.get("PHYSINC_USB_CAPTURES", Path(__file__).parents[1] / "fixtures/usb"))
NAMES = sorted(path.name.partition(".")[0] for path in CAPTURES.glob("*.pcap.zst"))


def live(name: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (CAPTURES / f"{name}.events").read_text().splitlines()]


def replayed(name: str, frames: int) -> list[dict[str, Any]]:
    physinc = [sys.executable, "-c", "import sys; from physinc.cli import main; sys.exit(main(sys.argv[1:]))"]
    run = [*physinc, "run", str(CAPTURES / f"{name}.pcap.zst"), "--json", "--frames", str(frames)]
    events = [json.loads(line) for line in subprocess.run(run, capture_output=True, check=True).stdout.splitlines()]
    # Where the captures lie is no one else's.
    return [{**event, "source": f"{name}.pcap.zst"} if "source" in event else event for event in events]


@pytest.mark.parametrize("name", NAMES)
def test_a_replay_tells_what_was_told_live(name: str) -> None:
    told = live(name)
    counters = told[-1]["counters"]
    again = replayed(name, counters["frames"])
    if "PHYSINC_BLESS" in os.environ:
        (CAPTURES / f"{name}.events").write_text("".join(json.dumps(event, separators=(",", ":")) + "\n" for event in again))
    else:
        assert [{**event, "source": None} for event in again] == [{**event, "source": None} for event in told]
    assert "/" not in live(name)[0]["source"]
    sent = truth(CAPTURES / f"{name}.truth")[: counters["frames"]]
    assert sum(len(frame["lost"]) for frame in sent) == counters["packets_lost"]


def test_there_are_captures() -> None:
    assert "clean" in NAMES
