"""The known environment: meshes that are read or refused, and predictions that bounce."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

import physinc
from physinc._physinc import dump_config

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
CLOSED = CORNERS + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
RIGID = "[[0, -1, 0, 2], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "import sys; from physinc.cli import main; sys.exit(main())", "run", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize(
    ("mesh", "pose", "message"),
    [
        (CORNERS, RIGID, "it has no triangles"),
        (CLOSED.replace("v 1 0 0", "v 1 nan 0"), RIGID, "1 of its vertices are NaN or infinite"),
        (CLOSED.replace("f 1 3 2\n", ""), RIGID, "it is not closed: 3 of its edges"),
        (CLOSED.replace("f 1 3 2", "f 1 2 3"), RIGID, "its faces look different ways"),
        (CORNERS + "f 1 2 3\nf 1 4 2\nf 2 4 3\nf 3 4 1\n", RIGID, "it is inside out"),
        (CORNERS + "f 1 2 9\n", RIGID, "can't be read as OBJ: face vertex index out of bounds"),
        (CLOSED.replace("v 1 0 0", "v 2500 0 0"), RIGID, "in metres, not in millimetres"),
        (CLOSED, RIGID.replace("-1", "-2"), "environment.mesh.pose: expected 4 rows of 4, a rotation and a translation"),
    ],
)
def test_a_mesh_that_cannot_be_is_refused_in_one_line(tmp_path: Path, mesh: str, pose: str, message: str) -> None:
    (tmp_path / "m.obj").write_text(mesh)
    config = tmp_path / "config.toml"
    config.write_text(f'[[environment.mesh]]\nname = "block"\npath = "m.obj"\npose = {pose}\n')
    for arguments in (["demo", "--json"], ["--dump-config"]):
        refused = run(*arguments, "--config", config)
        assert (refused.returncode, refused.stdout) == (2, "")
        assert message in refused.stderr
        assert "config.toml:" in refused.stderr
        assert len(refused.stderr.splitlines()) == 1


def test_an_unknown_shape_is_told_which_there_are(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text("[[environment.cone]]\nradius = 1.0\n")
    refused = run("demo", "--config", config)
    assert refused.returncode == 2
    assert "config.toml:1: `[[environment.cone]]`: unknown field `cone`, expected one of `plane`, `box`, `sphere`, `mesh`" in refused.stderr


def test_a_mesh_is_read_from_beside_its_file_and_from_python(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(CLOSED)
    config = tmp_path / "config.toml"
    config.write_text(f'[[environment.mesh]]\nname = "block"\npath = "m.obj"\npose = {RIGID}\n')
    printed = dump_config(config=config)
    assert str(tmp_path / "m.obj") in printed
    # What is in force means the same from anywhere.
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "again.toml").write_text(printed)
    assert dump_config(config=tmp_path / "sub" / "again.toml") == printed
    mesh = physinc.KnownMesh(str(tmp_path / "m.obj"), "block", [[0, -1, 0, 2], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    known = physinc.Config(environment=physinc.EnvironmentConfig(mesh=[mesh]))
    assert dump_config(config=known) == dump_config(config=asdict(known)) == printed
    surfaces = [e for e in physinc.stream("demo", config=known) if isinstance(e, physinc.Surface) and e.id == 0]
    assert surfaces[0].name == "block"


A = "[[environment.sphere]]\nname = 'a'\ncenter = [0.0, 1.0, 0.0]\nradius = 0.1\n"
B = "[[environment.plane]]\nname = 'b'\n"
C = "[[environment.box]]\nname = 'c'\ncenter = [0.0, 9.0, 0.0]\nsize = [1.0, 1.0, 1.0]\n"


def names(config: Any) -> list[str | None]:
    """Of the known surfaces, by their ids."""
    known = {
        event.id: event.name for event in physinc.stream(falling(), config=config, provisional=True) if isinstance(event, physinc.Surface)
    }
    return [known[i] for i in range(len(known))]


def test_ids_follow_the_order_of_the_file_or_mapping(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    for text in (A + B + C, C + B, C + A.replace("'a'", "'b'") + B.replace("'b'", "'a'") + C):
        config.write_text(text)
        order = [line.split("'")[1] for line in text.splitlines() if line.startswith("name")]
        assert names(config) == order
        config.write_text(dump_config(config=config))
        assert names(config) == order
    box = physinc.KnownBox((0, 9, 0), (1, 1, 1), "c")
    assert names({"environment": {"box": [box], "plane": [{"name": "b"}]}}) == ["c", "b"]
    assert names({"environment": {"plane": [{"name": "b"}], "box": [box]}}) == ["b", "c"]
    known = physinc.EnvironmentConfig(box=[box], plane=[physinc.KnownPlane("b")])
    assert names(physinc.Config(environment=known)) == ["b", "c"]


def test_all_surfaces_that_a_configuration_has_room_for_are_known(tmp_path: Path) -> None:
    (tmp_path / "m.obj").write_text(CLOSED)
    many = {
        "plane": [{"name": "b"}] * 8,
        "box": [{"name": "c", "center": [0, 9, 0], "size": [1, 1, 1]}] * 8,
        "sphere": [{"name": "a", "center": [0, 9, 0], "radius": 0.1}] * 8,
        "mesh": [{"name": "d", "path": tmp_path / "m.obj"}] * 4,
    }
    assert "".join(name or "" for name in names({"environment": many})) == "bbbbbbbbccccccccaaaaaaaadddd"


def test_a_plane_has_two_sides() -> None:
    found = {}
    for up in (1.0, -1.0):
        plane = {"name": "floor", "normal": [0.0, 0.0, up], "offset": 0.0}
        events = list(physinc.stream("demo", config={"environment": {"plane": [plane]}}, provisional=True))
        surfaces = [event for event in events if isinstance(event, physinc.Surface)]
        assert list(surfaces[0].normal) == [0.0, 0.0, up]
        (floor,) = (surface for surface in surfaces if surface.final and surface.id == 0)
        assert list(floor.normal) == [0.0, 0.0, 1.0]
        contacts = (event for event in events if isinstance(event, physinc.Contact) and event.final and event.surface == 0)
        found[up] = [floor.contacts, *(contact.time_ns for contact in contacts)]
    assert found[1.0] == found[-1.0]
    assert found[1.0][0] > 3


def test_a_time_too_far_away_is_an_error() -> None:
    with physinc.stream(falling(), positions=True) as stream:
        for event in stream:
            if event.timestamp_ns >= int(11 / 30 * 1e9):
                break
        (track,) = stream.tracks.values()
    for t in (1e9, -1e9):
        with pytest.raises(ValueError, match=r"t = -?1000000000 s is too far from where track 1 was seen"):
            track.predict(t)


def falling() -> Iterator[physinc.Position]:
    for i in range(12):
        t = i / 30
        yield physinc.Position(int(t * 1e9), (0.5 * t, 1.5, 1.0 - 4.905 * t * t), covariance=[[1e-6, 0, 0], [0, 1e-6, 0], [0, 0, 1e-6]])


@pytest.mark.parametrize("known", [False, True])
def test_predictions_bounce_off_what_is_known(known: bool) -> None:
    planes = [physinc.KnownPlane("ground")] if known else []
    config = physinc.Config(laws=physinc.LawsConfig(drag=False), environment=physinc.EnvironmentConfig(plane=planes))
    with physinc.stream(falling(), config=config, positions=True) as stream:
        for event in stream:
            if event.timestamp_ns >= int(11 / 30 * 1e9):
                break
        (track,) = stream.tracks.values()
        center, covariance = track.predict(0.6)
        before, _ = track.predict(0.4)
    assert before[2] == pytest.approx(1.0 - 4.905 * 0.16, abs=5e-3)
    assert (center[2] > 0.033) == known
    # What is not known of the restitution.
    assert (covariance[2][2] > 0.1**2) == known
