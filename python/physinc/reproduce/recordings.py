"""Real recordings, where there are any: motion capture of thrown balls, 300 Hz, in millimetres."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from physinc import qualisys
from physinc.arrays import fit_flight, fit_scale, split_flights

from .experiment import Experiment, Picture, Section, Table, Task
from .observation import Array
from .style import MEASURED, PREDICTED, TRUE, label, legend_below, png, sheet

GAP = 0.05
"""Frames further apart don't belong to one flight, s."""
LONG = 0.3
"""A shorter flight tells little, s."""
STEEP = 0.9
"""Gravity pulls down: what seems to fall more than 25° off that is held and moved by somebody."""
BESIDE = (Path(__file__).resolve().parents[4], Path(".."))
"""`shared/data` is looked for beside the project, then beside the working directory."""
SHOWN = (0.95, 1.05)
"""Scales in the figure, mm."""


@dataclass(frozen=True)
class Flight:
    """A ball in mid-air, or what passes for it."""

    seconds: float
    """How long."""
    scale: float
    """Metres per millimetre."""
    sd: float
    """Of `scale`."""
    residuals: Array
    """[N], distances from the flight under drag, mm."""


def places() -> list[Path]:
    """Where the recordings may be: in `PHYSINC_DATA`, or, if that isn't set, beside the project or the working directory."""
    told = os.environ.get("PHYSINC_DATA")
    folders = [beside / "shared" / "data" for beside in BESIDE] if told is None else [Path(told)]
    return [path / "jugglebot-mocap" for path in folders]


def folder() -> Path | None:
    """Where the recordings are; `None` where they aren't."""
    return next((path for path in places() if path.is_dir()), None)


def flights(path: Path) -> list[Flight]:
    """All that flies in one recording, as nothing but |a| = g tells it."""
    recording = qualisys.read(path)
    found = []
    by_track = sorted(recording.samples, key=lambda sample: (sample.track, sample.frame))
    for _, samples in groupby(by_track, key=lambda sample: sample.track):
        frames, centers = (np.array(column) for column in zip(*((s.frame, s.center) for s in samples), strict=True))
        t = frames / recording.frequency
        for whole in np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > GAP) + 1):
            for part in split_flights(t[whole], centers[whole]):
                one = _flight(t[whole][part], 1e3 * centers[whole][part])
                if one is not None:
                    found.append(one)
    return found


def _flight(t: Array, mm: Array) -> Flight | None:
    if t[-1] - t[0] < LONG:
        return None
    fit = fit_scale(t, mm)
    flight = fit_flight(t, mm * 1e-3, "free_fall_with_drag", gravity=None)
    if fit is None or flight is None or -fit.gravity_direction[2] < STEEP:
        return None
    return Flight(
        float(t[-1] - t[0]),
        fit.scale,
        fit.sd,
        np.array([1e3 * np.linalg.norm(flight.predict(s)[0] - x * 1e-3) for s, x in zip(t, mm, strict=True)]),
    )


def tasks(_: Sequence[int]) -> list[Task]:
    """One a file."""
    where = folder()
    return [] if where is None else [(_named, (path,)) for path in sorted(where.glob("*.tsv")) + sorted(where.glob("*.json"))]


def _named(path: Path) -> tuple[str, list[Flight]]:
    return path.name, flights(path)


def section(_: Sequence[int], results: Sequence[tuple[str, list[Flight]]]) -> Section:
    """Scales and residuals of all flights."""
    figure, (left, right) = sheet(1, 2, 3.8)
    rows, start = [], 0
    for i, (name, found) in enumerate(results):
        marker: dict[str, Any] = {"color": (MEASURED["color"], PREDICTED["color"], "#0a6e5f")[i % 3], "marker": "os^"[i % 3]}
        scales, sds = np.array([f.scale for f in found]), np.array([f.sd for f in found])
        left.errorbar(start + np.arange(len(found)), 1e3 * scales, 2e3 * sds, ls="", ms=4, capsize=2, lw=1, label=name, **marker)
        start += len(found)
        distances = np.sort(np.concatenate([f.residuals for f in found])) if found else np.array([])
        right.semilogx(
            distances,
            100 * np.arange(1, len(distances) + 1) / max(1, len(distances)),
            color=marker["color"],
            ls=("-", "--", ":")[i % 3],
            lw=1.8,
        )
        if found:
            median, scatter = np.median(scales), 1.4826 * np.median(np.abs(scales - np.median(scales)))
            numbers = (f"{1e3 * median:.4f} mm", f"{1e3 * scatter:.4f} mm", f"{np.quantile(distances, 0.99):.1f} mm")
        else:
            numbers = ("–", "–", "–")
        rows.append([name, str(len(found)), *numbers])
    left.axhline(1, **TRUE, label="true")
    left.set_ylim(*SHOWN)
    beyond = sum(not SHOWN[0] < 1e3 * f.scale < SHOWN[1] for _, found in results for f in found)
    label(left, "flight / number", "a millimetre as fit_scale finds it / mm", title="(a) scale of each flight, ± 2 σ")
    label(right, "distance from the flight / mm", "measurements / %", title="(b) residuals under drag")
    legend_below(figure, left, columns=2)
    caption = (
        "Motion capture in millimetres, taken for a trajectory of unknown unit: how long a unit is, as the fall of each ball tells it, and"
        f" how far the measurements are from flights with drag; {beyond} of another scale are beyond the figure, balls that lie or are"
        " held. Air also carries a ball and is carried along by it, which no law here knows of: 0.5 % of gravity for a tennis ball. σ"
        " knows only white noise; a marker on the skin of a spinning ball is not its center."
    )
    return Section(
        "Real recordings",
        "Thrown balls by optical motion capture at 300 Hz (Jugglebot, MIT licence). Hands and a machine hold them between flights; only"
        " flights of at least 0.3 s are looked at. No constant of physinc was fitted to them.",
        [Picture("recordings_scale", "Real flights: scale from |a| = g, and residuals", caption, png(figure))],
        [
            Table(
                "Flights by motion capture",
                ("recording", "flights", "a millimetre, median", "scatter", "99 % of measurements within"),
                rows,
                "The scatter is 1.4826 × the median absolute deviation. Drag is found along with the scale.",
            )
        ],
    )


def missing() -> str | None:
    """Say what is to be done to have them."""
    if folder() is not None:
        return None
    return f"no real recordings at {' or '.join(map(str, places()))}; PHYSINC_DATA may name the folder that jugglebot-mocap is in"


EXPERIMENT = Experiment("recordings", (), tasks, section, missing)
