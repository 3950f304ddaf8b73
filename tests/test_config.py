"""Configuration: files, dicts and dataclasses, and what is refused."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import frames

import physinc
from physinc._physinc import dump_config

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def in_force(config: Any = None, camera: Any = None) -> dict[str, Any]:
    return tomllib.loads(dump_config(config=config, camera=camera))


def told(fields: Any) -> Any:
    """Without what is left out or empty, and with lists for tuples: as TOML has it."""
    if isinstance(fields, dict):
        return {key: value for key, value in ((key, told(value)) for key, value in fields.items()) if value not in (None, [], {})}
    return [told(item) for item in fields] if isinstance(fields, (list, tuple)) else fields


def test_the_dataclasses_have_the_engines_keys_and_defaults() -> None:
    assert told(asdict(physinc.Config())) == in_force()
    assert in_force(physinc.Config()) == in_force()


def test_every_key_passes_from_python_to_the_engine() -> None:
    pose = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.5], [0.0, 0.0, 0.0, 1.0]]
    config = physinc.Config(
        camera=physinc.CameraConfig(320, 240, 288, 289, 160, 120, 1000, False, [3.0, -0.003], 5, 0.01, pose),
        object=physinc.ObjectConfig("sphere", [0.02, 0.033], 0.06, 0.5, 0.0, 3.0),
        laws=physinc.LawsConfig((0, 0, -9.8), "free_fall", False, False, 1.1, 0.01, 1e-4, "paper"),
        tracking=physinc.TrackingConfig(0, 1e-3),
        assume=physinc.AssumeConfig("static", "known", "passive"),
        environment=physinc.EnvironmentConfig(
            plane=[physinc.KnownPlane("ground")],
            box=[physinc.KnownBox((0, 1, 0), (1, 1, 1), rotation=(1, 0, 0, 0))],
            sphere=[physinc.KnownSphere((0, 1, 0), 0.5)],
        ),
    )
    assert in_force(config) == told(asdict(config))
    assert in_force(asdict(config)) == told(asdict(config))


def test_a_file_is_read_and_what_is_printed_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text("[object]\nradius = [0.02, 0.033]\n[[environment.plane]]\nname = 'ground'\n")
    text = dump_config(config=path)
    assert tomllib.loads(text)["object"]["radius"] == [0.02, 0.033]
    path.write_text(text)
    assert dump_config(config=str(path)) == text


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"objects": {}}, "objects"),
        ({"object": {"radus": 0.03}}, "radus"),
        ({"object": {"radius": -1}}, "object.radius = -1"),
        ({"object": {"radius": float("nan")}}, "object.radius"),
        ({"object": {"radius": "big"}}, "object.radius"),
        ({"object": {"radius": object()}}, "object.radius"),
        ({"camera": {"fx": 0}}, "camera.fx = 0"),
        ({"camera": {"width": 10**6}}, "camera.width"),
        ({"camera": {"world_from_camera": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}, "world_from_camera"),
        ({"laws": {"theta": 0}}, "laws.theta = 0"),
        ({"laws": {"gravity": [0, 0]}}, "gravity"),
        ({"laws": {"gravity": [0, 0, float("inf")]}}, "laws.gravity"),
        ({"laws": {"law": "magic"}}, "magic"),
        ({"laws": {"magnus": True}}, "laws.magnus"),
        ({"assume": {"camera": "upside_down"}}, "upside_down"),
        ({"assume": {"objects": "unknown", "camera": "moving"}}, "assume.objects"),
        ({"environment": {"cone": [{"radius": 1}]}}, "expected one of `plane`, `box`, `sphere`, `mesh`"),
        ({"environment": {"mesh": [{"path": "nowhere/a.obj"}]}}, r"environment\.mesh\.path: nowhere/a\.obj: No such file"),
        ({"environment": {"mesh": [{"path": "a.dae"}]}}, r"a\.dae: .* \.obj, \.stl or \.ply"),
        ({"environment": {"box": [{"name": "without size"}]}}, "environment.box.center"),
        ({"environment": {"mesh": [{"name": "without path"}]}}, r"environment\.mesh\.path: expected the path of an OBJ, STL or PLY file$"),
        ({"environment": {"plane": [{}] * 9}}, r"there are 9 of these, and room for 8 in `environment\.plane`"),
        ({"environment": {"plane": [{"normal": [0, 0, 2]}]}}, "environment.plane.normal"),
        (
            {"environment": {"box": [{"center": [0, 1, 0], "size": [1, 1, 1], "yaw": 0.1, "rotation": [1, 0, 0, 0]}]}},
            "environment.box.yaw: expected yaw or rotation, not both",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(config: Any, message: str) -> None:
    with pytest.raises(physinc.ConfigError, match=message):
        physinc.stream("demo", config=config)


def test_errors_in_files_name_file_and_line(tmp_path: Path, npz: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text("[laws]\ntheta = 'small'\n")
    with pytest.raises(physinc.ConfigError, match=r"config\.toml:2: `theta = 'small'`"):
        physinc.stream("demo", config=config)
    with pytest.raises(physinc.ConfigError, match=r"nowhere\.toml: No such file"):
        physinc.stream("demo", config=tmp_path / "nowhere.toml")
    (tmp_path / "camera.toml").write_text("fx = 500.0\nfocal = 3\n")
    with pytest.raises(physinc.ConfigError, match=r"camera\.toml:2: `focal = 3`: unknown field"):
        physinc.stream(npz)


def fx(**options: Any) -> float:
    started = next(iter(physinc.stream(**options)))
    assert isinstance(started, physinc.StreamStarted)
    assert started.camera is not None
    return started.camera.fx


def test_cameras_are_found_in_their_order(tmp_path: Path, npz: Path) -> None:
    assert fx(source=npz) == 575.8
    (tmp_path / "camera.toml").write_text("fx = 501.0")
    assert fx(source=npz) == 501.0
    npz.with_suffix(".camera.toml").write_text("fx = 502.0")
    assert fx(source=npz) == 502.0
    (tmp_path / "other.toml").write_text("fx = 503.0")
    assert fx(source=npz, camera=tmp_path / "other.toml") == 503.0
    assert fx(source=npz, camera=tmp_path / "other.toml", config={"camera": {"fx": 504.0}}) == 504.0
    assert fx(source=npz, camera={"fx": 505.0}, config={"camera": {"fx": 504.0}}) == 504.0
    assert fx(source=npz, camera=physinc.CameraConfig(fx=506.0)) == 506.0
    # Key by key: what the winner leaves out is taken from below.
    assert fx(source=npz, config={"camera": {"fy": 504.0}}) == 502.0


@pytest.mark.parametrize("source", ["npz", "demo", "sim:drop", "sim:drop?packets=1", "frames"])
def test_keys_from_python_say_what_a_file_of_them_says(tmp_path: Path, npz: Path, source: str) -> None:
    def started(camera: Any, config: Any = None) -> physinc.StreamStarted:
        opened: Any = {"npz": npz, "frames": zip(*frames().values(), strict=True)}.get(source, source)
        event = next(iter(physinc.stream(opened, camera=camera, config=config)))
        assert isinstance(event, physinc.StreamStarted)
        return event

    npz.with_suffix(".camera.toml").write_text("fx = 502.0\nfy = 503.0\n")
    (tmp_path / "file.toml").write_text("fx = 600.0\ncx = 300.0\n")
    keys = {"fx": 600.0, "cx": 300.0}
    of_file = started(tmp_path / "file.toml")
    assert of_file.camera is not None
    assert (of_file.camera.fx, of_file.camera.cx, of_file.camera.cy) == (600.0, 300.0, 239.5)
    for camera in (keys, physinc.CameraConfig(fx=600.0, cx=300.0)):
        assert started(camera) == of_file
    config = {"camera": {"fx": 700.0}}
    assert started(keys, config) == started(tmp_path / "file.toml", config)
    wins = started(keys, config).camera
    assert wins is not None
    assert (wins.fx, wins.cx) == (700.0, 300.0)


def test_a_simulated_scene_obeys_its_camera_file(tmp_path: Path) -> None:
    pose = [[1.0, 0, 0, 0.5], [0, 0, 1, 0], [0, -1, 0, 1], [0, 0, 0, 1]]
    own, told, instead = (
        next(iter(physinc.stream("sim:drop", **options)))
        for options in ({}, {"config": {"camera": {"world_from_camera": pose}}}, {"camera": {"world_from_camera": pose}})
    )
    assert isinstance(own, physinc.StreamStarted)
    assert isinstance(told, physinc.StreamStarted)
    assert isinstance(instead, physinc.StreamStarted)
    assert told.camera == own.camera
    np.testing.assert_array_equal(told.world_from_camera, pose)
    np.testing.assert_array_equal(instead.world_from_camera, pose)
    images = [physinc.stream("sim:drop", frames=True, camera=camera) for camera in (None, {"fx": 500.0})]
    for stream in images:
        list(stream)
    assert images[0].frame is not None
    assert images[1].frame is not None
    np.testing.assert_array_equal(images[0].frame.depth_mm, images[1].frame.depth_mm)
    (tmp_path / "camera.toml").write_text("width = 32\nheight = 16\nfx = 30\nfy = 30\ncx = 16\ncy = 8\n")
    with pytest.raises(physinc.RecordingError, match="it is 640×480 px, the camera is 32×16"):
        physinc.stream("sim:drop", camera=tmp_path / "camera.toml")
    with pytest.raises(physinc.ConfigError, match=r"camera\.fx = 0"):
        physinc.stream("sim:drop", camera={"fx": 0})


@pytest.mark.parametrize("options", [{"config": 5}, {"config": [1]}, {"camera": 5}])
def test_other_types_are_type_errors(options: Any) -> None:
    with pytest.raises(TypeError, match="a dict or a dataclass"):
        physinc.stream("demo", **options)


def test_what_is_assumed_of_the_camera_is_printed_as_the_source_has_it(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text("t,x,y,z\n0,0,1,1\n0.1,0,1,1\n")

    def assumed(source: str, config: Any = None) -> Any:
        return tomllib.loads(dump_config(source, config=config))["assume"]["camera"]

    assert assumed("sim:bounce") == assumed(str(tmp_path / "b.csv")) == "static"
    assert assumed("sim:rotated_camera") == "tilted"
    assert assumed("sim:bounce", {"assume": {"camera": "moving"}}) == "moving"
    assert "camera" not in tomllib.loads(dump_config())["assume"]


def test_a_surface_can_be_appended_to_what_is_printed(tmp_path: Path) -> None:
    path = tmp_path / "c.toml"
    path.write_text(dump_config() + '[[environment.plane]]\nname = "table"\n')
    assert 'name = "table"' in dump_config(config=path)
