"""Sec. 3.3, active and passive objects: figures 12, 13 and 14."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from physinc import _physinc as p
from physinc.arrays import find_inconsistencies

from .experiment import Experiment, Picture, Section, Table, Task, spread
from .observation import Array, Observation, Trace, images, observe
from .style import MEASURED, OURS, PREDICTED, empty_sheet, label, legend_below, picture_of_depth, png

THETA = 0.006
"""The paper's, m."""
NEAR_A_CHANGE = 6
"""Frames on either side of a change of activity that are left out of the table."""
GROUND = {"plane": [{"name": "ground", "normal": [0.0, 0.0, 1.0], "offset": 0.0}]}


@dataclass(frozen=True)
class Thing:
    """What one figure is about."""

    figure: int
    name: str
    scene: str
    config: dict[str, Any]
    gravity: tuple[float, float, float]
    """Of Eq. 5: none on a horizontal plane, where the paper assumes constant velocity."""


UNKNOWN = {"assume": {"objects": "unknown"}}
ROBOT = Thing(12, "flying robot", "flying_robot?seed={}", {**UNKNOWN, "object": {"shape": "any"}, "environment": GROUND}, (0.0, 0.0, -9.81))
BALL = Thing(13, "tennis ball", "passive_flight?throws=1&seed={}", UNKNOWN, (0.0, 0.0, -9.81))
CAR = Thing(
    14,
    "toy car",
    "toy_car?seed={}",
    {**UNKNOWN, "object": {"shape": "any"}, "laws": {"law": "auto"}, "environment": GROUND},
    (0.0, 0.0, 0.0),
)
THINGS = (ROBOT, BALL, CAR)


@dataclass(frozen=True)
class Judged:
    """Frames of a track: whether the object was active, and what was said."""

    active: Array
    """[N], true activity, of 0 or 1."""
    clear: Array
    """[N], no change of it is near, of 0 or 1."""
    ours: Array
    """[N], as the events say; NaN where they say nothing."""
    paper: Array
    """[N], moving average of the residual beyond θ."""


def observed(thing: Thing, seed: int) -> tuple[Observation, Trace]:
    """Watch the thing; its longest track."""
    seen = observe(thing.scene.format(seed), thing.config)
    return seen, max(seen.traces(), key=lambda trace: len(trace.t))


def said(seen: Observation, trace: Trace) -> list[p.Activity]:
    """Tell what was said of the activity of a track."""
    return [activity for activity in seen.of(p.Activity) if activity.track == trace.track]


def truly_active(seen: Observation, trace: Trace) -> Array:
    """Whether the object had a force of its own, frame by frame."""
    frames = seen.truth["frames"]

    def nearest(frame: int, center: Array) -> float:
        things = [*frames[frame]["balls"], *frames[frame].get("objects", ())]
        return float(min(things, key=lambda thing: float(np.linalg.norm(np.asarray(thing["center"]) - center)))["active"])

    return np.array([nearest(int(frame), center) for frame, center in zip(trace.frame, trace.center, strict=True)])


def judge(thing: Thing, seed: int) -> Judged:
    """Hold what was said of a thing against what is true."""
    seen, trace = observed(thing, seed)
    active = truly_active(seen, trace)
    changes = np.flatnonzero(np.diff(active)) + 0.5
    index = np.arange(len(active))
    clear = np.array([float(not len(changes) or np.min(np.abs(changes - i)) > NEAR_A_CHANGE) for i in index])
    ours = np.full(len(active), np.nan)
    for activity in said(seen, trace):
        inside = (trace.t >= seen.seconds(activity.start_ns) - 1e-6) & (trace.t <= seen.seconds(activity.end_ns) + 1e-6)
        ours[inside] = float(activity.active)
    found = find_inconsistencies(trace.t, trace.center, method="paper", gravity=thing.gravity, theta=THETA)
    return Judged(active, clear, ours, (np.nan_to_num(found.moving_average) > THETA).astype(float))


def tasks(seeds: Sequence[int]) -> list[Task]:
    """Every thing for every seed."""
    return [(judge, (thing, seed)) for thing in THINGS for seed in seeds]


def section(seeds: Sequence[int], results: Sequence[Judged]) -> Section:
    """Figures of the first seed, table over all."""
    count = len(seeds)
    of = {thing.name: results[i * count : (i + 1) * count] for i, thing in enumerate(THINGS)}

    def row(name: str, what: str, published: str, active: bool) -> list[str]:
        def part(judged: Judged, said_active: Array) -> float:
            chosen = (judged.active == active) & (judged.clear > 0) & np.isfinite(said_active)
            return 100 * float(np.mean(said_active[chosen])) if chosen.any() else np.nan

        papers, ours = ([part(j, getattr(j, method)) for j in of[name]] for method in ("paper", "ours"))
        return [f"{name}, {what}", "100 %" if active else "0 %", published, spread(papers, 1, "%", count), spread(ours, 1, "%", count)]

    table = Table(
        "Frames said to be active",
        ("of", "actual", "paper", "paper's method here", "ours"),
        [
            row("flying robot", "flying", "“at all time instances”", True),
            row("tennis ball", "flying", "“very consistent”", False),
            row("toy car", "straight", "“match well”", False),
            row("toy car", "turning", "“mostly detected”", True),
        ],
        f"Mean ± standard deviation over {count} seeds; frames within {NEAR_A_CHANGE} of a change are left out. By the paper's method: the"
        " moving average of the distance from Eq. 5's prediction exceeds 6 mm.",
    )
    return Section(
        "Active and passive objects (sec. 3.3)",
        "Objects of any shape move through a known scene before a static camera. What is inconsistent with physics where nothing could have"
        " touched it has a force of its own: it is active. The car's law is constant velocity on the horizontal plane.",
        [drawn(thing, seeds[0]) for thing in THINGS],
        [table],
    )


def drawn(thing: Thing, seed: int) -> Picture:
    """Figures 12, 13 and 14: an object, its trajectory, its inconsistencies."""
    seen, trace = observed(thing, seed)
    depth, camera = images(seen.scene)
    figure = empty_sheet(4.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1, 1.5))
    left, middle, right = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[:, 1])
    half = len(trace.t) // 2
    frame = depth[int(trace.frame[half])]
    picture_of_depth(left, frame, "(a) depth frame", near=0.8, far=3.5)
    pixels = np.stack(
        [trace.in_camera[:, i] / trace.in_camera[:, 2] * camera[f] + camera[c] for i, f, c in ((0, "fx", "cx"), (1, "fy", "cy"))]
    )
    left.plot(*pixels, color=MEASURED["color"], lw=1.2)
    left.plot(*pixels[:, half], **{**PREDICTED, "ls": ""}, marker="+", ms=12, mew=1.8)
    on_floor = thing is CAR
    across, x = (trace.center[:, 1], "right / m") if on_floor else (trace.center[:, 2], "right / m")
    middle.plot(trace.center[:, 0], across, **{**MEASURED, "ms": 3, "lw": 0.6})
    middle.set_aspect("equal", "datalim")
    label(middle, x, "away / m" if on_floor else "height / m", title="(b) trajectory" + (", from above" if on_floor else ""))
    _residuals(right, thing, seen, trace)
    legend_below(figure, right, columns=3)
    active = said(seen, trace)
    share = sum(a.end_ns - a.start_ns for a in active if a.active) / max(1, sum(a.end_ns - a.start_ns for a in active))
    caption = (
        f"A {thing.name} (a), its observed trajectory (b), and its distance from the prediction of"
        f" {'constant velocity' if on_floor else 'free fall'} by Eq. 5 (c), with the paper's θ and the moving average; shaded: said to be"
        f" active by the sequential test, {100 * share:.0f} % of its time. sim:{seen.scene}."
    )
    return Picture(
        f"figure_{thing.figure}_{thing.name.replace(' ', '_')}",
        f"Counterpart of figure {thing.figure}: a {thing.name}",
        caption,
        png(figure),
    )


def _residuals(axes: Axes, thing: Thing, seen: Observation, trace: Trace) -> None:
    found = find_inconsistencies(trace.t, trace.center, method="paper", gravity=thing.gravity, theta=THETA)
    axes.plot(trace.t, 1e3 * found.distance, **{**MEASURED, "ms": 3, "lw": 0.6}, label="distance from prediction")
    axes.plot(trace.t, 1e3 * found.moving_average, color=PREDICTED["color"], lw=1.8, label="moving average")
    axes.axhline(1e3 * THETA, color="0.2", ls=":", lw=1.5, label="θ, 6 mm")
    named = False
    for activity in said(seen, trace):
        if activity.active:
            start, end = seen.seconds(activity.start_ns), seen.seconds(activity.end_ns)
            axes.axvspan(start, end, color=OURS["color"], alpha=0.18, lw=0, label=None if named else "said to be active")
            named = True
    changes = np.flatnonzero(np.diff(truly_active(seen, trace)))
    for i, change in enumerate(changes):
        axes.axvline(trace.t[change], color="0.0", lw=1.0, label="true change" if i == 0 else None)
    axes.set_ylim(0, max(20.0, 1.1e3 * float(np.nanmax(found.moving_average))))
    label(axes, "time / s", "inconsistency / mm", title="(c) inconsistencies")


EXPERIMENT = Experiment("activity", ("flying_robot", "toy_car", "passive_flight"), tasks, section)
