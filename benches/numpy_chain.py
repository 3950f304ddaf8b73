"""The chain from packed disparity to an innovation in plain numpy and with OpenCV, beside physinc on the same bytes.

    python benches/numpy_chain.py [SCENE …] [--frames N]

What somebody who knows numpy would write in an afternoon: samples from packed bytes, depth from disparity, background, connected
components, a sphere of known radius by least squares, a parabola through the last positions. physinc does more (covariances, silhouettes,
tracks, contacts); the ratio is what a user would notice. All run interleaved in one process, medians of 7, and every round goes through
all frames, so that each comes from memory. Times are the processor's, of all threads, but for the engine's own.

`whole`, `mixed`: packed bytes to positions as `cargo bench --bench speed` prints it for the same frames, in memcpys of its own run: every
frame searched whole, as numpy and OpenCV do it, and as on a stream, where a tracked ball is looked for where it can be and the whole image
searched every 0.1 s. Both with covariances, silhouettes included; without tracks and contacts, of which numpy and OpenCV have the parabola.
`engine`: from a frame's last packet to its events, by the engine's own clock (`Stream.busy`): unpacking, seeing, tracking, reasoning.
`stream`: `list(physinc.stream(capture))`: all of that, and reading the capture's file, putting packets together, events as Python objects,
two threads that wait for each other. numpy and OpenCV are given each frame's packed bytes in one piece.
"""

from __future__ import annotations

import argparse
import json
import re
import statistics
import subprocess
import tempfile
from collections import defaultdict, deque
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

import physinc

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Mask = NDArray[np.bool_]
    Array = NDArray[Any]
    LookUp = Callable[[Array, Array, Array], Array]
    Blobs = Callable[[Mask], list[tuple[Array, Array]]]

ROUNDS = 7
SCENES = ("bounce?seed=1&distance=1.5&throws=10", "room?seed=1&distance=1.5&throws=10")
RADIUS = 0.033  # m
RULERS = {
    "memcpy": ("memcpy",),
    "11 bits": ("memcpy", "11 bits: physinc.unpack_disparity"),
    "chain": ("chain: physinc, stream", "chain: physinc, engine", "chain: physinc, mixed", "chain: physinc, whole"),
}
BACKGROUND_FRAMES = 15
MARGIN = 0.05  # m before the background
SMALLEST, LARGEST = 30, 20_000  # px
WINDOW = 10  # positions
THETA = 0.03  # m


def pack(raw: Array) -> Array:
    """Bytes of 11-bit samples as a Kinect sends them, most significant bit first."""
    bits = raw.reshape(-1, 1) >> np.arange(10, -1, -1, dtype=np.uint16) & 1
    return np.packbits(bits.astype(np.uint8))


def unpack(packed: Array) -> Array:
    """Return the samples [480, 640] of packed bytes, 8 from every 11: the fastest of six ways that we tried."""
    a, b, c, d, e, f, g, h, i, j, k = np.ascontiguousarray(packed.reshape(-1, 11).T).astype(np.uint16)
    samples = np.empty((len(a), 8), np.uint16)
    samples[:, 0] = a << 3 | b >> 5
    samples[:, 1] = (b & 31) << 6 | c >> 2
    samples[:, 2] = (c & 3) << 9 | d << 1 | e >> 7
    samples[:, 3] = (e & 127) << 4 | f >> 4
    samples[:, 4] = (f & 15) << 7 | g >> 1
    samples[:, 5] = (g & 1) << 10 | h << 2 | i >> 6
    samples[:, 6] = (i & 63) << 5 | j >> 3
    samples[:, 7] = (j & 7) << 8 | k
    return samples.reshape(480, 640)


def unpack_bits(packed: Array) -> Array:
    """Return the samples [480, 640] of packed bytes, as it is usually written."""
    bits = np.unpackbits(packed).reshape(-1, 11)
    return np.packbits(np.pad(bits, ((0, 0), (5, 0))), axis=1).view(">u2").astype(np.uint16).reshape(480, 640)


def blobs_opencv(mask: Mask) -> list[tuple[Array, Array]]:
    """Rows and columns of each component; contours take a thirtieth of the time of `connectedComponentsWithStats`."""
    found = []
    for contour in cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]:
        x, y, width, height = cv2.boundingRect(contour)
        inside = np.zeros((height, width), np.uint8)
        cv2.drawContours(inside, [contour], 0, 1, cv2.FILLED, offset=(-x, -y))
        rows, columns = np.nonzero(inside.view(np.bool_) & mask[y : y + height, x : x + width])
        if SMALLEST <= len(rows) <= LARGEST:
            found.append((rows + y, columns + x))
    return found


def blobs_numpy(mask: Mask) -> list[tuple[Array, Array]]:
    """Rows and columns of each component: runs of each row, joined where they touch."""
    occupied = np.flatnonzero(mask.any(axis=1))
    if not len(occupied):
        return []
    top = occupied[0]
    edges = np.diff(mask[top : occupied[-1] + 1].view(np.int8), axis=1, prepend=0, append=0)
    rows, starts = np.nonzero(edges == 1)
    ends = np.nonzero(edges == -1)[1]
    rows += top
    runs = list(zip(rows.tolist(), starts.tolist(), ends.tolist(), strict=True))
    parent = list(range(len(runs)))

    def root(i: int) -> int:
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        return i

    above = 0
    for i, (row, start, end) in enumerate(runs):
        while runs[above][0] < row - 1 or (runs[above][0] == row - 1 and runs[above][2] < start):
            above += 1
        j = above
        while runs[j][0] == row - 1 and runs[j][1] <= end:
            parent[root(i)] = root(j)
            j += 1
    components: dict[int, list[int]] = {}
    for i in range(len(runs)):
        components.setdefault(root(i), []).append(i)
    found = []
    for members in components.values():
        columns = np.concatenate([np.arange(runs[i][1], runs[i][2]) for i in members])
        if SMALLEST <= len(columns) <= LARGEST:
            lengths = [runs[i][2] - runs[i][1] for i in members]
            found.append((np.repeat([runs[i][0] for i in members], lengths), columns))
    return found


def look_up_numpy(raw: Array, depths: Array, out: Array) -> Array:
    """Depth of each sample; told that it may clip, numpy checks nothing and needs no buffer."""
    return np.take(depths, raw, out=out, mode="clip")


def fit_sphere(points: Array) -> tuple[Array, float]:
    """Center of the sphere of known radius through points [N,3] (m), Gauss–Newton with Huber weights, and its rms (m)."""
    mean = points.mean(axis=0)
    center = mean * (1 + 2 / 3 * RADIUS / np.linalg.norm(mean))
    residual = np.zeros(len(points))
    for _ in range(6):
        offset = points - center
        distance = np.linalg.norm(offset, axis=1)
        residual = distance - RADIUS
        scale = 1.5 * 1.4826 * np.median(np.abs(residual)) + 1e-9
        weight = np.minimum(1, scale / np.maximum(np.abs(residual), 1e-12))
        slope = offset / distance[:, None]
        normal = slope.T @ (weight[:, None] * slope) + 1e-9 * np.eye(3)
        step = np.linalg.solve(normal, slope.T @ (weight * residual))
        center = center + step
        if np.abs(step).max() < 1e-6:
            break
    return center, float(np.sqrt(np.mean(residual**2)))


class Chain:
    """Frames to positions and inconsistencies, one ball at a time."""

    def __init__(self, camera: dict[str, Any], law: list[float], look_up: LookUp, blobs: Blobs) -> None:
        """`camera` is the model of `stream_started`, `law` the disparity law [c0, c1]."""
        inverse = law[0] + law[1] * np.arange(2**16)  # as many as OpenCV asks for
        with np.errstate(divide="ignore"):
            self.depths = np.where(inverse > 0, 1 / inverse, np.inf).astype(np.float32)
        self.depths[2047:] = np.inf
        self.camera, self.look_up, self.blobs = camera, look_up, blobs
        self.nearest: Array = np.full((camera["height"], camera["width"]), np.inf, np.float32)
        self.depth: Array = np.empty_like(self.nearest)
        self.frames = self.positions = self.inconsistencies = 0
        self.flight: deque[tuple[float, Array]] = deque(maxlen=WINDOW)

    def frame(self, timestamp_ns: int, raw: Array) -> None:
        """One disparity frame."""
        depth = self.look_up(raw, self.depths, self.depth)
        self.frames += 1
        if self.frames <= BACKGROUND_FRAMES:
            np.minimum(self.nearest, depth - MARGIN, out=self.nearest)
            return
        for rows, columns in self.blobs(depth < self.nearest):
            z = depth[rows, columns].astype(np.float64)
            x = (columns - self.camera["cx"]) / self.camera["fx"] * z
            y = (rows - self.camera["cy"]) / self.camera["fy"] * z
            center, rms = fit_sphere(np.stack([x, y, z], axis=1))
            if rms < RADIUS / 2:
                self.positions += 1
                self.follow(timestamp_ns * 1e-9, center)

    def follow(self, t: float, center: Array) -> None:
        """Innovation of a position against the parabola through the last ones."""
        if len(self.flight) >= 3:
            fall = np.array([0.0, 9.81, 0.0])  # camera frame: y is down
            elapsed = np.array([past for past, _ in self.flight]) - t
            bent = np.array([position for _, position in self.flight]) - 0.5 * elapsed[:, None] ** 2 * fall
            line = np.linalg.lstsq(np.stack([np.ones_like(elapsed), elapsed], axis=1), bent, rcond=None)[0]
            if np.linalg.norm(center - line[0]) > THETA:
                self.inconsistencies += 1
                self.flight.clear()
        self.flight.append((t, center))


def simulated(scene: str, frames: int, folder: Path) -> tuple[Path, list[int], list[Array], list[float]]:
    """Capture of a scene; the stamps, packed bytes and disparity law of the same frames."""
    capture, arrays = folder / "scene.pcapng", folder / "frames.npz"
    for source, out in ((f"sim:{scene}&packets=1", capture), (capture, arrays)):
        subprocess.run(["physinc", "record", source, out, "--frames", str(frames)], check=True, capture_output=True)
    law = json.loads(re.findall(r"disparity_law = (\[.*\])", arrays.with_suffix(".camera.toml").read_text())[0])
    with np.load(arrays) as recorded:
        return capture, recorded["timestamps_ns"].tolist(), [pack(frame) for frame in recorded["disparity"]], law


def seeing(scene: str, frames: int) -> dict[str, float]:
    """Packed bytes to positions by the bench in Rust, in memcpys."""
    command = ["cargo", "bench", "--locked", "--bench", "speed", "--", scene]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    if f"sim:{scene}, {frames} frames" not in lines:
        raise SystemExit(f"`{' '.join(command)}` has other frames than --frames {frames}")
    names = {"whole": "mean of all frames, each whole", "mixed": "positions, mean of all, as on a stream"}
    return {name: float(re.findall(rf"{line} +[0-9.]+ µs +([0-9.]+) memcpy", lines)[0]) for name, line in names.items()}


def main() -> None:
    """Simulate, run all interleaved, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--frames", type=int, default=600)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for scene in options.scenes:
        with tempfile.TemporaryDirectory() as folder:
            measure(scene, *simulated(scene, options.frames, Path(folder)), seen=seeing(scene, options.frames))


def measure(scene: str, capture: Path, stamps: list[int], packed: list[Array], law: list[float], *, seen: dict[str, float]) -> None:
    """Print the table of a scene."""
    frame = unpack(packed[0])
    copy = np.empty_like(frame)
    if not all(np.array_equal(frame, other(packed[0])) for other in (unpack_bits, physinc.unpack_disparity)):
        raise SystemExit("they don't unpack alike")
    times: defaultdict[str, list[float]] = defaultdict(list)
    found: dict[str, str] = {}

    def each(name: str, work: Callable[[Array], object], of: list[Array]) -> None:
        start = process_time()
        for one in of:
            work(one)
        times[name].append((process_time() - start) / len(of) * 1e6)

    unpacked = [unpack(one) for one in packed]
    for _ in range(ROUNDS):
        each("memcpy", lambda one: np.copyto(copy, one), unpacked)
        for name, memcpys in seen.items():
            times[f"chain: physinc, {name}"].append(memcpys * times["memcpy"][-1])
        each("11 bits: physinc.unpack_disparity", physinc.unpack_disparity, packed)
        each("11 bits: numpy, by columns", unpack, packed)
        each("11 bits: numpy, bit by bit", unpack_bits, packed[:10])
        start = process_time()
        stream = physinc.stream(capture, positions=True)
        events = list(stream)
        times["chain: physinc, stream"].append((process_time() - start) / len(packed) * 1e6)
        times["chain: physinc, engine"].append(stream.busy / len(packed) * 1e6)
        if stream.stats.frames != len(packed):
            raise SystemExit(f"{stream.stats.frames} frames of {len(packed)}")
        names = [event.event for event in events]
        found["chain: physinc, engine"] = f"{names.count('position')} positions, {names.count('contact')} contacts"
        camera = events[0].to_dict()["camera"]
        for name, look_up, blobs in (("chain: OpenCV", cv2.LUT, blobs_opencv), ("chain: numpy", look_up_numpy, blobs_numpy)):
            chain, stamp = Chain(camera, law, look_up, blobs), iter(stamps)
            each(name, lambda one, chain=chain, stamp=stamp: chain.frame(next(stamp), unpack(one)), packed)  # type: ignore[misc]
            found[name] = f"{chain.positions} positions, {chain.inconsistencies} inconsistencies"
    print(f"sim:{scene}, {len(packed)} frames, one core, medians of {ROUNDS} interleaved rounds; memcpy of 614,400 bytes")
    for name, of in times.items():
        line = f"{name:34} {statistics.median(of):9.1f} µs a frame"
        for ours in RULERS[name.partition(":")[0]]:
            ratio = statistics.median(one / other for one, other in zip(of, times[ours], strict=True))
            line += f" {ratio:8.2f} × {ours.rpartition(' ')[2]}"
        print(f"{line}   {found.get(name, '')}")
    print()


if __name__ == "__main__":
    main()
