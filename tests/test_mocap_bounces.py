"""The readers of examples/mocap_bounces.py, on a few lines in each format; and the whole of it on real data, where that is."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from conftest import trajectory

import physinc

if TYPE_CHECKING:
    from types import ModuleType

ROOT = Path(__file__).parent.parent
DATA = Path(os.environ.get("PHYSINC_DATA", ROOT.parent / "shared" / "data")) / "jugglebot-mocap"


@pytest.fixture(scope="module")
def mocap() -> ModuleType:
    spec = importlib.util.spec_from_file_location("mocap_bounces", ROOT / "examples" / "mocap_bounces.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def tsv(rows: list[list[object]]) -> str:
    """Three markers, of which the first has a name."""
    header: list[list[object]] = [
        ["NO_OF_FRAMES", len(rows)],
        ["NO_OF_MARKERS", 3],
        ["FREQUENCY", 300],
        ["MARKER_NAMES", "base_1", "", ""],
        ["Frame", "Time", "base_1 X", "base_1 Y", "base_1 Z", " X", " Y", " Z", " X", " Y", " Z", ""],
    ]
    return "".join("\t".join(map(str, line)) + "\r\n" for line in header + rows)


def test_tsv_leaves_out_named_markers_and_missing_samples(mocap: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.tsv"
    path.write_text(
        tsv([[1, 0.0, 1, 2, 3, 10, 20, 30, "0.000", "0.000", "0.000"], [4, 0.01, 1, 2, 3, 11, 0, 31, -5, 6, 7]]),
        newline="",
    )
    recording = mocap.read(path)
    assert recording.frequency == 300
    assert recording.samples == [
        (1, 2, (0.010, 0.020, 0.030)),
        (4, 2, (0.011, 0.0, 0.031)),
        (4, 3, (-0.005, 0.006, 0.007)),
    ]


def test_json_joins_parts_and_merges_markers_by_frame(mocap: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    first = {"Parts": [{"Range": {"Start": 3, "End": 4}, "Values": [[1, 2, 3, 0.1], [4, 5, 6, 0.1]]}]}
    gap = {"Range": {"Start": 9, "End": 9}, "Values": [[7, 8, 9, 0.2]]}
    second = {"Parts": [{"Range": {"Start": 2, "End": 2}, "Values": [[10, 0, 0, 0.3]]}, gap]}
    path.write_text(json.dumps({"Timebase": {"Frequency": 300.0}, "Markers": [first, second]}))
    recording = mocap.read(path)
    assert [(sample.frame, sample.track) for sample in recording.samples] == [(2, 2), (3, 1), (4, 1), (9, 2)]
    assert recording.samples[-1].center == (0.007, 0.008, 0.009)
    stamps = [balls[0].timestamp_ns for balls in recording.positions()]
    assert stamps == [6_666_667, 10_000_000, 13_333_333, 30_000_000]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("empty.tsv", ""),
        ("foreign.tsv", "a,b\n1,2\n"),
        ("cut.tsv", tsv([[1, 0.0, 1, 2, 3, 10]])),
        ("empty.json", ""),
        ("list.json", "[]"),
        ("cut.json", '{"Timebase": {"Frequency": 300}, "Markers": [{"Parts": [{"Values": [[1]]}]}]}'),
    ],
)
def test_what_is_no_export_is_an_error_that_names_the_file(mocap: ModuleType, tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(physinc.RecordingError, match=name):
        mocap.read(path)


def test_the_example_tells_of_a_floor_in_any_encoding(tmp_path: Path) -> None:
    path = tmp_path / "a.tsv"
    t, centers = trajectory(rate=300)
    moments = zip(range(1, len(t) + 1), t.tolist(), (1e3 * centers).tolist(), strict=True)
    path.write_text(tsv([[frame, now, 1, 2, 3, *center, 0, 0, 0] for frame, now, center in moments]), newline="")
    for encoding in ("ascii", "latin-1"):
        run = subprocess.run(
            [sys.executable, ROOT / "examples" / "mocap_bounces.py", path],
            capture_output=True,
            check=False,
            timeout=60,
            env={**os.environ, "PYTHONIOENCODING": encoding},
        )
        assert run.returncode == 0, run.stderr
        assert "tilted by" in run.stdout.decode(encoding)


real = pytest.mark.skipif(not DATA.is_dir(), reason=f"no real recordings at {DATA} (PHYSINC_DATA names their folder)")


def landings(recording: Any) -> list[float]:
    """When a ball that fell at more than 3 m/s was stopped at the floor, s, by differences of samples alone."""
    found: list[float] = []
    by_track = sorted(recording.samples, key=lambda sample: (sample.track, sample.frame))
    for _, samples in groupby(by_track, key=lambda sample: sample.track):
        t, z = np.array([(sample.frame / recording.frequency, sample.center[2]) for sample in samples]).T
        falling = np.diff(z) < -3 * np.diff(t)
        for end in np.flatnonzero(falling[:-1] & ~falling[1:]) + 1:
            after = (t >= t[end]) & (t < t[end] + 0.1)
            # One sample alone may be wild.
            fell = falling[max(end - 5, 0) : end].all()
            if fell and z[after].min() < 0.06 and not (found and abs(t[end] - found[-1]) < 0.1):
                found.append(float(t[end]))
    return sorted(found)


@real
@pytest.mark.parametrize(
    ("name", "counts", "speeds", "restitutions"),
    [
        # A machine throws.
        ("session7.json", (20, 20), (6.97, 7.02), (0.29, 0.40)),
        # The first was sped up and turned along the floor, by a spin that nobody told, or by something that lay there: it names no surface.
        ("3_throws_tracking_lost_on_each.tsv", (3, 2), (6.2, 6.4), (0.08, 0.39)),
        # These balls hardly bounce.
        ("6_throws_minimal_tracking_loss.tsv", (4, 4), (5.3, 6.5), (0.04, 0.24)),
    ],
)
def test_real_balls_bounce_where_they_land(
    mocap: ModuleType, name: str, counts: tuple[int, int], speeds: tuple[float, float], restitutions: tuple[float, float]
) -> None:
    count, on_floors = counts
    recording = mocap.read(DATA / name)
    events = [event for event in physinc.stream(recording.positions()) if event.final]
    bounces = [event for event in events if isinstance(event, physinc.Contact) and event.center[2] < 0.06]
    expected = landings(recording)
    assert len(expected) == count
    assert [bounce.time_ns * 1e-9 for bounce in bounces] == pytest.approx(expected, abs=0.01)
    for bounce in bounces:
        assert bounce.velocity_before is not None
        assert bounce.restitution is not None
        assert speeds[0] <= round(float(np.linalg.norm(bounce.velocity_before)), 2) <= speeds[1]
        assert restitutions[0] <= round(bounce.restitution, 2) <= restitutions[1]
    surfaces = [event for event in events if isinstance(event, physinc.Surface) and event.merged_into is None]
    floors = [surface for surface in surfaces if abs(surface.offset) < 0.02]
    assert sum(floor.contacts for floor in floors) == on_floors
    for floor in floors:
        assert floor.tilt is not None
        assert floor.tilt < np.radians(2.0)
    gravity = [event for event in events if isinstance(event, physinc.CameraOrientation)][-1]
    assert 9.6 < np.linalg.norm(gravity.gravity_in_camera) < 9.85


@real
def test_the_example_tells_of_one_floor_under_twenty_real_throws() -> None:
    command: list[str | Path] = [sys.executable, ROOT / "examples" / "mocap_bounces.py", DATA / "session7.json"]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()
    # One ball also comes to lie on something 0.24 m high.
    assert max(int(line.split()[2]) for line in lines if line.startswith("surface")) == 20, run.stdout
    alone = next(line for line in lines if line.startswith("each of"))
    assert float(alone.split(": ")[1].split()[0]) == pytest.approx(9.73, abs=0.1), run.stdout
