"""`physinc level`: from throws to a pose in camera.toml."""

from __future__ import annotations

import math
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import tomlkit

import physinc
from physinc import level_command
from physinc._physinc import camera_file, level_pose
from physinc.cli import main
from physinc.interrupting import Interruption, interruptible
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
    for name in ("a.npz", "b.pcapng.zst", "B.PCAPNG.ZST", "c.npz"):
        (tmp_path / name).touch()
    (tmp_path / "folder").mkdir()
    assert camera_file(str(tmp_path / "a.npz")) == tmp_path / "a.camera.toml"
    assert camera_file(str(tmp_path / "b.pcapng.zst") + "?lose=0.1") == tmp_path / "b.camera.toml"
    assert camera_file(str(tmp_path / "B.PCAPNG.ZST")) == tmp_path / "B.camera.toml"
    assert camera_file(str(tmp_path / "folder")) == tmp_path / "folder" / "camera.toml"
    (tmp_path / "camera.toml").touch()
    (tmp_path / "a.camera.toml").touch()
    assert camera_file(str(tmp_path / "a.npz")) == tmp_path / "a.camera.toml"
    assert camera_file("c.npz") == Path("camera.toml")
    assert [camera_file(source) for source in ("kinect", "kinect:A001", "sim:bounce?seed=2", "-", "nothing.npz")] == [None] * 5


def test_without_a_place_the_working_directory_has_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    file, source = tmp_path / "camera.toml", f"sim:{SCENE}"
    file.write_text("fx = 600.0\n")
    assert main(["level", source, "--dry-run"]) == 0
    assert file.read_text() == "fx = 600.0\n"
    assert main(["level", source]) == 0
    assert file.read_text().startswith("fx = 600.0\nworld_from_camera")


@pytest.mark.parametrize("source", [f"sim:{SCENE}", "demo"])
def test_without_a_place_it_says_how_the_pose_is_used(
    source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["level", source]) == 0
    *_, told = capsys.readouterr().out.splitlines()
    arguments = shlex.split(told.partition(": physinc ")[2])
    assert arguments == ["run", source, "--camera", "camera.toml"]
    assert main([*arguments, "--frames", "20"]) == 0
    started, plain = (next(iter(physinc.stream(source, camera=camera))) for camera in ("camera.toml", None))
    assert isinstance(started, physinc.StreamStarted)
    assert isinstance(plain, physinc.StreamStarted)
    np.testing.assert_allclose(started.world_from_camera, pose_of(tmp_path / "camera.toml"), atol=1e-9)
    # What else is known of the camera still holds.
    assert started.camera == plain.camera


def test_a_recording_finds_its_pose_by_itself(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["level", str(room)]) == 0
    assert "--camera" not in capsys.readouterr().out
    assert main(["level", str(room), "--out", str(room.with_name("other.toml"))]) == 0
    assert f"--camera {room.with_name('other.toml')}" in capsys.readouterr().out


@pytest.mark.parametrize("gravity", [(0, 9.81, 0), (0, 0, 9.81), (0, 0, -9.81), (9.81, 0, 0), (3, -4, 8)])
def test_any_gravity_makes_a_pose(gravity: tuple[float, float, float]) -> None:
    g = np.array(gravity, float)
    for known in (None, np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])):
        rotation = level_pose(g, None if known is None else known.tolist())[:3, :3]
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


TETRAHEDRON = "v 0 9 0\nv 1 9 0\nv 0 10 0\nv 0 9 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


def test_the_configuration_is_read_as_run_reads_it(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    config, mesh = tmp_path / "elsewhere" / "c.toml", tmp_path / "elsewhere" / "m.obj"
    config.parent.mkdir()
    mesh.write_text(TETRAHEDRON)
    config.write_text('[assume]\ncamera = "static"\n[[environment.mesh]]\npath = "m.obj"\n', encoding="utf-8-sig")
    monkeypatch.chdir(tmp_path)
    assert main(["level", str(room), "--config", str(config), "--dry-run"]) == 0
    assert "roll +" in capsys.readouterr().out
    for text in ("assume=3\n", "[object]\nradius = \n", "[object]\nradius = 0\n", "[object]\nradus = 1\n", "a = '\xe4'\n"):
        config.write_text(text, encoding="latin-1")
        told = []
        for command in ("level", "run"):
            assert main([command, str(room), "--config", str(config)]) == 2
            told.append(capsys.readouterr().err)
        assert told[0] == told[1]
        assert told[0].count("\n") == 1


def test_what_windows_writes_stays(room: Path) -> None:
    file = room.with_suffix(".camera.toml")
    before = b"\xef\xbb\xbf" + b"# the one by the window\n".replace(b"\n", b"\r\n") + file.read_bytes().replace(b"\n", b"\r\n")
    file.write_bytes(before)
    assert main(["level", str(room)]) == 0
    assert file.read_bytes().startswith(before)
    assert isinstance(next(iter(physinc.stream(room))), physinc.StreamStarted)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with a name are POSIX's")
def test_ctrl_c_ends_it_with_what_was_found(tmp_path: Path) -> None:
    packets, pipe, out = tmp_path / "room.pcapng", tmp_path / "live.pcapng", tmp_path / "camera.toml"
    assert main(["simulate", SCENE, str(packets)]) == 0
    whole = packets.read_bytes()
    os.mkfifo(pipe)
    code = "import sys; from physinc.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "level", str(pipe), "--out", str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process, pipe.open("wb") as live:
        # Both ends stay open: there is more to come.
        live.write(whole[: int(len(whole) * 0.9)])
        live.flush()
        assert process.stderr is not None
        assert process.stderr.readline().startswith("1 flight: roll")
        process.send_signal(signal.SIGINT)
        told, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in error
    assert f"{out}: world_from_camera written" in told
    assert (pose_of(out)[:3, :3] @ true_gravity())[2] < -9.7


def test_ctrl_c_before_any_flight(npz: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def interrupted(stream: physinc.Stream, source: str) -> Iterator[Interruption]:
        with interruptible(stream, source) as interruption:
            signal.raise_signal(signal.SIGINT)
            yield interruption

    monkeypatch.setattr(level_command, "interruptible", interrupted)
    assert main(["level", str(npz)]) == 130
    assert "no flight was seen" in capsys.readouterr().err
    assert not npz.with_suffix(".camera.toml").exists()


def test_a_broken_camera_file_is_named_and_left_alone(room: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = room.with_suffix(".camera.toml")
    for text in ("width = \n", "world_from_camera = 3\n"):
        file.write_text(text)
        assert main(["level", str(room)]) == 2
        assert f"{file}:1: " in capsys.readouterr().err
        assert file.read_text() == text
