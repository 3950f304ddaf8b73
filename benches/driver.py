"""What a frame of a Kinect costs, beside libfreenect on the same virtual device: instructions from packets to 16-bit samples, wake-ups.

Instructions are callgrind's, of the user's space, the difference of two lengths of a run: opening and closing cancel.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
RELEASE = ROOT / "target/release"
SHORT, LONG = 30, 90
REAL_TIME = 300


def run(*command: str | Path) -> str:
    """Both streams of what it prints."""
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if result.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}:\n{result.stderr}")
    return result.stdout + result.stderr


def instructions(*command: str | Path) -> float:
    """Millions a frame; `{}` in the command is how many frames."""

    def counted(frames: int) -> int:
        program = [str(word).format(frames) for word in command]
        callgrind = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
        printed = run(RELEASE / "virtual-kinect", "sim:bounce", "--", *callgrind, *program)
        found = re.search(r"Collected : (\d+)", printed)
        if found is None:
            raise SystemExit(printed)
        return int(found[1])

    return (counted(LONG) - counted(SHORT)) / (LONG - SHORT) * 1e-6


def main() -> None:
    """Build both programs, count, print."""
    run("cargo", "build", "--release", "--locked", "--quiet", "--features", "usb", "--example", "live")
    live = RELEASE / "examples/live"
    with tempfile.TemporaryDirectory() as folder:
        judge = Path(folder) / "frames"
        run("cc", "-O2", "-I/usr/include/libusb-1.0", ROOT / "tests/judge/frames.c", "-o", judge, "-lfreenect")
        theirs = instructions(judge, "11", "{}", "silent")
    ours = instructions(live, "{}")
    sys.stdout.write(f"instructions a frame: physinc {ours:.2f} million, libfreenect {theirs:.2f} million, ratio {ours / theirs:.2f}\n")
    for packets in (64, 16):
        printed = run(RELEASE / "virtual-kinect", "sim:bounce", "--realtime", "--", live, str(REAL_TIME), f"kinect?packets={packets}")
        found = re.search(r"wakeups: (\d+)", printed)
        if found is None:
            raise SystemExit(printed)
        wakeups = int(found[1]) / REAL_TIME * 30
        sys.stdout.write(f"wake-ups at {packets} packets a transfer: {wakeups:.0f} a second at 30 frames a second\n")


if __name__ == "__main__":
    main()
