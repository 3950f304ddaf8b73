"""Sec. 3.1 (ii), the camera's translation: figures 7 and 8."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from physinc import _physinc as p
from physinc.arrays import fit_flight

from .experiment import Experiment, Picture, Section, Table, Task, found, spread
from .observation import Array, Observation, images, observe
from .style import MEASURED, OURS, PAPER, PREDICTED, TRUE, label, legend_below, picture_of_depth, png, sheet

SCENE = "translating_camera?throws=1&seed={}"
STRUCTURED = "translating_camera?throws=1&structure=both&seed={}"
MOVING: dict[str, Any] = {"assume": {"camera": "moving"}}
BY_PAPER: dict[str, Any] = {**MOVING, "laws": {"method": "paper"}}


@dataclass(frozen=True)
class Path:
    """Where the camera went, by one method, in the frames in which something was tracked."""

    t: Array
    """[N], s."""
    displacement: Array
    """[N, 3], world, m."""
    sd: Array
    """[N, 3], m."""
    true: Array
    """[N, 3], m."""

    def length(self) -> float:
        """From the first of these frames to the last, m."""
        return float(np.linalg.norm(self.displacement[-1] - self.displacement[0])) if len(self.t) else math.nan

    def true_length(self) -> float:
        """Return the same in truth."""
        return float(np.linalg.norm(self.true[-1] - self.true[0])) if len(self.t) else math.nan

    def rms(self, axes: slice) -> float:
        """Of the errors along these axes together, root mean square over the frames, m."""
        return float(np.sqrt(np.mean(np.sum((self.displacement - self.true)[:, axes] ** 2, 1)))) if len(self.t) else math.nan


def path(seen: Observation) -> Path:
    """Read the path off the events."""
    frames = seen.truth["frames"]
    motions = seen.of(p.CameraMotion)
    start = frames[0]["timestamp_ns"]
    return Path(
        np.array([(frames[m.frame]["timestamp_ns"] - start) * 1e-9 for m in motions]),
        np.array([m.displacement for m in motions]).reshape(-1, 3),
        np.sqrt(np.array([np.diag(np.asarray(m.covariance)) for m in motions]).reshape(-1, 3)),
        np.array([frames[m.frame]["camera_displacement"] for m in motions]).reshape(-1, 3),
    )


def estimate(seed: int) -> dict[str, Path]:
    """One scene by all methods."""
    return {
        "paper": path(observe(SCENE.format(seed), BY_PAPER)),
        "ours": path(observe(SCENE.format(seed), MOVING)),
        "structure": path(observe(STRUCTURED.format(seed), MOVING)),
    }


def tasks(seeds: Sequence[int]) -> list[Task]:
    """One a seed."""
    return [(estimate, (seed,)) for seed in seeds]


def section(seeds: Sequence[int], results: Sequence[dict[str, Path]]) -> Section:
    """Figures of the first seed, table over all."""
    count, methods = len(results), ("paper", "ours", "structure")

    def rms(name: str, axes: slice) -> list[str]:
        return [name, "0 mm", "–", *(spread([1e3 * r[m].rms(axes) for r in results], 1, "mm", count) for m in methods)]

    actual = spread([1e3 * r["ours"].true_length() for r in results], 1, "mm", count)
    lengths = [spread([1e3 * r[m].length() for r in results], 1, "mm", count) for m in methods]
    off = [spread([1e3 * (r[m].length() - r[m].true_length()) for r in results], 1, "mm", count) for m in methods]
    table = Table(
        "Camera translation",
        ("quantity", "actual", "paper", "paper's method here", "ours, the ball alone", "ours, floor and wall in view"),
        [
            ["from start to end", f"{actual} (paper: 155 mm)", "165 mm", *lengths],
            ["its error", "0 mm", "10 mm", *off],
            rms("path, to the right (rms)", slice(0, 1)),
            rms("path, away (rms)", slice(1, 2)),
            rms("path, up (rms)", slice(2, 3)),
            rms("path in space (rms)", slice(0, 3)),
        ],
        f"Mean ± standard deviation over {count} seeds of sim:{SCENE.format('…')}; rms over the frames of one flight, then their mean over"
        " the seeds. The camera's velocity in the first frames is taken to be none: no flight tells it.",
    )
    seen = observe(SCENE.format(seeds[0]), MOVING)
    return Section(
        "Camera translation (sec. 3.1, ii)",
        "A hand moves the camera while a ball flies before it, and there is nothing else in view. What the ball does against gravity, the"
        f" camera did. Figures: sim:{seen.scene}.",
        [frames(seen), moved(seen, results[0])],
        [table],
    )


def frames(seen: Observation) -> Picture:
    """Figure 7: four sample frames."""
    depth, _ = images(seen.scene)
    positions = seen.of(p.Position)
    come = {q.frame: float(np.linalg.norm(seen.truth["frames"][q.frame]["camera_displacement"])) for q in positions}
    between = [min(come, key=lambda frame: abs(come[frame] - part * max(come.values()))) for part in (1 / 3, 2 / 3)]
    chosen = [positions[0].frame, *between, positions[-1].frame]
    figure, axes = sheet(1, 4, 1.95, sharey=True)
    for axis, frame in zip(axes, chosen, strict=True):
        picture_of_depth(axis, depth[frame], f"frame {frame}, {1e3 * come[frame]:.0f} mm", near=0.5, far=4)
        axis.set_xticks([0, 300, 600])
    for axis in axes[1:]:
        axis.set_ylabel("row / px")
        axis.yaxis.label.set_visible(False)
    caption = (
        "Four depth frames from a camera that is moved by hand, and how far it had come. The ball is all there is (sand-coloured: no"
        " reading): nothing that structure from motion could hold on to."
    )
    return Picture("figure_07_frames", "Counterpart of figure 7: frames of a moving camera", caption, png(figure))


def moved(seen: Observation, paths: dict[str, Path]) -> Picture:
    """Figure 8: predicted and measured trajectory, and the camera's path between them."""
    trace = max(seen.traces(), key=lambda trace: len(trace.t))
    ours = paths["ours"]
    motions = {m.frame: np.asarray(m.displacement) for m in seen.of(p.CameraMotion)}
    known = [i for i, frame in enumerate(trace.frame) if int(frame) in motions]
    camera = np.array([motions[int(trace.frame[i])] for i in known])
    measured = trace.center[known]
    figure, (left, right) = sheet(1, 2, 4.1)
    left.plot(measured[:, 0], measured[:, 2], **MEASURED, label="measured, in the camera's axes")
    predicted = measured + camera
    flight = found(fit_flight(trace.t[known], predicted, "free_fall_with_drag"))
    fall = np.array([flight.predict(t)[0] for t in np.linspace(trace.t[known[0]], trace.t[known[-1]], 60)])
    left.plot(fall[:, 0], fall[:, 2], **PREDICTED, label="predicted in the world, by gravity")
    left.plot(predicted[:, 0], predicted[:, 2], **OURS, lw=0, label="measured + the camera's path")
    for a, b in list(zip(measured, predicted, strict=True))[::3]:
        left.plot([a[0], b[0]], [a[2], b[2]], color="0.75", lw=0.8, zorder=0)
    left.set_aspect("equal", "datalim")
    label(left, "right / m", "height / m", title="(a) trajectory of the ball")
    for axis, (name, style) in enumerate((("right", "-"), ("away", "--"), ("up", ":"))):
        right.plot(ours.t, 1e3 * ours.true[:, axis], **{**TRUE, "ls": style}, label=f"true, {name}")
        right.plot(
            paths["paper"].t,
            1e3 * paths["paper"].displacement[:, axis],
            **{**PAPER, "ls": style, "lw": 0.8, "ms": 3},
            label=f"paper's method, {name}",
        )
        right.plot(ours.t, 1e3 * ours.displacement[:, axis], **{**OURS, "ls": style, "lw": 0.8, "ms": 3}, label=f"ours, {name}")
        low, high = (1e3 * (ours.displacement + s * ours.sd)[:, axis] for s in (-2, 2))
        right.fill_between(ours.t, low, high, color=OURS["color"], alpha=0.15)
    label(right, "time / s", "camera displacement / mm", title="(b) the camera's path, ours ± 2 σ")
    legend_below(figure, left, right)
    caption = (
        "Measured trajectory and the one that gravity predicts; their difference is the camera's path: from start to end"
        f" {1e3 * ours.length():.1f} mm (true {1e3 * ours.true_length():.1f}; by the paper's method {1e3 * paths['paper'].length():.1f};"
        " the paper measured 165 for 155)."
    )
    return Picture("figure_08_translation", "Counterpart of figure 8: camera translation", caption, png(figure))


EXPERIMENT = Experiment("translation", ("translating_camera",), tasks, section)
