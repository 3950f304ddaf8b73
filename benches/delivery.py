"""How long a live Kinect's frame takes to Python: from its last packet to its position, beside an empty hand-over between threads.

Runs physinc on the virtual Kinect, in real time. The 64 packets of a transfer come together: what a packet waits for the last of them
(up to 8 ms) is a part of the time told.
"""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
import time

import numpy as np
from numpy.typing import NDArray

import physinc

FRAMES = 300
VIRTUAL = "target/release/virtual-kinect"


def told(source: str) -> NDArray[np.float64]:
    """From the last packet of each frame to its first position, ms."""
    delays, newest = [], -1
    with physinc.stream(source, positions=True, timeout=10) as stream:
        for event in stream:
            now = time.time_ns()
            if isinstance(event, physinc.Position) and event.frame > newest and stream.arrival_ns is not None:
                newest = event.frame
                delays.append(now - stream.arrival_ns)
            if stream.stats.frames >= FRAMES:
                break
    return np.array(delays) * 1e-6


def handed_over(count: int) -> NDArray[np.float64]:
    """From put to get of an empty queue between two threads, 33 ms apart, ms."""
    stamps: queue.SimpleQueue[int] = queue.SimpleQueue()

    def put() -> None:
        for _ in range(count):
            time.sleep(1 / 30)
            stamps.put(time.time_ns())

    thread = threading.Thread(target=put)
    thread.start()
    delays = [-(stamps.get() - time.time_ns()) for _ in range(count)]
    thread.join()
    return np.array(delays) * 1e-6


def show(what: str, delays: NDArray[np.float64]) -> None:
    """One line."""
    median, tail = np.percentile(delays, (50, 99))
    sys.stdout.write(f"{what:<34} median {median:7.3f} ms, 99th percentile {tail:7.3f} ms ({len(delays)})\n")


def main() -> None:
    """Run this under the virtual device, for two sizes of transfers."""
    if "--inside" not in sys.argv:
        command = [VIRTUAL, "sim:many", "--realtime", "--", sys.executable, __file__, "--inside"]
        sys.exit(subprocess.run(command, check=False).returncode)
    for packets in (64, 16):
        show(f"{packets} packets a transfer", told(f"kinect?packets={packets}"))
    show("an empty queue between threads", handed_over(150))


if __name__ == "__main__":
    main()
