"""Trajectories known up to scale: `fit_scale`, `split_flights`, `physinc scale`."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import physinc
from physinc._physinc import read_positions
from physinc.agreement import chi2_sf, groups
from physinc.cli import main

Array = NDArray[np.float64]
TENNIS = 0.5 * 1.2 * 0.53 * math.pi * 0.033**2 / 0.057


def turned(rng: np.random.Generator) -> Array:
    """Some rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = np.asarray(q * np.sign(np.diag(r)))
    return q * float(np.linalg.det(q))


def thrown(
    scale: float, seed: int = 0, *, count: int = 20, drag: float = TENNIS, noise: float = 0.0, rotation: Array | None = None
) -> tuple[Array, Array, Array]:
    """Times, positions in units of `scale` metres in turned axes, and where gravity pulls there: Runge–Kutta in steps of 4 ms."""
    rng = np.random.default_rng(seed)
    rotation = turned(rng) if rotation is None else rotation
    velocity = np.array([*rng.normal(0, 1.5, 2), rng.uniform(1, 4)])
    state = np.concatenate([np.zeros(3), velocity])

    def slope(y: Array) -> Array:
        v = y[3:]
        return np.concatenate([v, np.array([0, 0, -9.81]) - drag * np.linalg.norm(v) * v])

    t, positions, h = np.arange(count) / 30, np.empty((count, 3)), 1 / 30 / 8
    for i in range(count):
        positions[i] = state[:3]
        for _ in range(8):
            k1 = slope(state)
            k2 = slope(state + h / 2 * k1)
            k3 = slope(state + h / 2 * k2)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope(state + h * k3))
    positions += rng.normal(0, noise, positions.shape) if noise else 0.0
    return t, positions @ rotation.T / scale + rng.normal(0, 3, 3), rotation @ [0.0, 0.0, -1.0]


@pytest.mark.parametrize("scale", [1e-3, 0.3048, 1.0, 17.0])
@pytest.mark.parametrize("drag", [0.0, TENNIS, 6.4 * TENNIS])
def test_an_exact_flight_in_other_units_has_its_scale(scale: float, drag: float) -> None:
    t, positions, down = thrown(scale, 3, drag=drag)
    fit = physinc.fit_scale(t, positions, drag=drag)
    assert fit is not None
    assert fit.scale == pytest.approx(scale, rel=2e-5)
    np.testing.assert_allclose(fit.gravity_direction, down, atol=1e-4)
    assert np.linalg.norm(fit.gravity_direction) == pytest.approx(1)
    assert fit.dof == 51


def test_drag_that_is_left_out_would_be_wrong_by_more() -> None:
    t, positions, _ = thrown(0.5, 3)
    vacuum = physinc.fit_scale(t, positions, drag=0.0)
    assert vacuum is not None
    assert abs(vacuum.scale / 0.5 - 1) > 1e-3


@pytest.mark.parametrize("drag", [0.0, TENNIS, 6.4 * TENNIS])
def test_drag_that_is_unknown_is_found_along(drag: float) -> None:
    t, positions, _ = thrown(0.5, 3, drag=drag)
    fit = physinc.fit_scale(t, positions)
    assert fit is not None
    assert fit.scale == pytest.approx(0.5, rel=2e-4)
    assert fit.drag == pytest.approx(drag, abs=1e-3)
    # Where noise leaves it open, the scale is less sure.
    t, positions, _ = thrown(0.5, 3, drag=drag, noise=2e-3, count=12)
    known, unknown = physinc.fit_scale(t, positions, drag=drag), physinc.fit_scale(t, positions)
    assert known is not None
    assert unknown is not None
    assert known.sd < unknown.sd < 20 * known.sd


@pytest.mark.parametrize("drag", [0.0, TENNIS, 2 * TENNIS])
def test_sigma_is_honest_where_drag_is_unknown(drag: float) -> None:
    z = []
    for seed in range(1200, 1400):
        t, positions, _ = thrown(0.37, seed, count=15, noise=2e-3, drag=drag)
        fit = physinc.fit_scale(t, positions)
        assert fit is not None
        z.append((fit.scale - 0.37) / fit.sd)
    # The guess may be a standard deviation off itself.
    assert float(np.sqrt(np.mean(np.square(z)))) < 1.4


@pytest.mark.parametrize("told", [False, True])
def test_sigma_is_that_of_the_errors(told: bool) -> None:
    z = []
    for seed in range(1000, 1200):
        t, positions, _ = thrown(0.37, seed, count=15, noise=2e-3)
        fit = physinc.fit_scale(t, positions, drag=TENNIS, sd=2e-3 / 0.37 if told else None)
        assert fit is not None
        z.append((fit.scale - 0.37) / fit.sd)
    # Over 200 seeds a standard deviation of 1 comes out as 1 ± 0.05, a mean of 0 as ± 0.07.
    assert np.std(z) == pytest.approx(1, abs=0.15)
    assert np.mean(z) == pytest.approx(0, abs=0.25)


def test_the_moon_is_told() -> None:
    t, positions, _ = thrown(2.0, 5, drag=0.0)
    fit = physinc.fit_scale(t, positions, drag=0.0, gravity=1.62)
    assert fit is not None
    assert fit.scale == pytest.approx(2.0 * 1.62 / 9.81, rel=1e-5)


def test_what_is_no_flight_has_no_scale() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(30) / 30
    line = np.outer(t, [2.0, 0.5, 1.0])
    for noise in (1e-3, 0.03):
        assert physinc.fit_scale(t, line + rng.normal(0, noise, line.shape)) is None
    assert physinc.fit_scale(t, line) is None
    assert physinc.fit_scale(t, np.ones((30, 3))) is None
    circle = np.stack([np.cos(7 * t), np.sin(7 * t), 0 * t], 1)
    assert physinc.fit_scale(t, circle + rng.normal(0, 1e-3, circle.shape)) is None


def bouncing(scale: float, seed: int, noise: float = 1e-3) -> tuple[Array, Array]:
    """A ball with two bounces off the floor."""
    rng = np.random.default_rng(seed)
    t, z, vz, out = np.arange(60) / 30, 1.0, 1.0, []
    for _ in t:
        out.append(z)
        for _ in range(20):
            z, vz = z + vz / 600 - 4.905 / 600**2, vz - 9.81 / 600
            if z < 0:
                z, vz = -z, -0.75 * vz
    p = np.stack([0.8 * t, 0.2 * t, out], 1)
    return t, (p + rng.normal(0, noise, p.shape)) @ turned(rng).T / scale


def test_bounces_part_flights() -> None:
    t, positions = bouncing(0.25, 2)
    assert physinc.fit_scale(t, positions) is None
    flights = physinc.split_flights(t, positions)
    assert len(flights) >= 3
    for flight in flights[:3]:
        fit = physinc.fit_scale(t[flight], positions[flight], drag=0.0)
        assert fit is not None
        assert abs(fit.scale - 0.25) < 4 * fit.sd


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"gravity": -1.0}, "gravity = -1"),
        ({"sd": 0.0}, "sd = 0"),
        ({"drag": -1.0}, "drag = -1"),
        ({"positions": np.zeros((4, 3)), "t": np.arange(4.0)}, "at least 6 positions"),
        ({"t": np.zeros(10)}, "t must rise"),
        ({"positions": np.full((10, 3), np.nan)}, "finite"),
    ],
)
def test_misuse_is_named(wrong: dict[str, Any], words: str) -> None:
    arguments = {"t": np.arange(10.0), "positions": np.zeros((10, 3)), **wrong}
    with pytest.raises(ValueError, match=words):
        physinc.fit_scale(arguments.pop("t"), arguments.pop("positions"), **arguments)


def write(path: Path, tracks: dict[int, tuple[Array, Array]]) -> Path:
    lines = ["t,x,y,z,track"]
    for track, (t, positions) in tracks.items():
        lines += [f"{now:.9f},{x:.9f},{y:.9f},{z:.9f},{track}" for now, (x, y, z) in zip(t, positions, strict=True)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def mixed(tmp_path: Path) -> Path:
    """Three balls of one scale, one of another, one that rolls, one that bounces at the same scale."""
    rotation = turned(np.random.default_rng(9))
    tracks = {i: thrown(0.4, 20 + i, noise=1e-3, rotation=rotation)[:2] for i in (1, 2, 3)}
    tracks[4] = thrown(0.9, 24, noise=1e-3, rotation=rotation)[:2]
    t = np.arange(25) / 30
    tracks[5] = t, np.outer(t, [1.0, 2.0, 0.0]) + np.random.default_rng(3).normal(0, 2e-3, (25, 3))
    tracks[6] = bouncing(0.4, 30)
    return write(tmp_path / "mixed.csv", tracks)


def test_the_largest_group_and_the_others_are_told(mixed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scale", str(mixed), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    first, second = told["groups"]
    assert first["tracks"] == [1, 2, 3, 6]
    assert abs(first["scale"] - 0.4) < 4 * first["sd"]
    assert first["p_value"] > 1e-3
    assert second["tracks"] == [4]
    assert abs(second["scale"] - 0.9) < 4 * second["sd"]
    by_track = {track["track"]: track for track in told["tracks"]}
    assert by_track[4]["p_value"] < 1e-6 < by_track[1]["p_value"]
    assert by_track[6]["flights"] >= 2
    (refused,) = told["refused"]
    assert refused["track"] == 5
    assert "straight" in refused["reason"]


def test_covariances_of_a_csv_weigh_its_positions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t, positions, _ = thrown(0.4, 7)
    sd = np.where(np.arange(20) % 2, 1e-3, 4e-3)
    positions = positions + np.random.default_rng(8).normal(size=(20, 3)) * sd[:, None]
    path = tmp_path / "flight.csv"
    rows = [
        ",".join(map(repr, [*row, s * s, 0.0, 0.0, s * s, 0.0, s * s]))
        for row, s in zip(np.c_[t, positions].tolist(), sd.tolist(), strict=True)
    ]
    path.write_text("t,x,y,z,xx,xy,xz,yy,yz,zz\n" + "\n".join(rows) + "\n")

    def told(*options: str) -> tuple[float, float]:
        assert main(["scale", str(path), "--json", *options]) == 0
        (track,) = json.loads(capsys.readouterr().out)["tracks"]
        assert track["positions"] == 20
        return track["scale"], track["sd"]

    weighed = physinc.fit_scale(t, positions, covariance=np.eye(3) * sd[:, None, None] ** 2)
    alike = physinc.fit_scale(t, positions, sd=2e-3)
    assert weighed is not None
    assert alike is not None
    assert told() == pytest.approx((weighed.scale, weighed.sd), rel=1e-6)
    assert told("--sd", "2e-3") == pytest.approx((alike.scale, alike.sd), rel=1e-6)
    assert weighed.sd < alike.sd
    # Where a position has none, all weigh the same.
    path.write_text(path.read_text().replace(rows[3], ",".join(rows[3].split(",")[:4]) + ",,,,,,"))
    plain = physinc.fit_scale(t, positions)
    assert plain is not None
    assert told() == pytest.approx((plain.scale, plain.sd), rel=1e-6)


def test_people_get_a_table(mixed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scale", str(mixed)]) == 0
    out = capsys.readouterr().out
    assert "A: tracks 1, 2, 3, 6 agree on 0." in out
    assert "B: track 4 has another scale, 0." in out
    assert "track 5: no scale: " in out


def test_a_track_of_its_own_accord_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t = np.arange(60) / 30
    circle = np.stack([np.cos(5 * t), np.sin(5 * t), 0.1 * t], 1) + np.random.default_rng(4).normal(0, 1e-3, (60, 3))
    assert main(["scale", str(write(tmp_path / "drone.csv", {7: (t, circle)}))]) == 1
    captured = capsys.readouterr()
    assert "track 7: no scale" in captured.out
    assert "no trajectory in it flies freely" in captured.err


@pytest.mark.parametrize(
    ("text", "words", "code"),
    [
        ("t,x,y\n0,0,0\n", "no column `z`", 1),
        ("t,x,y,z\n0,0,0,up\n", "line 2", 1),
        ("t,x,y,z\n", "no positions", 1),
        ("t,x,y,z,track\n0,0,0,0,a\n", "track", 1),
        (None, "nothing.csv", 1),
    ],
)
def test_bad_files_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str | None, words: str, code: int) -> None:
    path = tmp_path / "nothing.csv"
    if text is not None:
        path.write_text(text)
    assert main(["scale", str(path)]) == code
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


def test_two_objects_in_one_track_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t, positions, _ = thrown(1.0)
    path = write(tmp_path / "two.csv", {1: (np.repeat(t, 2), np.repeat(positions, 2, axis=0))})
    assert main(["scale", str(path)]) == 1
    assert "several objects in one track" in capsys.readouterr().out


def test_groups_are_the_largest_that_agree() -> None:
    found = groups([1.0, 1.1, 0.95, 5.0, 5.05, 9.0], [0.1] * 6)
    assert [set(group.members) for group in found] == [{0, 1, 2}, {3, 4}, {5}]
    assert found[0].sd == pytest.approx(0.1 / math.sqrt(3))
    assert groups([], []) == []
    # Uncertain ones agree with anything near, and weigh little.
    assert groups([1.0, 1.001, 3.0], [0.001, 0.001, 1.5])[0].mean == pytest.approx(1.0005, abs=1e-4)


@pytest.mark.parametrize(
    ("x", "dof", "p"), [(3.841459, 1, 0.05), (13.815511, 2, 1e-3), (16.266236, 3, 1e-3), (18.307038, 10, 0.05), (67.504807, 50, 0.05)]
)
def test_chi_squared_tails_are_those_of_tables(x: float, dof: int, p: float) -> None:
    assert chi2_sf(x, dof) == pytest.approx(p, rel=1e-5)


@pytest.mark.parametrize(
    ("option", "value"), [("sd", "1e-12"), ("sd", "1e9"), ("sd", "nan"), ("gravity", "inf"), ("drag", "inf"), ("drag", "nan")]
)
def test_what_cannot_be_is_a_usage_error(mixed: Path, capsys: pytest.CaptureFixture[str], option: str, value: str) -> None:
    assert main(["scale", str(mixed), f"--{option}", value]) == 2
    assert f" for --{option}. Must be " in capsys.readouterr().err


def test_stamps_may_be_as_far_apart_as_there_are(tmp_path: Path) -> None:
    path = tmp_path / "far.csv"
    path.write_text("t,x,y,z\n-9000000000,0,0,0\n9000000000,0,0,0\n")
    assert read_positions(path)[0].tolist() == [0, 18e9]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with a name are POSIX's")
@pytest.mark.parametrize("opened", [False, True])
def test_ctrl_c_ends_a_silent_pipe(tmp_path: Path, opened: bool) -> None:
    pipe = tmp_path / "live.csv"
    os.mkfifo(pipe)
    writer = os.open(pipe, os.O_RDWR) if opened else None
    code = "import sys; from physinc.cli import main; print(flush=True); sys.exit(main())"
    with subprocess.Popen([sys.executable, "-c", code, "scale", str(pipe)], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        try:
            assert process.wait(timeout=10) == 130
        finally:
            process.kill()
    if writer is not None:
        os.close(writer)
