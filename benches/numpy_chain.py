"""The chain from a depth frame to an innovation in plain numpy and with OpenCV, beside physinc on the same frames.

    python benches/numpy_chain.py [SCENE] [--frames N]

What somebody would write in an afternoon: depth from disparity, background, connected components, a sphere of known radius by
least squares, a parabola through the last positions. physinc does more (covariances, silhouettes, tracks, contacts); the ratio is
what a user would notice. The three run interleaved in one process, medians of 7. numpy and OpenCV begin with packed bytes, physinc with
samples: what it takes to unpack them is a row of `cargo bench --bench speed`, against the same memcpy as numpy's unpacking here.
"""

from __future__ import annotations

import argparse
import json
import re
import statistics
import subprocess
import tempfile
from collections import deque
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

import physinc

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Mask = NDArray[np.bool_]
    Array = NDArray[Any]

ROUNDS = 7
RADIUS = 0.033  # m
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
    """Return the samples [N] of packed bytes: 8 from every 11."""
    a, b, c, d, e, f, g, h, i, j, k = packed.reshape(-1, 11).astype(np.uint16).T
    eight = (
        a << 3 | b >> 5,
        (b & 31) << 6 | c >> 2,
        (c & 3) << 9 | d << 1 | e >> 7,
        (e & 127) << 4 | f >> 4,
        (f & 15) << 7 | g >> 1,
        (g & 1) << 10 | h << 2 | i >> 6,
        (i & 63) << 5 | j >> 3,
        (j & 7) << 8 | k,
    )
    return np.stack(eight, axis=1).reshape(-1)


def blobs_opencv(mask: Mask) -> list[tuple[Array, Array]]:
    """Rows and columns of each component."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8), connectivity=8)
    found = []
    for label in range(1, count):
        x, y, width, height, area = stats[label]
        if SMALLEST <= area <= LARGEST:
            rows, columns = np.nonzero(labels[y : y + height, x : x + width] == label)
            found.append((rows + y, columns + x))
    return found


def blobs_numpy(mask: Mask) -> list[tuple[Array, Array]]:
    """Rows and columns of each component: runs of each row, joined where they touch."""
    edges = np.diff(mask.view(np.int8), axis=1, prepend=0, append=0)
    rows, starts = np.nonzero(edges == 1)
    ends = np.nonzero(edges == -1)[1]
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
        center = center + np.linalg.solve(normal, slope.T @ (weight * residual))
    return center, float(np.sqrt(np.mean(residual**2)))


class Chain:
    """Frames to positions and inconsistencies, one ball at a time."""

    def __init__(self, camera: dict[str, Any], law: list[float], blobs: Callable[[Mask], list[tuple[Array, Array]]]) -> None:
        """`camera` is the model of `stream_started`, `law` the disparity law [c0, c1]."""
        inverse = law[0] + law[1] * np.arange(2048)
        with np.errstate(divide="ignore"):
            self.depths = np.where(inverse > 0, 1 / inverse, np.inf).astype(np.float32)
        self.depths[2047] = np.inf
        self.camera, self.blobs = camera, blobs
        self.nearest: Array = np.full((camera["height"], camera["width"]), np.inf, np.float32)
        self.depth: Array = np.empty_like(self.nearest)
        self.frames = self.positions = self.inconsistencies = 0
        self.flight: deque[tuple[float, Array]] = deque(maxlen=WINDOW)

    def frame(self, timestamp_ns: int, raw: Array) -> None:
        """One disparity frame."""
        depth = np.take(self.depths, raw, out=self.depth, mode="clip")
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


def main() -> None:
    """Simulate, run the three interleaved, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scene", nargs="?", default="bounce?seed=1")
    parser.add_argument("--frames", type=int, default=150)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "scene.npz"
        subprocess.run(["physinc", "simulate", options.scene, recording], check=True, stdout=subprocess.DEVNULL)
        with np.load(recording) as arrays:
            stamps = [int(stamp) for stamp in arrays["timestamps_ns"][: options.frames]]
            frames = list(arrays["disparity"][: options.frames])
        camera_toml = recording.with_suffix(".camera.toml")
        law = json.loads(re.findall(r"disparity_law = (\[.*\])", camera_toml.read_text())[0])
        times: dict[str, list[float]] = {"physinc": [], "OpenCV": [], "numpy": []}
        found: dict[str, str] = {}
        camera: dict[str, Any] = {}
        cv2.setNumThreads(1)
        packed = [pack(frame) for frame in frames]
        copy = np.empty_like(frames[0])
        unpacking: dict[str, list[float]] = {"memcpy of a frame": [], "numpy's unpacking": []}
        for _ in range(ROUNDS):
            start = perf_counter()
            for frame in frames:
                np.copyto(copy, frame)
            unpacking["memcpy of a frame"].append(perf_counter() - start)
            start = perf_counter()
            for bytes_ in packed:
                unpack(bytes_)
            unpacking["numpy's unpacking"].append(perf_counter() - start)
            start = perf_counter()
            events = list(physinc.stream(zip(stamps, frames, strict=True), camera=camera_toml, positions=True))
            times["physinc"].append(perf_counter() - start)
            names = [event.to_dict()["event"] for event in events]
            found["physinc"] = f"{names.count('position')} positions, {names.count('contact')} contacts"
            camera = events[0].to_dict()["camera"]
            for name, blobs in (("OpenCV", blobs_opencv), ("numpy", blobs_numpy)):
                chain = Chain(camera, law, blobs)
                start = perf_counter()
                for stamp, frame in zip(stamps, packed, strict=True):
                    chain.frame(stamp, unpack(frame).reshape(480, 640))
                times[name].append(perf_counter() - start)
                found[name] = f"{chain.positions} positions, {chain.inconsistencies} inconsistencies"
    print(f"sim:{options.scene}, {len(frames)} frames, one core, medians of {ROUNDS} interleaved rounds")
    medians = {name: statistics.median(of) / len(frames) * 1e6 for name, of in times.items()}
    for name, of in unpacking.items():
        median = statistics.median(of)
        print(f"{name} {median / len(frames) * 1e6:9.1f} µs   {median / statistics.median(unpacking['memcpy of a frame']):7.1f} × memcpy")
    for name, median in medians.items():
        print(f"{name:8} {median:9.1f} µs a frame   {median / medians['physinc']:7.1f} × physinc   {found[name]}")


if __name__ == "__main__":
    main()
