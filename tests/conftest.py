"""What several tests write: recordings of a ball in free fall that bounces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_bus import attach  # noqa: F401 - a fixture
from hypothesis import settings
from numpy.typing import NDArray
from virtual_kinect import virtual_kinect  # noqa: F401 - a fixture

GRAVITY = 9.81

# The same cases on every machine; `pytest --hypothesis-profile=default` looks for others.
settings.register_profile("same", derandomize=True)
settings.load_profile("same")


def trajectory(bounces: int = 3, rate: float = 100.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times and centers of a ball of 33 mm that is thrown over a floor at z = 0, without air, restitution 0.75."""
    t = np.arange(0.0, 2.0, 1.0 / rate)
    z, vz, start = 1.0, 0.0, 0.0
    centers = np.empty((len(t), 3))
    for i, now in enumerate(t):
        while True:
            land = start + (vz + np.sqrt(vz**2 + 2 * GRAVITY * (z - 0.033))) / GRAVITY
            if now < land or bounces == 0:
                break
            vz, z, start, bounces = 0.75 * (GRAVITY * (land - start) - vz), 0.033, land, bounces - 1
        centers[i] = 0.4 * now, 2.0, z + vz * (now - start) - GRAVITY / 2 * (now - start) ** 2
    return t, centers


@pytest.fixture
def csv(tmp_path: Path) -> Path:
    """A CSV of positions with a millimetre of noise."""
    t, centers = trajectory()
    centers = centers + np.random.default_rng(1).normal(0, 1e-3, centers.shape)
    path = tmp_path / "ball.csv"
    rows = (f"{now:.6f},{x:.6f},{y:.6f},{z:.6f}" for now, (x, y, z) in zip(t, centers, strict=True))
    path.write_text("t,x,y,z\n" + "\n".join(rows) + "\n")
    return path


def frames(count: int = 5) -> dict[str, Any]:
    """Arrays of a recording that shows a flat wall at 2 m."""
    stamps = np.arange(count, dtype=np.int64) * 33_333_333
    return {"timestamps_ns": stamps, "depth_mm": np.full((count, 480, 640), 2000, np.uint16)}


@pytest.fixture
def npz(tmp_path: Path) -> Path:
    """A recording of a wall."""
    path = tmp_path / "wall.npz"
    np.savez_compressed(path, **frames())
    return path
