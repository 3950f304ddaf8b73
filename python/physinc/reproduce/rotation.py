"""Sec. 3.1 (i), the camera's rotation: figures 5 and 6."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.transforms import Affine2D

from physinc import _physinc as p
from physinc.arrays import accelerations, fit_flight

from .experiment import Experiment, Picture, Section, Table, Task, found, spread
from .observation import PAPER as BY_PAPER
from .observation import Array, Observation, images, observe
from .style import MEASURED, OURS, PAPER, TRUE, label, legend_below, picture_of_depth, png, sheet

SCENE = "rotated_camera?seed={}"
FRAMES = "room?roll_deg=18&tilt_deg=0&pose=0&throws=1&seed={}"
"""What figure 5 shows: a scene with something that stands level."""
ACTUAL = 18.0
"""The camera's roll, °."""


@dataclass(frozen=True)
class Estimate:
    """Roll (rad) and size of gravity (m/s²) by one method, and the angle of gravity's direction from the true one (rad)."""

    roll: float
    size: float
    off: float


def of(gravity: Array, truth: Array) -> Estimate:
    """Read the estimate off a gravity vector in the camera frame."""
    size = float(np.linalg.norm(gravity))
    off = math.acos(min(1.0, float(gravity @ truth) / size / float(np.linalg.norm(truth))))
    return Estimate(math.atan2(gravity[0], gravity[1]), size, off)


def estimate(seed: int) -> dict[str, Estimate]:
    """One flight and all flights of a scene, by both methods."""
    told = {}
    for method, config in (("paper", BY_PAPER), ("ours", None)):
        seen = observe(SCENE.format(seed), config)
        truth = np.array(seen.truth["gravity_in_camera"])
        orientations = seen.of(p.CameraOrientation)
        told[f"{method}, one"] = of(np.asarray(orientations[0].gravity_in_camera), truth)
        told[f"{method}, all"] = of(np.asarray(orientations[-1].gravity_in_camera), truth)
    return told


def frame_wise(t: Array, positions: Array) -> Array:
    """Accelerations by Eq. 4, without the first two that have none."""
    return accelerations(t, positions)[2:]


def tasks(seeds: Sequence[int]) -> list[Task]:
    """One a seed."""
    return [(estimate, (seed,)) for seed in seeds]


def section(seeds: Sequence[int], results: Sequence[dict[str, Estimate]]) -> Section:
    """Figures of the first seed, table over all."""
    seen = observe(SCENE.format(seeds[0]))
    count = len(results)

    def column(method: str, field: str, scale: float, digits: int, unit: str) -> str:
        return spread([scale * getattr(result[method], field) for result in results], digits, unit, count)

    def row(name: str, actual: str, published: str, *, flights: str, field: str, scale: float, unit: str) -> list[str]:
        return [name, actual, published, *(column(f"{method}, {flights}", field, scale, 2, unit) for method in ("paper", "ours"))]

    degrees = 180 / math.pi
    rows = [
        row("roll, one flight", f"{ACTUAL:.0f}°", "18°", flights="one", field="roll", scale=degrees, unit="°"),
        row("roll, six flights", f"{ACTUAL:.0f}°", "–", flights="all", field="roll", scale=degrees, unit="°"),
        row("size of acceleration, one flight", "9.81 m/s²", "9.72 m/s²", flights="one", field="size", scale=1, unit="m/s²"),
        row("size of acceleration, six flights", "9.81 m/s²", "–", flights="all", field="size", scale=1, unit="m/s²"),
        row("gravity's direction off, one flight", "0°", "–", flights="one", field="off", scale=degrees, unit="°"),
        row("gravity's direction off, six flights", "0°", "–", flights="all", field="off", scale=degrees, unit="°"),
    ]
    caption = (
        f"Mean ± standard deviation over {count} seeds of sim:{SCENE.format('…')}. By the paper's method: the mean of the frame-wise"
        " accelerations of Eq. 4, of which only each flight's ends count; ours: least squares with drag over the whole flights. Heading"
        " about gravity is never known."
    )
    return Section(
        "Camera rotation (sec. 3.1, i)",
        "A camera that is rolled by 18° about its axis sees a ball fly. Gravity is the only force, so the direction in which the ball is"
        f" accelerated is down. Figures: sim:{seen.scene} and sim:{FRAMES.format(seeds[0])}.",
        [frames(seeds[0]), accelerated(seen)],
        [Table("Camera orientation", ("quantity", "actual", "paper", "paper's method here", "ours"), rows, caption)],
    )


def frames(seed: int) -> Picture:
    """Figure 5: two successive frames before and after de-rotation by the estimated roll."""
    scene = FRAMES.format(seed)
    seen = observe(scene)
    depth, camera = images(scene)
    roll = seen.of(p.CameraOrientation)[-1].roll
    shown = [(np.asarray(q.center_in_camera), q.frame) for q in seen.of(p.Position) if q.center_in_camera is not None]
    # Where the ball is in the middle, and so not cropped away.
    start = min(shown, key=lambda at: float(np.hypot(*at[0][:2]) / at[0][2]))[1]
    figure, axes = sheet(2, 2, 5.6)
    middle = camera["cx"], camera["cy"]
    # Turned back about the principal point; cropped to what every pixel is known of.
    turn = Affine2D().rotate_around(*middle, roll)
    half_height = 1 / max(
        (abs(math.sin(roll)) * 4 / 3 + abs(math.cos(roll))) / (middle[1] + 0.5),
        (abs(math.cos(roll)) * 4 / 3 + abs(math.sin(roll))) / (middle[0] + 0.5),
    )
    for column, index in enumerate((start, start + 1)):
        for row, name in enumerate(("as seen", f"turned by {math.degrees(roll):.1f}° and cropped")):
            axis = axes[row, column]
            image = picture_of_depth(axis, depth[index], f"({'ab'[row]}) frame {index}, {name}", near=0.3, far=4.0)
            if row:
                image.set_transform(turn + axis.transData)
                axis.set_xlim(middle[0] - half_height * 4 / 3, middle[0] + half_height * 4 / 3)
                axis.set_ylim(middle[1] + half_height, middle[1] - half_height)
    caption = (
        f"Two successive depth frames as the rolled camera saw them, and turned back by the roll that the ball's flights told"
        f" ({math.degrees(roll):.2f}°, true {ACTUAL:.0f}°): the edge between floor and wall lies level. Sand-coloured: no reading."
    )
    return Picture("figure_05_derotation", "Counterpart of figure 5: frames before and after de-rotation", caption, png(figure))


def accelerated(seen: Observation) -> Picture:
    """Figure 6: a trajectory and its frame-wise accelerations."""
    trace = max(seen.traces(), key=lambda trace: len(trace.t))
    each = frame_wise(trace.t, trace.in_camera)
    mean, truth = each.mean(0), np.array(seen.truth["gravity_in_camera"])
    flight = found(fit_flight(trace.t, trace.in_camera, "free_fall_with_drag", gravity=None))
    gravity = np.asarray(flight.gravity)
    figure, (left, right) = sheet(1, 2, 4.1)
    here = trace.in_camera[1:-1]
    arrows = {"angles": "xy", "scale_units": "xy", "scale": 60.0, "width": 0.006}
    left.plot(trace.in_camera[:, 0], trace.in_camera[:, 1], **MEASURED, label="measured center T")
    left.quiver(here[:, 0], here[:, 1], each[:, 0], each[:, 1], color="0.6", **arrows, label="frame-wise acceleration â (Eq. 4)")
    middle = trace.in_camera.mean(0)[:2] + np.array([0.12, 0])
    for vector, style, name in ((mean, PAPER, "their mean, the paper's"), (gravity, OURS, "ours"), (truth, TRUE, "true gravity")):
        left.quiver(*middle, *vector[:2], color=style["color"], zorder=3, **{**arrows, "scale": 30.0}, label=name)
        middle += np.array([0.06, 0])
    left.set_aspect("equal", "datalim")
    left.invert_yaxis()
    label(left, "right / m", "down / m", title="(a) trajectory in the camera")
    rolls = np.degrees(np.arctan2(each[:, 0], each[:, 1]))
    right.plot(trace.t[2:] - trace.t[0], rolls, color="0.6", marker="o", ms=3.5, lw=0.8)
    for vector, style, name in ((mean, PAPER, "--"), (gravity, OURS, "-"), (truth, TRUE, ":")):
        right.axhline(math.degrees(math.atan2(vector[0], vector[1])), color=style["color"], ls=name, lw=2.0)
    label(right, "time / s", "roll / °", title="(b) roll by each acceleration")
    legend_below(figure, left, columns=3)
    caption = (
        f"Measured trajectory of the ball and its frame-wise acceleration; arrows to scale, the mean ones twice as long. |â| on average:"
        f" {np.linalg.norm(mean):.2f} m/s² (paper's method; published 9.72), {np.linalg.norm(gravity):.3f} m/s² (ours), true"
        f" {np.linalg.norm(truth):.2f}. (b) shows how little a single frame tells, and what becomes of all of them."
    )
    return Picture("figure_06_acceleration", "Counterpart of figure 6: trajectory and frame-wise acceleration", caption, png(figure))


EXPERIMENT = Experiment("rotation", ("rotated_camera", "room"), tasks, section)
