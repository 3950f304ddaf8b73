"""`physinc reproduce`: the page stands by itself, its figures are labelled, its numbers are the events'."""

from __future__ import annotations

import base64
import html
import importlib.util
import math
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import physinc
from physinc import reproduce_command
from physinc.cli import main
from physinc.reproduce import recordings, style
from physinc.reproduce.all import EXPERIMENTS
from physinc.reproduce.experiment import Section, spread
from physinc.reproduce.observation import PAPER, observe
from physinc.reproduce.page import page
from physinc.reproduce.run import unheard
from physinc.reproduce.surfaces import SCENE, estimated, table

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("made") / "deep" / "page"
    assert main(["reproduce", "--out", str(out), "--seeds", "2", "--only", "surfaces"]) == 0
    return out


def cells(text: str, first: str) -> list[str]:
    """The row of a table of the page that begins with `first`."""
    rows = ([html.unescape(cell) for cell in re.findall(r"<td>(.*?)</td>", row)] for row in re.findall(r"<tr>(.*?)</tr>", text))
    return next(row[1:] for row in rows if row[:1] == [first])


def test_the_page_needs_nothing_else(made: Path) -> None:
    text = (made / "index.html").read_text()
    images = re.findall(r'<img[^>]*src="([^"]*)"', text)
    assert len(images) == 5
    for image in images:
        kind, _, content = image.partition(",")
        assert kind == "data:image/png;base64"
        assert base64.b64decode(content, validate=True).startswith(PNG)
    rest = re.sub(r"base64,[A-Za-z0-9+/=]+", "", text)
    assert not re.search(r"https?:|//|<script|<link|url\(|@import", rest)
    assert all(href.startswith("#") for href in re.findall(r'href="([^"]*)"', text))
    for figure in ("3", "4", "9", "10", "11"):
        assert f"Counterpart of figure {figure}:" in text


def test_figures_are_written_beside_it(made: Path) -> None:
    inside = {base64.b64decode(content) for content in re.findall(r"base64,([A-Za-z0-9+/=]+)", (made / "index.html").read_text())}
    files = {path.name: path.read_bytes() for path in made.glob("*.png")}
    assert set(files.values()) == inside
    assert sorted(files)[0] == "figure_03_inconsistency.png"


def test_table_1_says_what_the_events_say(made: Path) -> None:
    text = (made / "index.html").read_text()
    first = reproduce_command.FIRST_SEED
    for column, config in ((2, PAPER), (3, None)):
        heights, tilts = [], []
        for seed in (first, first + 1):
            seen = observe(SCENE.format(seed), config)
            surfaces = [s for s in seen.of(physinc.Surface) if s.merged_into is None]
            ground, box = sorted(sorted(surfaces, key=lambda s: -s.contacts)[:2], key=lambda s: s.offset)
            assert box.above is not None
            assert ground.tilt is not None
            if box.above.surface == ground.id:
                heights.append(1e3 * box.above.height)
            else:
                # The paper's scattered contacts made a third plane between the two.
                assert config is PAPER
                heights.append(1e3 * float(np.mean(np.asarray(box.outline) @ ground.normal - ground.offset)))
            tilts.append(math.degrees(ground.tilt))
        assert cells(text, "box height")[column] == f"{np.mean(heights):.2f} ± {np.std(heights, ddof=1):.2f} mm"
        assert cells(text, "ground orientation")[column] == f"{np.mean(tilts):.2f} ± {np.std(tilts, ddof=1):.2f} °"
    assert cells(text, "box height")[:2] == ["90 mm", "92 mm"]
    assert cells(text, "box top orientation")[:2] == ["0°", "4.8°"]
    assert cells(text, "ground orientation")[:2] == ["0°", "5.6°"]


def test_what_is_not_found_is_not_made_up() -> None:
    assert spread([math.nan, math.nan], 1, "mm", 2) == "not found"
    assert spread([1.0, math.nan, 3.0], 1, "mm", 3) == "2.0 ± 1.4 mm (2 of 3)"
    assert spread([1.0], 2, "mm", 1) == "1.00 mm"
    # Before a scene in which nothing is touched there is no table to be filled.
    nothing = estimated(observe("passive_flight?throws=1"), paper=False)
    assert all(math.isnan(x) for x in (nothing.height, nothing.box_tilt, nothing.ground_tilt))
    assert table([nothing], [nothing]).rows[0][3:] == ["not found", "not found"]


def test_an_axis_without_a_unit_is_refused() -> None:
    figure, axes = style.sheet(1, 2)
    style.label(axes[0], "time / s", "height / m")
    with pytest.raises(ValueError, match="without unit"):
        style.png(figure)
    style.label(axes[1], "time / s", "height")
    with pytest.raises(ValueError, match="height"):
        style.png(figure)
    style.label(axes[1], "time / s", "height / m")
    assert style.png(figure).startswith(PNG)


def test_colours_differ_in_grey() -> None:
    def grey(color: str) -> float:
        if not color.startswith("#"):
            return float(color)
        r, g, b = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
        return 0.299 * r + 0.587 * g + 0.114 * b

    styles: list[Any] = [style.TRUE, style.MEASURED, style.PREDICTED, style.PAPER]
    greys = sorted(grey(one["color"]) for one in styles)
    assert min(np.diff(greys)) > 0.1


def test_words_are_escaped() -> None:
    text = page([Section("<b>", "a & b", [])], command="x", seeds=[1], seconds=1.0, left_out=["<i>"])
    assert "&lt;b&gt;" in text
    assert "a &amp; b" in text
    assert "<i>" not in text


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(reproduce_command, "find_spec", lambda name: None if name == "matplotlib" else real(name))
    assert main(["reproduce", "--out", str(tmp_path / "x")]) == 2
    error = capsys.readouterr().err
    assert "matplotlib" in error
    assert "pip install 'physinc[report]'" in error
    assert not (tmp_path / "x").exists()


def test_misuse_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "--out", str(tmp_path), "--only", "everything"]) == 2
    assert "everything" in capsys.readouterr().err
    (tmp_path / "file").touch()
    assert main(["reproduce", "--out", str(tmp_path / "file"), "--seeds", "1", "--only", "surfaces"]) == 1
    assert "file" in capsys.readouterr().err


def children(process: int) -> list[int]:
    told = Path(f"/proc/{process}/task/{process}/children").read_text()
    return [int(child) for child in told.split()]


def lives(process: int) -> bool:
    """Whether it does more than wait for someone to ask how it ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="asks Linux's /proc for a process's children: run it on Linux")
@pytest.mark.parametrize("to_all", [False, True])
@pytest.mark.parametrize("seconds", [0.0, 0.3, 6.0])
def test_ctrl_c_ends_it_soon(tmp_path: Path, to_all: bool, seconds: float) -> None:
    code = "import sys; from physinc.cli import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "reproduce", "--out", str(tmp_path / "out"), "--seeds", "50"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        # Two at work, and who watches over what they share.
        while process.poll() is None and len(at_work := children(process.pid)) < 3:
            time.sleep(0.01)
        time.sleep(seconds)
        (os.killpg if to_all else os.kill)(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=10)
    assert (process.returncode, out, err) == (130, "", "physinc: interrupted\n")
    deadline = time.monotonic() + 10
    while any(map(lives, at_work)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(lives, at_work))


@pytest.mark.parametrize("to_other", [False, True])
@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="signals one thread, which Windows can't: run it on Linux or macOS")
def test_ctrl_c_waits_until_processes_have_begun(to_other: bool) -> None:
    ending = threading.Event()
    other = threading.Thread(target=ending.wait)
    other.start()
    begun = []

    def begin() -> None:
        with unheard():
            told = other if to_other else threading.main_thread()
            assert told.ident is not None
            signal.pthread_kill(told.ident, signal.SIGINT)
            time.sleep(0.1)
            begun.append(True)

    # Who runs tests in the background may have it ignored.
    outer = signal.signal(signal.SIGINT, signal.default_int_handler)
    before = signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    try:
        with pytest.raises(KeyboardInterrupt):
            begin()
        assert begun == [True]
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        signal.signal(signal.SIGINT, outer)
        ending.set()
        other.join()


def test_what_is_lacking_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    there = physinc._physinc.scenes()
    for experiment in EXPERIMENTS:
        # Whatever is lacking is no scene.
        assert not set(experiment.scenes) - set(there)
        if experiment.scenes:
            assert experiment.lacks(there) is None
            assert experiment.lacks([]) == f"there is no scene {', '.join(experiment.scenes)}"
    monkeypatch.setenv("PHYSINC_DATA", str(tmp_path))
    assert str(tmp_path / "jugglebot-mocap") in (recordings.EXPERIMENT.lacks(there) or "")


def test_recordings_are_beside_the_project_wherever_one_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    named, project, here = (tmp_path / name / "shared" / "data" / "jugglebot-mocap" for name in ("named", "project", "here"))
    (tmp_path / "here" / "work").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "here" / "work")
    assert recordings.BESIDE[0] == Path(__file__).resolve().parents[2]
    monkeypatch.setattr(recordings, "BESIDE", (tmp_path / "project", recordings.BESIDE[1]))
    monkeypatch.delenv("PHYSINC_DATA", raising=False)
    assert recordings.folder() is None
    here.mkdir(parents=True)
    assert recordings.folder() == Path("../shared/data/jugglebot-mocap")
    project.mkdir(parents=True)
    assert recordings.folder() == project
    monkeypatch.setenv("PHYSINC_DATA", str(named.parent))
    assert recordings.folder() is None
    named.mkdir(parents=True)
    assert recordings.folder() == named


@pytest.fixture(scope="module")
def others(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All experiments but that of the surfaces, as small as they can be."""
    out = tmp_path_factory.mktemp("others")
    names = [experiment.name for experiment in EXPERIMENTS if experiment.name != "surfaces"]
    assert main(["reproduce", "--out", str(out), "--seeds", "1", *(f"--only={name}" for name in names)]) == 0
    return out


def number(cell: str) -> float:
    """The first one in a cell."""
    return float(cell.split(maxsplit=1)[0])


def test_the_others_have_their_figures_and_scenes(others: Path) -> None:
    drawn = {
        "figure_05_derotation",
        "figure_06_acceleration",
        "figure_07_frames",
        "figure_08_translation",
        "figure_12_flying_robot",
        "figure_13_tennis_ball",
        "figure_14_toy_car",
        "theta_of_laws",
        *(["recordings_scale"] if recordings.folder() else []),
    }
    assert {path.stem for path in others.glob("*.png")} == drawn
    assert all(path.read_bytes().startswith(PNG) for path in others.glob("*.png"))
    text = (others / "index.html").read_text()
    named = {scene for experiment in EXPERIMENTS if experiment.name != "surfaces" for scene in experiment.scenes}
    assert set(re.findall(r"sim:(\w+)", text)) == named


def test_the_roll_of_a_camera_is_found(others: Path) -> None:
    text = (others / "index.html").read_text()
    for flights in ("one flight", "six flights"):
        for column in (2, 3):
            assert number(cells(text, f"roll, {flights}")[column]) == pytest.approx(18, abs=1)
            assert number(cells(text, f"size of acceleration, {flights}")[column]) == pytest.approx(9.81, abs=0.2)
        assert 0 < number(cells(text, f"gravity's direction off, {flights}")[3]) < 0.5


def test_the_way_of_a_camera_is_found(others: Path) -> None:
    text = (others / "index.html").read_text()
    actual, _, _, *ours = map(number, cells(text, "from start to end"))
    assert actual == pytest.approx(155, abs=1)
    assert ours == pytest.approx([actual, actual], abs=5)
    off = [number(cell) for cell in cells(text, "its error")[3:]]
    assert off == pytest.approx([one - actual for one in ours], abs=0.11)
    axes = ("to the right", "away", "up")
    for column in (2, 3, 4):
        along = [number(cells(text, f"path, {axis} (rms)")[column]) for axis in axes]
        assert number(cells(text, "path in space (rms)")[column]) == pytest.approx(math.hypot(*along), abs=0.2)


def test_motors_are_told_from_gravity(others: Path) -> None:
    text = (others / "index.html").read_text()
    for what, active in (("flying robot, flying", 100), ("tennis ball, flying", 0), ("toy car, straight", 0), ("toy car, turning", 100)):
        actual, _, _, ours = cells(text, what)
        assert number(actual) == active
        assert number(ours) == pytest.approx(active, abs=10)


def test_better_laws_allow_a_smaller_threshold(others: Path) -> None:
    text = (others / "index.html").read_text()
    for better, worse in (("free fall with drag", "free fall"), ("rolling friction", "constant velocity")):
        good, bad = cells(text, better), cells(text, worse)
        assert good[:2] == bad[:2]
        assert int(good[1]) > 10
        assert 0 < number(good[3]) < number(bad[3])


def test_a_millimetre_is_one_as_balls_fall(others: Path) -> None:
    where = recordings.folder()
    if where is None:
        pytest.skip(f"no real recordings at {' or '.join(map(str, recordings.places()))} (PHYSINC_DATA names another folder)")
    text = (others / "index.html").read_text()
    files = [*where.glob("*.tsv"), *where.glob("*.json")]
    assert files
    for path in files:
        flights, median, scatter, _ = cells(text, path.name)
        assert int(flights) >= 3
        assert number(median) == pytest.approx(1, abs=0.03)
        assert 0 < number(scatter) < 0.05
