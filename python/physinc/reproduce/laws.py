"""The θ that each law would allow: the paper's closing remark."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from physinc.arrays import find_inconsistencies

from .experiment import Experiment, Picture, Section, Table, Task
from .observation import Array, observe
from .style import label, legend_below, png, sheet

FLIGHTS = "passive_flight?throws=6&seed={}"
ROLLS = "roll?seed={}"
QUANTILE = 0.99
LEAST = 12
"""Positions of a track that is looked at."""
FAR_OFF = 1e-12
"""No prediction is given up for an inconsistency: the residuals are what is asked for."""
HORIZONS = ("step", "flight")
LAWS = (
    ("free fall", "-", "#1b4f9c"),
    ("free fall with drag", "--", "#0a6e5f"),
    ("constant velocity", "-.", "#e4572e"),
    ("rolling friction", ":", "#7b3fa0"),
)
"""Name, line, colour."""

Residuals = dict[tuple[str, str], list[float]]
"""Distances from predictions, m, by law and horizon."""


def residuals(seed: int) -> Residuals:
    """Distances of passive objects from their predictions under each law that is about them."""
    found: Residuals = {(name, horizon): [] for name, _, _ in LAWS for horizon in HORIZONS}
    flown = [(trace.t, trace.center) for trace in observe(FLIGHTS.format(seed)).traces(LEAST)]
    rolled = rolling(seed)
    # The rolling friction of one half of the way is that of the other, so that none is fitted to what it is judged by.
    for horizon in HORIZONS:
        for t, center in flown:
            found["free fall", horizon] += _distances(t, center, horizon, "free_fall", None)
            found["free fall with drag", horizon] += _distances(t, center, horizon, "free_fall_with_drag", None)
        for t, center in rolled:
            middle = len(t) // 2
            found["constant velocity", horizon] += _distances(t[middle:], center[middle:], horizon, "free_fall", (0.0, 0.0, 0.0))
            found["rolling friction", horizon] += _distances(
                t[middle:], center[middle:], horizon, _friction(t[:middle], center[:middle]), None
            )
    return found


def rolling(seed: int) -> list[tuple[Array, Array]]:
    """Watch a ball: times and centers from when a ball rolls until it leaves the view or lies still."""
    seen = observe(ROLLS.format(seed))
    parts = []
    for trace in seen.traces(LEAST):
        since = [seen.seconds(roll["time_ns"]) for roll in seen.truth["rolling"]]
        if not since:
            continue
        rolls = trace.t > since[0] + 0.05
        speed = np.linalg.norm(np.gradient(trace.center, trace.t, axis=0), axis=1)
        moving = np.convolve(speed, np.ones(5) / 5, "same") > 0.05
        still = np.flatnonzero(rolls & ~moving)
        end = still[0] if len(still) else len(trace.t)
        chosen = np.flatnonzero(rolls & (np.arange(len(trace.t)) < end - 3))
        if len(chosen) >= 2 * LEAST:
            parts.append((trace.t[chosen], trace.center[chosen]))
    return parts


def _friction(t: Array, center: Array) -> Any:
    """Make a law: slowed evenly along the way, as much as in these positions."""
    way = center[-1] - center[0]
    come = (center - center[0]) @ way / np.linalg.norm(way)
    slowing = max(0.0, -2 * float(np.polyfit(t - t[0], come, 2)[0]))

    def law(_: float, __: Array, velocity: Array) -> Array:
        speed = float(np.linalg.norm(velocity))
        return -velocity * (slowing / speed) if speed > 1e-3 else np.zeros(3)

    return law


def _distances(t: Array, center: Array, horizon: Any, law: Any, gravity: Any) -> list[float]:
    """Distances from predictions, without those that nothing could be predicted of."""
    options = {} if gravity is None else {"gravity": gravity}
    found = find_inconsistencies(t, center, horizon=horizon, law=law, false_alarm=FAR_OFF, **options)
    # A prediction that rests on two positions says more about these than about the law.
    skip = 2 if horizon == "step" else 8
    return [float(d) for d in found.distance[skip:] if np.isfinite(d)]


def tasks(seeds: Sequence[int]) -> list[Task]:
    """One a seed."""
    return [(residuals, (seed,)) for seed in seeds]


def section(seeds: Sequence[int], results: Sequence[Residuals]) -> Section:
    """Distributions and their 99 % points over all seeds."""
    pooled = {key: np.sort([d for result in results for d in result[key]]) * 1e3 for key in results[0]}
    figure, axes = sheet(1, 2, 4.0, sharey=True)
    titles = {"step": "(a) one step ahead, from two positions", "flight": "(b) from all positions so far"}
    rows = []
    for axis, horizon in zip(axes, HORIZONS, strict=True):
        for name, line, color in LAWS:
            distances = pooled[name, horizon]
            if len(distances):
                axis.plot(distances, 100 * np.arange(1, len(distances) + 1) / len(distances), color=color, ls=line, lw=1.8, label=name)
                axis.plot(np.quantile(distances, QUANTILE), 100 * QUANTILE, color=color, marker="o", ms=6)
        axis.axvline(6, color="0.3", ls=":", lw=1.2, label="the paper's θ, 6 mm")
        axis.set_xscale("log")
        axis.set_xticks([0.5, 1, 2, 5, 10, 20], ["0.5", "1", "2", "5", "10", "20"])
        axis.minorticks_off()
        label(axis, "distance from the prediction / mm", "consistent measurements / %", title=titles[horizon])
    legend_below(figure, axes[0], columns=3)
    for name, _, _ in LAWS:
        cells = [f"{np.quantile(d, QUANTILE):.1f} mm" if len(d := pooled[name, horizon]) else "–" for horizon in HORIZONS]
        about = "flying balls" if name.startswith("free") else "rolling balls"
        rows.append([name, about, str(len(pooled[name, "step"])), *cells])
    caption = (
        "How far passive objects are from what each law predicts of them. Dots: the θ at which 99 % of the measurements are consistent. One"
        " step ahead the noise of two positions rules, whatever the law; from the whole history the law's own error shows, and a better law"
        " allows a smaller θ."
    )
    return Section(
        "The θ that each law would allow (sec. 4)",
        "“Accurately modeling friction would for example allow to lower the tolerance threshold”, says the paper: by how much, is plotted"
        f" here. Passive tracks of sim:{FLIGHTS.format('…')} and sim:{ROLLS.format('…')}; the slowing of a rolling ball is taken from the"
        " first half of its way and judged on the second.",
        [Picture("theta_of_laws", "Beside the paper's closing remark: θ of each law", caption, png(figure))],
        [
            Table(
                "θ at 99 % of passive measurements",
                ("law", "of", "measurements", "one step ahead", "from all so far"),
                rows,
                f"Over {len(seeds)} seeds together. The paper set θ to 6 mm for all its experiments.",
            )
        ],
    )


EXPERIMENT = Experiment("laws", ("passive_flight", "roll"), tasks, section)
