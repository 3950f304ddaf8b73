"""Trajectories from Qualisys motion capture: exports as TSV or JSON.

Markers with a name belong to fixed things and are left out; every unlabelled trajectory is one of its own. Millimetres, z up.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from ._physinc import Position
from .errors import RecordingError


class Sample(NamedTuple):
    """One ball in one frame."""

    frame: int
    track: int
    center: tuple[float, float, float]  # m, world


class Recording(NamedTuple):
    """The unlabelled trajectories of one export."""

    frequency: float  # Hz
    samples: list[Sample]  # by frame

    def positions(self) -> Iterator[list[Position]]:
        """All balls of a frame, stamped frame / frequency."""
        for frame, balls in groupby(self.samples, key=lambda sample: sample.frame):
            stamp = round(frame * 1e9 / self.frequency)
            yield [Position(stamp, ball.center, track=ball.track) for ball in balls]


def read_tsv(path: Path) -> Recording:
    """Header lines `KEY value…` up to the one that begins with `Frame`, then a row a frame; 0 0 0 is missing."""
    header: dict[str, list[str]] = {}
    samples = []
    with path.open(encoding="utf-8-sig") as lines:
        for line in lines:
            key, *fields = line.rstrip("\r\n").split("\t")
            if key == "Frame":
                break
            header[key] = fields
        try:
            frequency, count = float(header["FREQUENCY"][0]), int(header["NO_OF_MARKERS"][0])
            names = header["MARKER_NAMES"]
        except (KeyError, IndexError, ValueError) as error:
            raise RecordingError(f"{path}: not a Qualisys TSV, its header lacks {error}") from None
        names += [""] * (count - len(names))
        unlabelled = [column for column in range(count) if not names[column].strip()]
        for number, line in enumerate(lines, len(header) + 2):
            fields = line.split("\t")
            try:
                frame = int(fields[0])
                for column in unlabelled:
                    x, y, z = (float(field) for field in fields[2 + 3 * column : 5 + 3 * column])
                    if (x, y, z) != (0.0, 0.0, 0.0):
                        samples.append(Sample(frame, column + 1, (x / 1000, y / 1000, z / 1000)))
            except ValueError:
                raise RecordingError(f"{path}:{number}: expected frame, time and {count} triples") from None
    return Recording(frequency, samples)


def read_json(path: Path) -> Recording:
    """`Markers[].Parts[]`, each with a `Range` of frames and `Values` [x, y, z, residual]; a marker is one ball's trajectory."""
    try:
        export = json.loads(path.read_text(encoding="utf-8"))
        frequency = float(export["Timebase"]["Frequency"])
        trajectories = [
            [
                Sample(frame, track, (x / 1000, y / 1000, z / 1000))
                for part in marker["Parts"]
                for frame, (x, y, z, *_residual) in enumerate(part["Values"], part["Range"]["Start"])
            ]
            for track, marker in enumerate(export["Markers"], 1)
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{path}: not a Qualisys JSON export: {error!r}") from None
    return Recording(frequency, list(heapq.merge(*trajectories, key=lambda sample: sample.frame)))


def read(path: Path) -> Recording:
    """By the file's ending."""
    return read_json(path) if path.suffix.lower() == ".json" else read_tsv(path)
