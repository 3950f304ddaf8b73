"""`physinc level`: from throws to a pose in camera.toml."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import tomlkit

import physinc
from physinc.camera_file import beside, level_pose
from physinc.cli import main
from physinc.level_command import angle_sds

SCENE = "bounce?tilt_deg=20&roll_deg=10&seed=4&throws=2"


@pytest.fixture(scope="module")
def thrown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("thrown") / "room.npz"
    assert main(["simulate", SCENE, str(out)]) == 0
    return out


@pytest.fixture
def room(thrown: Path, tmp_path: Path) -> Path:
    """A copy that a test may write beside."""
    for name in ("room.npz", "room.camera.toml"):
        (tmp_path / name).write_bytes((thrown.parent / name).read_bytes())
    return tmp_path / "room.npz"


def true_gravity() -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    pitch, roll = math.radians(20), math.radians(10)
    return 9.81 * np.array([math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll), math.sin(pitch)])


def pose_of(file: Path) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array(tomlkit.parse(file.read_text())["world_from_camera"].unwrap())


def test_a_thrown_ball_levels_the_camera_and_keeps_the_file(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = room.with_suffix(".camera.toml")
    before = "# the one by the window\n" + file.read_text().replace("fx =", "fx   =") + "# end\n"
    file.write_text(before)
    assert main(["level", str(room)]) == 0
    out = capsys.readouterr().out
    assert "roll +" in out
    assert " ± " in out
    assert "heading: no flight tells it" in out
    pose = pose_of(file)
    # Floor and camera: gravity is the world's −z to a fifth of a degree, and the camera looks along y.
    angle = math.degrees(math.acos(-(pose[:3, :3] @ true_gravity())[2] / 9.81))
    assert angle < 0.2
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1)
    assert pose[0, 2] == pytest.approx(0, abs=1e-9)
    assert not pose[:3, 3].any()
    # All that stood there stands there still.
    assert file.read_text().startswith(before.rstrip("\n").removesuffix("# end"))
    assert "# end" in file.read_text()
    assert [path.name for path in room.parent.iterdir() if path.name.startswith(".")] == []
    started = next(iter(physinc.stream(room)))
    assert isinstance(started, physinc.StreamStarted)
    np.testing.assert_allclose(started.world_from_camera, pose, atol=1e-9)


def test_sigmas_are_those_of_the_errors(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    z = []
    for seed in range(300, 310):
        events = physinc.stream(f"sim:passive_flight?tilt_deg=5&roll_deg=-8&throws=6&seed={seed}")
        *_, last = (event for event in events if isinstance(event, physinc.CameraOrientation))
        roll_sd, pitch_sd = angle_sds(np.asarray(last.gravity_in_camera), np.asarray(last.covariance))
        z += [(last.roll + math.radians(8)) / -roll_sd, (last.pitch + math.radians(5)) / pitch_sd]
    # 20 numbers: their rms is 1 ± 0.16.
    assert 0.5 < float(np.sqrt(np.mean(np.square(z)))) < 1.7


def test_dry_run_and_out_leave_the_file_alone(room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = room.with_suffix(".camera.toml")
    before = file.read_bytes()
    assert main(["level", str(room), "--dry-run"]) == 0
    assert "world_from_camera = [" in capsys.readouterr().out
    out = tmp_path / "new.toml"
    assert main(["level", str(room), "--out", str(out)]) == 0
    assert file.read_bytes() == before
    keys = tomlkit.parse(out.read_text())
    assert {**tomlkit.parse(before.decode()), "world_from_camera": keys["world_from_camera"]} == keys


def test_heading_and_place_of_a_known_pose_are_kept(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    yaw = math.radians(30)
    old = np.eye(4, dtype=np.float64)
    # Level by guess, turned to the left, 1.2 m over the floor.
    old[:3, :3] = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]) @ [
        [1, 0, 0],
        [0, 0, 1],
        [0, -1, 0],
    ]
    old[:3, 3] = 3.0, 4.0, 1.2
    camera = room.parent / "mine.toml"
    camera.write_text(room.with_suffix(".camera.toml").read_text() + f"world_from_camera = {old.tolist()}\n")
    assert main(["level", str(room), "--camera", str(camera)]) == 0
    assert "is kept from" in capsys.readouterr().out
    pose = pose_of(camera)
    np.testing.assert_allclose(pose[:3, 3], np.array([3.0, 4.0, 1.2]))
    np.testing.assert_allclose(pose[:3, :3] @ true_gravity(), [0, 0, -9.81], atol=0.03)
    # Its y axis still points to the same side of the horizon.
    np.testing.assert_allclose(np.cross(pose[1, :3], old[1, :3]) @ true_gravity(), 0, atol=0.5)
    assert camera.read_text().count("world_from_camera") == 1


def test_where_the_file_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a.npz", "b.pcapng.zst", "c.npz"):
        (tmp_path / name).touch()
    (tmp_path / "folder").mkdir()
    assert beside(str(tmp_path / "a.npz")) == tmp_path / "a.camera.toml"
    assert beside(str(tmp_path / "b.pcapng.zst") + "?lose=0.1") == tmp_path / "b.camera.toml"
    assert beside(str(tmp_path / "folder")) == tmp_path / "folder" / "camera.toml"
    assert beside("kinect") == beside("sim:bounce?seed=2") == Path("camera.toml")
    (tmp_path / "camera.toml").touch()
    (tmp_path / "a.camera.toml").touch()
    assert beside(str(tmp_path / "a.npz")) == tmp_path / "a.camera.toml"
    assert beside(str(tmp_path / "c.npz")) == tmp_path / "camera.toml"


@pytest.mark.parametrize("gravity", [(0, 9.81, 0), (0, 0, 9.81), (0, 0, -9.81), (9.81, 0, 0), (3, -4, 8)])
def test_any_gravity_makes_a_pose(gravity: tuple[float, float, float]) -> None:
    g = np.array(gravity, float)
    for known in (None, np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])):
        rotation = level_pose(g, known)[:3, :3]
        np.testing.assert_allclose(rotation @ g, np.array([0, 0, -float(np.linalg.norm(g))]), atol=1e-12)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1)


def test_without_a_flight_nothing_is_written(npz: Path, csv: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["level", str(npz)]) == 1
    error = capsys.readouterr().err
    assert "no flight was seen" in error
    assert error.count("\n") == 1
    assert not npz.with_suffix(".camera.toml").exists()
    assert main(["level", str(csv)]) == 2
    assert "no camera to be levelled" in capsys.readouterr().err
    assert main(["level", str(npz.with_name("nothing.npz"))]) == 1
    assert "nothing.npz" in capsys.readouterr().err


def test_a_broken_camera_file_is_named_and_left_alone(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = room.with_suffix(".camera.toml")
    for text in ("width = \n", "world_from_camera = 3\n"):
        file.write_text(text)
        assert main(["level", str(room)]) == 2
        assert str(file) in capsys.readouterr().err
        assert file.read_text() == text
