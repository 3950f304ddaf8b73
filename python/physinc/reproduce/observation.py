"""A simulated scene as physinc sees it, beside what is true."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import tomlkit
from numpy.typing import NDArray

from physinc import _physinc as p
from physinc.event import Event
from physinc.streaming import stream

Array = NDArray[np.float64]
E = TypeVar("E", bound=Event)

PAPER = {"laws": {"method": "paper"}}
"""The paper's method, as a configuration."""


@dataclass(frozen=True)
class Trace:
    """The positions of one track."""

    track: int
    """Its number."""
    t: Array
    """[N], s since the stream began."""
    center: Array
    """[N, 3], world, m."""
    in_camera: Array
    """[N, 3], camera frame, m."""
    covariance: Array
    """[N, 3, 3], of `center`, m²."""
    frame: NDArray[np.int64]
    """[N], index of the frame."""


@dataclass(frozen=True)
class Observation:
    """What was told of a scene."""

    scene: str
    """Its name and keys."""
    events: list[Event]
    """All final ones."""
    truth: dict[str, Any]
    """What is true of it; of `physinc simulate`."""

    def of(self, kind: type[E]) -> list[E]:
        """All final events of one kind."""
        return [event for event in self.events if isinstance(event, kind) and event.final]

    def seconds(self, time_ns: int) -> float:
        """Seconds since the stream began."""
        return (time_ns - self.events[0].timestamp_ns) * 1e-9

    def traces(self, least: int = 8) -> list[Trace]:
        """All tracks with at least so many positions."""
        tracks: dict[int, list[p.Position]] = {}
        for position in self.of(p.Position):
            if position.track is not None and position.center_in_camera is not None:
                tracks.setdefault(position.track, []).append(position)
        return [
            Trace(
                track,
                np.array([self.seconds(q.timestamp_ns) for q in positions]),
                np.array([q.center for q in positions]),
                np.array([q.center_in_camera for q in positions]),
                np.array([q.covariance for q in positions]),
                np.array([q.frame for q in positions]),
            )
            for track, positions in tracks.items()
            if len(positions) >= least
        ]


def observe(scene: str, config: dict[str, Any] | None = None) -> Observation:
    """Watch the simulated `scene`."""
    events = list(stream(f"sim:{scene}", config=config, positions=True))
    return Observation(scene, events, json.loads(p.truth(scene)))


def images(scene: str) -> tuple[NDArray[np.float64], dict[str, float]]:
    """Depth images [N, H, W] of the simulated `scene`, m, NaN where there is none, and the camera's intrinsics, px."""
    joint = "&" if "?" in scene else "?"
    with tempfile.TemporaryDirectory(prefix="physinc") as folder:
        out = Path(folder) / "scene.npz"
        p.simulate(f"{scene}{joint}kind=depth", out)
        with np.load(out) as arrays:
            depth = arrays["depth_mm"]
        camera = tomlkit.parse(out.with_suffix(".camera.toml").read_text(encoding="utf-8")).unwrap()
    return np.where(depth > 0, depth * 1e-3, np.nan), {name: float(camera[name]) for name in ("fx", "fy", "cx", "cy")}


def deproject(depth: Array, camera: dict[str, float]) -> Array:
    """Points [H, W, 3] of a depth image in the camera frame, m."""
    v, u = np.indices(depth.shape)
    return np.stack([(u - camera["cx"]) / camera["fx"] * depth, (v - camera["cy"]) / camera["fy"] * depth, depth], -1)
