"""Figures 3, 4, 9, 10 and 11."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from physinc import _physinc as p
from physinc._physinc import PAPER_SIDE as SIDE
from physinc.arrays import fit_flight, fit_sphere

from .experiment import Picture, found
from .observation import Array, Observation, Trace, deproject, images, observe
from .style import MEASURED, OURS, PAPER, PREDICTED, TRUE, empty_sheet, label, legend_below, picture_of_depth, png, sheet

RADIUS = 0.033


def bounces(seen: Observation) -> list[tuple[Trace, p.Contact, int]]:
    """Contacts with their track, and how many of its positions come before; those with enough on either side."""
    traces = {trace.track: trace for trace in seen.traces()}
    enough = []
    for contact in seen.of(p.Contact):
        if contact.track in traces:
            trace = traces[contact.track]
            before = int(np.searchsorted(trace.t, seen.seconds(contact.time_ns)))
            if before >= SIDE and len(trace.t) - before >= SIDE:
                enough.append((trace, contact, before))
    return enough


def along(trace: Trace) -> Array:
    """Return the unit vector of the horizontal way of a track."""
    way = (trace.center[-1] - trace.center[0]) * [1.0, 1.0, 0.0]
    return np.asarray(way / np.linalg.norm(way))


def inconsistency(seen: Observation) -> Picture:
    """Figure 3: a bouncing ball, and its prediction by the initial velocity."""
    # The first bounce of its track, seen for long before.
    trace, contact, before = max((b for b in bounces(seen)), key=lambda b: b[2] if b[1].time_ns == _first(seen, b[0]) else 0)
    way, start, n = along(trace), trace.center[0], before - 2
    flight = found(fit_flight(trace.t[:n], trace.center[:n], "free_fall_with_drag", covariance=trace.covariance[:n]))
    end = min(len(trace.t), before + 14)
    times = np.linspace(trace.t[0], trace.t[before] + 0.1, 80)
    path = np.array([flight.predict(t)[0] for t in times])
    figure, (left, right) = sheet(1, 2, 3.9, width_ratios=(1.35, 1))
    left.axhline(0, color="0.55", lw=5, alpha=0.5, label="ground or box, which it doesn't know")
    if contact.point is not None and contact.point[2] > 0.04:
        left.axhline(contact.point[2], color="0.55", lw=5, alpha=0.5)
    left.plot((path - start) @ way, path[:, 2], **PREDICTED, label="predicted from the flight so far")
    left.plot((trace.center[:end] - start) @ way, trace.center[:end, 2], **MEASURED, label="measured center")
    label(left, "way along the throw / m", "height / m", title="(a) trajectory")
    left.set_aspect("equal", "datalim")
    ahead = np.arange(n, min(end, before + 5))
    distances = [float(np.linalg.norm(flight.predict(trace.t[i])[0] - trace.center[i])) * 1e3 for i in ahead]
    right.semilogy(trace.t[ahead] - seen.seconds(contact.time_ns), distances, **{**MEASURED, "lw": 0.8}, label="measured − predicted")
    right.axhline(6, color="0.3", ls=":", lw=1.5, label="the paper's θ, 6 mm")
    right.axvline(0, **TRUE, label="contact, as found")
    label(right, "time from contact / s", "distance / mm", title="(b) inconsistency")
    legend_below(figure, left, right)
    caption = (
        "Measured trajectory of a bouncing ball and its prediction by the velocity before. They part where the ball touches a surface that"
        " was unknown before; the contact lies between two frames."
    )
    return Picture("figure_03_inconsistency", "Counterpart of figure 3: an inconsistency", caption, png(figure))


def _first(seen: Observation, trace: Trace) -> int:
    return min(c.time_ns for c in seen.of(p.Contact) if c.track == trace.track)


def sphere(scene: str) -> Picture:
    """Figure 4: a sphere fitted to its points, and the points of the scene left out."""
    seen = observe(scene)
    depth, camera = images(scene)
    middle = [q for q in seen.of(p.Position) if q.points is not None and q.center_in_camera is not None]
    position = max(middle, key=lambda q: q.points or 0)
    center = np.asarray(position.center_in_camera)
    cloud = deproject(depth[position.frame], camera)
    u, v = (center[i] / center[2] * camera[f] + camera[c] for i, f, c in ((0, "fx", "cx"), (1, "fy", "cy")))
    size = camera["fx"] * RADIUS / center[2]
    rows, columns = np.indices(depth.shape[1:])
    near = np.isfinite(cloud[..., 2]) & (np.hypot(columns - u, rows - v) < 1.4 * size)
    ball = near & (np.abs(cloud[..., 2] - center[2]) < 0.06)
    points = cloud[ball]
    fit = found(fit_sphere(points, RADIUS))
    figure = empty_sheet(3.9)
    left = figure.add_subplot(1, 2, 1)
    picture_of_depth(
        left, depth[position.frame], "(a) depth image, in part", near=float(center[2]) - 0.2, far=float(np.nanmax(depth[position.frame]))
    )
    angle = np.linspace(0, 2 * math.pi, 100)
    left.plot(u + size * np.cos(angle), v + size * np.sin(angle), color=PREDICTED["color"], lw=1.8, label="fitted sphere")
    left.set_xlim(u - 5 * size, u + 5 * size)
    left.set_ylim(v + 5 * size, v - 5 * size)
    axes: Any = figure.add_subplot(1, 2, 2, projection="3d")
    others = cloud[near & ~ball]
    mm = 1e3 * (points - fit.center)
    axes.scatter(mm[:, 0], mm[:, 2], -mm[:, 1], s=7, color=MEASURED["color"], label=f"{len(points)} points of the ball")
    longitude, latitude = np.meshgrid(np.linspace(0, 2 * math.pi, 25), np.linspace(0, math.pi, 13))
    r = 1e3 * fit.radius
    axes.plot_wireframe(
        r * np.cos(longitude) * np.sin(latitude),
        r * np.sin(longitude) * np.sin(latitude),
        r * np.cos(latitude),
        color=PREDICTED["color"],
        lw=0.6,
        alpha=0.7,
        label=f"sphere of {r:.0f} mm",
    )
    axes.view_init(elev=18, azim=-62)
    axes.set_box_aspect((1, 1, 1))
    label(axes, "right / mm", "forward / mm", "up / mm", title="(b) its points and the sphere")
    axes.set(xlim=(-36, 36), ylim=(-36, 36), zlim=(-36, 36), xticks=(-30, 0, 30), yticks=(-30, 0, 30), zticks=(-30, 0, 30))
    legend_below(figure, left, axes)
    caption = (
        f"The ball's center by least squares of a sphere of known radius: {fit.inliers} points, {1e3 * fit.residual_rms:.1f} mm rms from"
        f" it, at a distance of {center[2]:.2f} m. {len(others)} readings next to it belong to the known scene and are left out"
        " (sand-coloured: no reading, the ball's shadow)."
    )
    return Picture("figure_04_sphere", "Counterpart of figure 4: a sphere fitted to its points", caption, png(figure))


def _box(seen: Observation) -> tuple[Array, float]:
    """Corners [4, 2] of the true box from above, and its height."""
    faces = {face["name"]: face for face in seen.truth["surfaces"]}

    def corner(a: str, b: str) -> Array:
        pair = [faces[f"box {name}"] for name in (a, b)]
        return np.linalg.solve([face["normal"][:2] for face in pair], [face["offset"] for face in pair])

    corners = np.array([corner(*pair) for pair in (("left", "front"), ("right", "front"), ("right", "back"), ("left", "back"))])
    return corners, float(faces["box top"]["offset"])


def _edges(seen: Observation) -> Array:
    """Edges [12, 2, 3] of the true box."""
    corners, height = _box(seen)
    low, high = (np.column_stack([corners, np.full(4, z)]) for z in (0.0, height))
    rims = [(rim[i], rim[(i + 1) % 4]) for rim in (low, high) for i in range(4)]
    return np.array([*rims, *zip(low, high, strict=True)])


def blank(seen: Observation) -> Picture:
    """Figure 9: the scene, and the blank depth image of it."""
    depth, camera = images(seen.scene.replace("throws=12", "throws=1"))
    pose = np.array(seen.truth["world_from_camera"])
    figure, (left, right) = sheet(1, 2, 3.1)

    def draw(points: Array, **style: Any) -> None:
        q = (points - pose[:3, 3]) @ pose[:3, :3]
        q = q[q[:, 2] > 0.2]
        left.plot(q[:, 0] / q[:, 2] * camera["fx"] + camera["cx"], q[:, 1] / q[:, 2] * camera["fy"] + camera["cy"], **style)

    for x in np.arange(-3, 3.1, 0.25):
        draw(np.array([[x, y, 0.0] for y in np.linspace(0.5, 6, 40)]), color="0.75", lw=0.7)
    for y in np.arange(0.5, 6.1, 0.25):
        draw(np.array([[x, y, 0.0] for x in np.linspace(-3, 3, 40)]), color="0.75", lw=0.7)
    for edge in _edges(seen):
        draw(edge, color=OURS["color"], lw=1.6)
    left.set_xlim(-0.5, depth.shape[2] - 0.5)
    left.set_ylim(depth.shape[1] - 0.5, -0.5)
    left.set_aspect("equal")
    left.grid(visible=False)
    label(left, "column / px", "row / px", title="(a) the scene, drawn from its truth")
    picture_of_depth(right, depth[5], "(b) its depth image", near=0.5, far=4)
    readings = int(np.isfinite(depth[5]).sum())
    right.text(0.5, 0.5, f"{readings} of {depth[5].size:,} pixels\nhave a reading", ha="center", va="center", transform=right.transAxes)
    caption = "The ground (lines, 25 cm apart) is seen too flatly, and the box is of glass: the depth image of the scene is totally blank."
    return Picture("figure_09_blank", "Counterpart of figure 9: a scene that depth cameras can't see", caption, png(figure))


def _patch(contact: p.Contact, *, paper: bool) -> Array | None:
    """Corners [4, 3] of a small square at a contact: along the motion (the paper's) or across the normal (ours)."""
    if contact.point is None or contact.direction is None or contact.normal is None:
        return None
    first = np.asarray(contact.direction)
    if not paper:
        first = first - contact.normal * (first @ contact.normal)
        first /= np.linalg.norm(first)
    second = np.cross([0.0, 0.0, 1.0] if paper else contact.normal, first)
    second /= np.linalg.norm(second)
    return np.array([contact.point + 0.035 * (a * first + b * second) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


def reconstruction(paper: Observation, ours: Observation) -> Picture:
    """Figure 10: the environment through the detected interactions, in perspective and from above."""
    figure = empty_sheet(5.9)
    grid = figure.add_gridspec(2, 2, height_ratios=(1, 1.15))
    corners, _ = _box(ours)
    for column, (name, seen) in enumerate((("paper's method", paper), ("ours", ours))):
        patches = [q for c in seen.of(p.Contact) if (q := _patch(c, paper=column == 0)) is not None]
        surfaces = [s for s in seen.of(p.Surface) if s.merged_into is None and s.outline is not None and len(s.outline) > 2]
        axes: Any = figure.add_axes((0.01 + 0.49 * column, 0.53, 0.43, 0.42), projection="3d")
        axes.add_collection3d(Poly3DCollection(patches, facecolor=MEASURED["color"], edgecolor="0.2", lw=0.4, alpha=0.9))
        axes.add_collection3d(Poly3DCollection([s.outline for s in surfaces], facecolor=PREDICTED["color"], alpha=0.25))
        axes.add_collection3d(Line3DCollection(_edges(seen), color="0.0", lw=1.0))
        axes.set(xlim=(-0.7, 0.8), ylim=(1.2, 2.4), zlim=(-0.02, 0.22))
        axes.set_box_aspect((1.5, 1.2, 0.5), zoom=1.12)
        axes.view_init(elev=17, azim=-70)
        axes.set(xticks=[-0.5, 0.0, 0.5], yticks=[1.4, 1.8, 2.2], zticks=[0.0, 0.1, 0.2])
        label(axes, "x / m", "y / m", "height / m", title=f"(a) reconstruction, {name}")
        top = figure.add_subplot(grid[1, column])
        _from_above(top, patches, surfaces, corners)
        label(top, "x / m", "y / m", title=f"(b) top view, {name}")
    caption = (
        "Patches (blue) where interactions were detected, planes through them (red, as far as they were touched), and the true glass box"
        " overlaid (black; the ground is z = 0). The paper's patches follow the motion just before and after; ours lie across the normal"
        " that impulse and friction tell."
    )
    return Picture("figure_10_reconstruction", "Counterpart of figure 10: the environment through its interactions", caption, png(figure))


def _from_above(axes: Axes, patches: list[Array], surfaces: list[p.Surface], corners: Array) -> None:
    for surface, hatch in zip(surfaces, itertools.cycle(("", "///")), strict=False):
        outline = np.asarray(surface.outline)
        high = float(outline[:, 2].mean())
        axes.fill(outline[:, 0], outline[:, 1], color=PREDICTED["color"], alpha=0.25, hatch=hatch, label=f"plane at {1e3 * high:.0f} mm")
    for i, patch in enumerate(patches):
        axes.fill(patch[:, 0], patch[:, 1], facecolor=MEASURED["color"], edgecolor="0.2", lw=0.4, label="patches" if i == 0 else None)
    ring = np.vstack([corners, corners[:1]])
    axes.plot(ring[:, 0], ring[:, 1], **TRUE, label="true box")
    axes.set(xlim=(-0.95, 0.95), ylim=(1.3, 2.75), xticks=(-0.5, 0.0, 0.5))
    axes.set_aspect("equal")
    axes.legend(loc="upper left", ncols=2, fontsize=7.5)


def interactions(seen: Observation) -> Picture:
    """Figure 11: a trajectory with its interactions, and one of them from near."""
    touched = bounces(seen)
    several = [trace for trace, _, _ in touched if sum(t.track == trace.track for t, _, _ in touched) > 1] or [touched[0][0]]
    # The one that goes farthest.
    trace = max(several, key=lambda trace: float((trace.center[-1] - trace.center[0]) @ along(trace)))
    track = trace.track
    way, start = along(trace), trace.center[0]

    def flat(points: Any) -> tuple[Array, Array]:
        points = np.atleast_2d(points)
        return (points - start) @ way, points[:, 2]

    figure, (left, right) = sheet(1, 2, 4.0, width_ratios=(1.25, 1))
    left.plot(*flat(trace.center), **MEASURED, label="measured center")
    mine = [c for c in seen.of(p.Contact) if c.track == track]
    left.plot(*flat([c.center for c in mine]), **OURS, lw=0, label="detected interaction")
    for contact in mine:
        if contact.direction is not None:
            ends = [contact.center - 0.12 * contact.direction, contact.center + 0.12 * contact.direction]
            left.plot(*flat(ends), color=PAPER["color"], lw=3, label="its direction, the paper's" if contact is mine[0] else None)
    left.set_aspect("equal", "datalim")
    label(left, "way along the throw / m", "height of the center / m", title="(a) trajectory and interactions")
    contact, before = next((c, b) for t, c, b in touched if t.track == track)
    touch = seen.seconds(contact.time_ns)
    for part, style, name in (
        (slice(before - SIDE, before), "--", f"parabola of {SIDE} before"),
        (slice(before, before + SIDE), "-.", f"parabola of {SIDE} after"),
    ):
        t, center = trace.t[part] - touch, trace.center[part]
        curve = np.linspace(min(t[0], -0.02), max(t[-1], 0.02), 60)
        fitted = np.stack([np.polyval(np.polyfit(t, center[:, i], 2), curve) for i in range(3)], 1)
        right.plot(*flat(fitted), color=PREDICTED["color"], ls=style, lw=1.4, label=name)
        right.plot(*flat(center), **MEASURED)
    right.plot(*flat(contact.center), **OURS, lw=0, label="contact, joint fit")
    true = min(seen.truth["contacts"], key=lambda c: abs(c["time_ns"] - contact.time_ns))
    right.plot(*flat(true["center"]), color="0.0", marker="x", ms=8, mew=1.6, lw=0, label="true")
    off = 1e3 * float(np.linalg.norm(np.asarray(contact.center) - true["center"]))
    shown = flat(trace.center[before - 4 : before + 4])
    right.set_xlim(shown[0].min() - 0.02, shown[0].max() + 0.02)
    right.set_ylim(float(contact.center[2]) - 0.06, shown[1].max() + 0.03)
    legend_below(figure, left, right)
    label(right, "way along the throw / m", "height of the center / m", title=f"(b) one from near ({off:.1f} mm off)")
    caption = (
        "No frame shows the moment of the touch: the flights before and after are extended until they meet. The paper fits two free"
        " parabolas; ours is one fit with a shared point and time, known gravity and drag. The direction is the mean of the two tangents."
    )
    return Picture("figure_11_interactions", "Counterpart of figure 11: detected interactions", caption, png(figure))
