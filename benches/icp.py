"""The motion between two views of one body: physinc beside small_gicp, on the same points.

    python benches/icp.py [--rounds N] [--seed N]

Views are of a car of boxes and of a body of ellipsoids, a frame apart, with a Kinect's noise, as `rust/benches/icp.rs` draws them.
small_gicp is given each pixel's point, the same start (the middles of both views on each other), and one thread. Each of its
registration types is run with the settings that gave it the least error, among those below, on other pairs of the same scene (seed
8000). Its time is that of a frame's work: preprocessing the new view and aligning it; the view before keeps its tree. `align` is
without preprocessing. Ours is run before and after theirs in each round; medians over pairs and rounds. The error of the shift is
the body's middle's, rms.
"""

from __future__ import annotations

import argparse
import itertools
import json
import statistics
import subprocess
import tempfile
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import small_gicp

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[Any]

TYPES = ("ICP", "PLANE_ICP", "GICP", "VGICP")
RESOLUTIONS = (0.004, 0.008)  # m: to which points are thinned
REACHES = (0.02, 0.05)  # m: farthest correspondence
NEIGHBOURS = (10, 20)  # for normals and covariances
FINE = {"rotation_epsilon": 1e-4, "translation_epsilon": 1e-5, "max_iterations": 50}


class Pair(NamedTuple):
    """Two views, the motion between them, and the body's middle in the first."""

    scene: int
    truth: Array
    middle: Array
    source: Array
    target: Array


class Setting(NamedTuple):
    """How small_gicp is run."""

    type: str
    resolution: float
    reach: float
    neighbours: int


def build() -> str:
    """Build ours; its program."""
    command = ["cargo", "bench", "--locked", "--quiet", "--bench", "icp", "--no-run", "--message-format", "json"]
    messages = map(json.loads, subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines())
    return str(next(message["executable"] for message in messages if message.get("executable")))


def bench(program: str, seed: int, dump: Path) -> list[dict[str, Any]]:
    """Run ours; its lines, and the views in `dump`."""
    command = [program, "--seed", str(seed), "--dump", str(dump)]
    lines = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
    return [json.loads(line) for line in lines if line.startswith("{")]


def read(path: Path) -> list[Pair]:
    """Pairs of views."""
    raw, at, pairs = path.read_bytes(), 0, []
    while at < len(raw):
        scene, *sizes = (int(n) for n in np.frombuffer(raw, "<u4", 3, at))
        numbers = np.frombuffer(raw, "<f8", 15, at + 12)
        at += 12 + 15 * 8
        views = []
        for size in sizes:
            views.append(np.frombuffer(raw, "<f4", 3 * size, at).reshape(-1, 3).astype(np.float64))
            at += 12 * size
        pairs.append(Pair(scene, np.vstack([numbers[:12].reshape(3, 4), [0, 0, 0, 1]]), numbers[12:], *views))
    return pairs


def register(pair: Pair, setting: Setting) -> tuple[float, float, float, float]:
    """Shift's and turn's squared error (m², rad²); µs of the frame, and of aligning alone."""
    start = np.eye(4)
    start[:3, 3] = pair.target.mean(0) - pair.source.mean(0)
    target, tree = small_gicp.preprocess_points(pair.target, setting.resolution, setting.neighbours, num_threads=1)
    options = {"init_T_target_source": start, "max_correspondence_distance": setting.reach, "num_threads": 1, **FINE}
    if setting.type == "VGICP":
        voxels = small_gicp.GaussianVoxelMap(2 * setting.resolution)
        voxels.insert(target)
    begin = perf_counter()
    source, _ = small_gicp.preprocess_points(pair.source, setting.resolution, setting.neighbours, num_threads=1)
    middle = perf_counter()
    if setting.type == "VGICP":
        result = small_gicp.align(voxels, source, **options)
    else:
        result = small_gicp.align(target, source, tree, registration_type=setting.type, **options)
    end = perf_counter()
    found = result.T_target_source
    shift = (found - pair.truth) @ [*pair.middle, 1]
    turn = np.arccos(np.clip((np.trace(found[:3, :3].T @ pair.truth[:3, :3]) - 1) / 2, -1, 1))
    return float(shift @ shift), float(turn**2), (end - begin) * 1e6, (end - middle) * 1e6


def summary(rows: list[tuple[float, float, float, float]]) -> tuple[float, float, float, float]:
    """Root mean squares of errors, medians of times."""
    shifts, turns, frames, aligns = zip(*rows, strict=True)
    return statistics.fmean(shifts) ** 0.5, statistics.fmean(turns) ** 0.5, statistics.median(frames), statistics.median(aligns)


def main() -> None:
    """Print error and time of both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seed", type=int, default=7000, help="of the first pair of each scene")
    arguments = parser.parse_args()
    program = build()
    with tempfile.TemporaryDirectory() as folder:
        dump = Path(folder) / "views"
        names = {line["scene"]: line["name"] for line in bench(program, 8000, dump)}
        other = read(dump)
        best = {}
        for scene, kind in itertools.product(names, TYPES):
            pairs = [pair for pair in other if pair.scene == scene][::8]
            settings = [Setting(kind, *rest) for rest in itertools.product(RESOLUTIONS, REACHES, NEIGHBOURS)]
            best[scene, kind] = min(settings, key=lambda setting: summary([register(pair, setting) for pair in pairs])[0])
        ours: list[list[dict[str, Any]]] = []
        theirs: dict[tuple[int, str], list[Any]] = {key: [] for key in best}
        for _ in range(arguments.rounds):
            ours.append(bench(program, arguments.seed, dump))
            for pair in read(dump):
                for kind in TYPES:
                    theirs[pair.scene, kind].append(register(pair, best[pair.scene, kind]))
            ours.append(bench(program, arguments.seed, dump))
    print("| views | method | shift mm | turn ° | frame µs | align µs | × ours |\n|---|---|---|---|---|---|---|")
    for scene, name in names.items():
        lines = [lines[scene] for lines in ours]
        frame, align = (statistics.median(line[key] for line in lines) for key in ("frame_us", "align_us"))
        rows = [("physinc", (lines[0]["shift"], lines[0]["turn"], frame, align))]
        for kind in TYPES:
            s = best[scene, kind]
            label = f"small_gicp {kind}, {s.resolution * 1e3:.0f} mm, {s.reach * 1e3:.0f} mm, {s.neighbours}"
            rows.append((label, summary(theirs[scene, kind])))
        for label, (shift, turn, frame_us, align_us) in rows:
            turn_degrees = np.degrees(turn)
            times = f"{frame_us:.0f} | {align_us:.0f} | {frame_us / frame:.1f}"
            print(f"| {name} | {label} | {shift * 1e3:.2f} | {turn_degrees:.2f} | {times} |")


if __name__ == "__main__":
    main()
