"""Bounces, floor and gravity from motion capture of thrown balls: Qualisys exports, TSV or JSON.

    python examples/mocap_bounces.py FILE [--radius R] [--mass M] [--touch T]

Markers with a name belong to fixed things and are left out; every unlabelled trajectory is taken for a ball. Millimetres, z up.
"""

from __future__ import annotations

import argparse
import math
import sys
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import physinc
from physinc.escaping import escape_output
from physinc.qualisys import Recording, read

if TYPE_CHECKING:
    from collections.abc import Iterator

GAP = 0.05
"""Frames further apart don't belong to one flight, s."""
LONG = 0.5
"""A shorter flight tells little of gravity, s."""
LEAST = 8
"""Fewer frames are no flight."""
WOBBLE = 0.002
"""How far a marker on a spinning ball strays from the center's flight, m."""


def report(recording: Recording, config: physinc.Config) -> None:
    """Print each bounce as it becomes final, then the surfaces and the size of gravity."""
    surfaces: list[physinc.Surface] = []
    gravity: list[physinc.CameraOrientation] = []
    print("    time    at x       y       z m   speed m/s   restitution   surface")
    for event in physinc.stream(recording.positions(), config=config):
        match event:
            case physinc.Contact(final=True):
                x, y, z = event.center
                restitution = "   ?" if event.restitution is None else f"{event.restitution:.2f}"
                surface = "?" if event.surface is None else event.surface
                speed = math.nan if event.velocity_before is None else math.hypot(*event.velocity_before)
                print(f"{event.time_ns / 1e9:8.3f} {x:7.3f} {y:7.3f} {z:7.3f} {speed:11.2f} {restitution:>13} {surface:>9}")
            case physinc.Surface(final=True, merged_into=None):
                surfaces.append(event)
            case physinc.CameraOrientation(final=True):
                gravity.append(event)
    for found in surfaces:
        tilt = math.nan if found.tilt is None else math.degrees(found.tilt)
        print(f"surface {found.id}: {found.contacts} contacts, {found.offset:.4f} m along its normal, tilted by {tilt:.1f}°")
    if gravity:
        size = math.hypot(*gravity[-1].gravity_in_camera)
        print(f"gravity: {size:.3f} m/s² from {gravity[-1].flights} flights")
    report_free_gravity(recording, config.object)


def flights(recording: Recording, ball: physinc.ObjectConfig) -> Iterator[physinc.FlightFit]:
    """Every flight of at least LONG by itself, as if nothing were known of gravity: cut at gaps, and where Eq. 3 is violated."""
    by_track = sorted(recording.samples, key=lambda sample: (sample.track, sample.frame))
    for _, samples in groupby(by_track, key=lambda sample: sample.track):
        frames, centers = (np.array(column) for column in zip(*((s.frame, s.center) for s in samples), strict=True))
        t = frames / recording.frequency
        for whole in np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > GAP) + 1):
            if len(whole) < LEAST:
                continue
            found = physinc.find_inconsistencies(t[whole], centers[whole], law="free_fall_with_drag", drag=ball, sd=WOBBLE)
            for part in np.split(whole, np.flatnonzero(found.inconsistent)):
                if len(part) >= LEAST and t[part[-1]] - t[part[0]] >= LONG:
                    fit = physinc.fit_flight(t[part], centers[part], "free_fall_with_drag", drag=ball, gravity=None)
                    if fit is not None:
                        yield fit


def report_free_gravity(recording: Recording, ball: physinc.ObjectConfig) -> None:
    """Print the mean size of gravity and its scatter from flight to flight, which shows what the model leaves out; noise alone doesn't."""
    fits = list(flights(recording, ball))
    if not fits:
        return
    sizes = np.array([math.nan if fit.gravity is None else math.hypot(*fit.gravity) for fit in fits])
    weights = np.array([1 / np.trace(fit.covariance[6:, 6:]) for fit in fits])
    mean = np.average(sizes, weights=weights)
    scatter = math.sqrt(np.average((sizes - mean) ** 2, weights=weights))
    residual = math.sqrt(np.mean([fit.residual_rms**2 for fit in fits]))
    print(f"each of {len(fits)} flights by itself: {mean:.3f} m/s², scatter {scatter:.3f}, {1000 * residual:.1f} mm off a flight (rms)")


def main() -> int:
    """Read, stream, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path, help="*.tsv or *.json")
    parser.add_argument("--radius", type=float, default=0.033, help="of the balls, m")
    parser.add_argument("--mass", type=float, default=0.057, help="of a ball, kg")
    parser.add_argument("--touch", type=float, default=0.0045, help="how long a bounce touches, s; soft balls longer than a tennis ball")
    options = parser.parse_args()
    escape_output()
    ball = physinc.ObjectConfig(radius=options.radius, mass=options.mass, contact_duration=options.touch)
    try:
        report(read(options.file), physinc.Config(object=ball))
    except (OSError, physinc.PhysincError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
