"""Who moves a ball: gravity, or a hand or machine that holds it? Motion capture of thrown balls (Qualisys exports).

    python examples/mocap_activity.py FILE... [--law free_fall|auto]

The floor z = 0 is known to be all there is, so what moves otherwise than falling, bouncing or rolling there is active. Labels come
from second differences over 0.1 s alone: a frame flies if its acceleration is within 1.5 m/s² of gravity, is held if it is off by more
than 4 m/s² (both through the whole 0.1 s around it), and counts for neither in between, within 0.15 m of the floor (bounces), or beside
a gap.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import physinc
from physinc.escaping import escape_output
from physinc.qualisys import Recording, read

if TYPE_CHECKING:
    from numpy.typing import NDArray

SPAN = 0.05
"""Second differences reach this far to both sides, s."""
FLIES = 1.5
"""At most so far from gravity, m/s²."""
HELD = 4.0
"""At least so far from gravity, m/s²."""
LOW = 0.15
"""Nearer to the floor nothing is labelled, m."""
GRAVITY = np.array([0.0, 0.0, -9.81])


def labels(t: NDArray[np.float64], p: NDArray[np.float64]) -> NDArray[np.int8]:
    """Of each frame of one trajectory: 1 held, 0 flying, -1 neither."""
    step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    reach = max(round(SPAN / step), 1)
    off = np.full(len(t), np.nan)
    for i in range(reach, len(t) - reach):
        before, after = t[i] - t[i - reach], t[i + reach] - t[i]
        if abs(before - reach * step) < step / 2 and abs(after - reach * step) < step / 2:
            off[i] = np.linalg.norm((p[i + reach] - 2 * p[i] + p[i - reach]) / (reach * step) ** 2 - GRAVITY)
    found = np.full(len(t), -1, np.int8)
    for i in range(len(t)):
        around = slice(max(i - reach, 0), i + reach + 1)
        if np.isfinite(off[around]).all() and p[around, 2].min() > LOW:
            found[i] = 0 if off[around].max() < FLIES else 1 if off[around].min() > HELD else -1
    return found


def confusion(recording: Recording, config: physinc.Config) -> NDArray[np.int64]:
    """Frames by label (rows: flying, held) and by what was told (columns: passive, active)."""
    spans: dict[int | None, list[physinc.Activity]] = {}
    stamps: dict[int | None, list[int]] = {}
    centers: dict[int | None, list[NDArray[np.float64]]] = {}
    for event in physinc.stream(recording.positions(), config=config, positions=True):
        match event:
            case physinc.Activity(final=True):
                spans.setdefault(event.track, []).append(event)
            case physinc.Position():
                stamps.setdefault(event.track, []).append(event.timestamp_ns)
                centers.setdefault(event.track, []).append(event.center)
    table = np.zeros((2, 2), np.int64)
    for track, times in stamps.items():
        stamp = np.array(times)
        active = np.zeros(len(stamp), np.int64)
        for span in spans[track]:
            active[(stamp >= span.start_ns) & (stamp <= span.end_ns)] = span.active
        label = labels(stamp * 1e-9, np.array(centers[track]))
        for row in (0, 1):
            table[row] += np.bincount(active[label == row], minlength=2)
    return table


def main() -> int:
    """Read, stream, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("files", type=Path, nargs="+", help="*.tsv or *.json")
    parser.add_argument("--law", default="free_fall", choices=["free_fall", "auto"])
    options = parser.parse_args()
    escape_output()
    floor = physinc.EnvironmentConfig(plane=(physinc.KnownPlane(name="floor"),))
    assume = physinc.AssumeConfig(scene="known", objects="unknown")
    config = physinc.Config(laws=physinc.LawsConfig(law=options.law), assume=assume, environment=floor)
    print(f"{'':40} passive  active")
    for path in options.files:
        try:
            table = confusion(read(path), config)
        except (OSError, physinc.PhysincError) as error:
            print(error, file=sys.stderr)
            return 1
        for name, row in zip(("flies", "is held"), table, strict=True):
            print(f"{path.name[:30]:30} {name:9} {row[0]:7} {row[1]:7}   {100 * row[1] / max(row.sum(), 1):.1f} % active")
    return 0


if __name__ == "__main__":
    sys.exit(main())
