"""The command line: what it prints, its exit codes, Ctrl-C and closed pipes."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from physinc._physinc import event_from_toml
from physinc.errors import UnknownSourceError
from physinc.narration import Narration
from physinc.streaming import DEMO, stream

PHYSINC = [sys.executable, "-c", "import sys; from physinc.cli import main; sys.exit(main())"]


def physinc(*arguments: str | Path, stdin: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run([*PHYSINC, *map(str, arguments)], input=stdin, capture_output=True, text=True, timeout=60, check=False)


def started(*arguments: str | Path) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    return subprocess.Popen([*PHYSINC, *arguments], stdin=pipe, stdout=pipe, stderr=pipe, text=True, bufsize=1)


def events(out: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in out.splitlines()]


def test_json_is_one_event_a_line_and_nothing_else(csv: Path) -> None:
    done = physinc("run", csv, "--json")
    told = events(done.stdout)
    assert done.returncode == 0
    assert done.stderr == ""
    assert (told[0]["event"], told[-1]["event"]) == ("stream_started", "stream_ended")
    assert told[-1]["counters"]["events"] == len(told)
    assert all(event["final"] for event in told)
    assert "position" not in {event["event"] for event in told}


def test_positions_and_provisional_events_come_when_asked_for(csv: Path) -> None:
    told = events(physinc("run", csv, "--json", "--positions", "--provisional").stdout)
    assert sum(event["event"] == "position" for event in told) > 100
    assert not all(event["final"] for event in told)


def test_limits_end_a_stream(csv: Path) -> None:
    assert events(physinc("run", csv, "--json", "--frames", "10").stdout)[-1]["counters"]["frames"] == 10
    end = events(physinc("run", csv, "--json", "--duration", "0.5").stdout)[-1]
    assert (end["reason"], end["counters"]["frames"]) == ("limit", 51)


def test_people_are_told_of_bounces_surfaces_and_counters() -> None:
    done = physinc("run", "demo")
    assert done.returncode == 0
    assert done.stdout.count("bounce of ball") >= 10
    assert "mm above surface" in done.stdout
    assert "µs a frame" in done.stdout.splitlines()[-1]


def test_positions_have_gravity_but_no_camera(csv: Path) -> None:
    told = physinc("run", csv).stdout.splitlines()
    assert any(line.startswith("gravity 9.") for line in told)
    assert not any("roll" in line or "pitch" in line for line in told)
    assert any(line.startswith("camera: roll ") for line in physinc("run", "demo").stdout.splitlines())


def test_stdin_is_read(csv: Path) -> None:
    piped = events(physinc("run", "-", "--json", stdin=csv.read_text()).stdout)
    named = events(physinc("run", csv, "--json").stdout)
    assert piped[0]["source"] == "-"
    assert piped[1:] == named[1:]


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["run", "nowhere.npz"], 1, "no such file"),
        (["run", "nowhere.txt"], 1, "no such file"),
        (["run", "/"], 2, "sources are"),
        (["run", ""], 2, "a source without a name"),
        (["run", "", "--dump-config"], 2, "a source without a name"),
        (["run", os.fsdecode(b"\xff.npz")], 2, "must be UTF-8"),
        (["run", os.fsdecode(b"\xff.npz"), "--dump-config"], 2, "must be UTF-8"),
        (["run", "nowhere.npz", "--dump-config"], 1, "no such file"),
        (["run", "sim:nowhere", "--dump-config"], 2, "there is no scene"),
        (["run", "sim:nowhere"], 2, "there is no scene"),
        (["run", "sim:bounce?seed=-1"], 2, "seed=-1"),
        (["run", "sim:bounce?distance=100"], 2, "distance=100"),
        (["run", f"{DEMO}?lose=2"], 2, "lose"),
        (["run", "kinect?video=blue"], 2, "video"),
        (["run", "demo", "--config", "nowhere.toml"], 2, "nowhere.toml"),
        (["run", "demo", "--camera", "nowhere.toml"], 2, "nowhere.toml"),
        (["run", "sim:drop", "--camera", "nowhere.toml"], 2, "nowhere.toml"),
        (["run", "demo?loose=1"], 2, "no fault `loose`"),
        (["run", f"{__file__}?lose=0.1"], 2, "sources are"),
        (["run", f"{DEMO.parent}?lose=0.1"], 2, "sources are"),
        (["run", "demo", "--frames", "0"], 2, "frames"),
        (["run", "demo", "--frames", "1.5"], 2, "1.5 is no whole number"),
        (["record", "demo", "/nowhere/out.npz", "--frames", "1.5"], 2, "1.5 is no whole number"),
        (["level", "demo", "--frames", "2.0"], 2, "2.0 is no whole number"),
        (["reproduce", "--seeds", "1.5", "--only", "nothing"], 2, "1.5 is no whole number"),
        (["run", "demo", "--frames", "99999999999999999999"], 2, "frames"),
        (["run", "demo", "--tum"], 2, "--record"),
        (["run", "demo", "--nonsense"], 2, "nonsense"),
        (["run", "demo", "twice"], 2, "twice"),
        (["nonsense"], 2, "nonsense"),
        (["run"], 3, "physinc run demo"),
        (["run", "kinect:1"], 3, "physinc run demo"),
        (["record", "nowhere.npz", "out.npz"], 1, "no such file"),
        (["record", os.fsdecode(b"\xff.npz"), "out.npz"], 2, "must be UTF-8"),
        (["record", "demo", "/nowhere/out.npz"], 1, "make the folder first"),
        (["level", "demo", "--config", "nowhere.toml"], 2, "nowhere.toml"),
        (["simulate", "nowhere", "out.npz"], 2, "there is no scene"),
        (["simulate", "drop", "out.png"], 2, ".npz"),
        (["simulate", "drop", "/nowhere/out.npz"], 1, "nowhere"),
    ],
)
def test_errors_have_a_code_and_a_line_on_stderr(arguments: list[str], code: int, message: str) -> None:
    done = physinc(*arguments, *(["--json"] if arguments[0] == "run" else []))
    assert done.returncode == code
    assert message in done.stderr
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert " frames, " not in done.stderr


def test_what_came_before_the_break_is_told(csv: Path) -> None:
    csv.write_text(csv.read_text() + "2.0,1,2,inf\n")
    done = physinc("run", csv, "--json")
    assert done.returncode == 1
    assert "line 202" in done.stderr
    assert events(done.stdout)[-1]["event"] == "stream_ended"


def test_the_configuration_in_force_is_printed_and_read_back(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text("[object]\nradius = 0.02\n")
    printed = physinc("run", "--dump-config", "--config", config)
    assert printed.returncode == 0
    assert "radius = 0.02" in printed.stdout
    config.write_text(printed.stdout)
    assert physinc("run", "--dump-config", "--config", config).stdout == printed.stdout
    config.write_text("[object]\nradius = 0\n")
    refused = physinc("run", "--dump-config", "--config", config)
    assert refused.returncode == 2
    assert "config.toml:2: object.radius = 0" in refused.stderr


def test_the_configuration_of_a_source_is_that_of_its_camera() -> None:
    printed = physinc("run", "demo", "--dump-config")
    assert printed.returncode == 0
    assert "width = 640" in printed.stdout
    positions = physinc("run", "-", "--dump-config").stdout
    assert positions.replace('camera = "static"\n', "") == physinc("run", "--dump-config").stdout != positions


def test_help_names_every_command_and_option() -> None:
    assert {"run", "record", "simulate"} <= set(physinc("--help").stdout.split())
    text = physinc("run", "--help").stdout
    for option in ("json", "positions", "provisional", "config", "camera", "frames", "duration", "every-frame", "reconnect", "dump-config"):
        assert f"--{option}" in text


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_text_goes_out_in_any_encoding(csv: Path, tmp_path: Path, encoding: str) -> None:
    source = csv.rename(tmp_path / "bäll→𝄞.csv")
    environment = {**os.environ, "PYTHONIOENCODING": encoding}

    def out(*arguments: str | Path, codes: tuple[int, ...] = (0,)) -> str:
        done = subprocess.run([*PHYSINC, *map(str, arguments)], capture_output=True, timeout=60, check=False, env=environment)
        assert done.returncode in codes
        assert b"Traceback" not in done.stderr
        return done.stdout.decode(encoding)

    assert events(out("run", source, "--json"))[0]["source"] == str(source)
    assert "bounce of ball" in out("run", "demo")
    assert "roll" in out("level", "demo", "--dry-run")
    assert "bus: " in out("doctor", codes=(0, 1, 3))
    out("scale", source)
    assert out("level", source, codes=(2,)) == ""


@pytest.mark.skipif(os.name != "posix", reason="elsewhere names are text")
def test_a_name_in_utf_8_is_one_in_any_locale(csv: Path, tmp_path: Path) -> None:
    source = csv.rename(tmp_path / "bäll.csv")
    environment = {**os.environ, "PYTHONUTF8": "0", "LC_ALL": "C"}
    for arguments in (["run", source, "--json"], ["run", source, "--dump-config"]):
        done = subprocess.run([*PHYSINC, *map(str, arguments)], capture_output=True, timeout=60, check=False, env=environment)
        assert (done.returncode, done.stderr) == (0, b"")
        if "--json" in arguments:
            assert events(done.stdout.decode())[0]["source"] == str(source)


def test_a_simulation_can_be_run(tmp_path: Path) -> None:
    assert physinc("simulate", "drop", tmp_path / "drop.npz").returncode == 0
    assert any(event["event"] == "contact" for event in events(physinc("run", tmp_path / "drop.npz", "--json").stdout))


def test_what_goes_back_in_a_pipe_is_told_and_counted_once() -> None:
    rows = [0, 1, 2, 3, 4, 5, 6, 7, 2, 3, 8, 9]
    done = physinc("run", "-", stdin="t,x,y,z\n" + "".join(f"{t / 100},0,0,1\n" for t in rows))
    assert done.returncode == 0
    assert "12 frames, 0 lost, 2 not used" in done.stdout
    assert done.stderr == "physinc: -: time stands still or goes back in line 10; not used for that: 2; sort the lines by time\n"


def test_a_pipe_is_read_line_by_line() -> None:
    with started("run", "-", "--json", "--positions") as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write("t,x,y,z\n0,0,0,1\n0.01,0,0,1\n")
        assert json.loads(process.stdout.readline())["event"] == "stream_started"
        out, _ = process.communicate("", timeout=20)
    assert process.returncode == 0
    assert events(out)[-1]["counters"]["frames"] == 2


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
@pytest.mark.parametrize("begun", [False, True])
def test_ctrl_c_ends_a_silent_stream_at_once(begun: bool) -> None:
    with started("run", "-", "--json") as process:
        assert process.stdin is not None
        assert process.stdout is not None
        if begun:
            process.stdin.write("t,x,y,z\n0,0,0,1\n0.01,0,0,1\n")
            process.stdout.readline()
        else:
            time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        process.wait(timeout=20)
        out, err = process.stdout.read(), process.stderr.read() if process.stderr else ""
    assert process.returncode == 130
    assert "Traceback" not in err
    if begun:
        assert events(out)[-1]["reason"] == "interrupted"


def test_a_closed_pipe_is_no_error() -> None:
    for arguments in (["run", "demo", "--json", "--positions"], ["run", "demo"], ["--help"], ["run", "--help"]):
        with started(*arguments) as process:
            assert process.stdout is not None
            assert process.stderr is not None
            if "--help" not in arguments:
                process.stdout.readline()
            process.stdout.close()
            err = process.stderr.read()
            process.wait(timeout=20)
        assert (process.returncode, err) == (0, "")


@pytest.mark.skipif(os.name != "posix", reason="the shell is POSIX's")
def test_what_was_closed_beforehand_is_no_error(csv: Path) -> None:
    for closed in (">&-", "2>&-", ">&- 2>&-"):
        command = ["sh", "-c", f'exec "$@" {closed}', "sh", *PHYSINC, "run", str(csv), "--json"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        assert len(events(done.stdout)) == (0 if closed.startswith(">") else len(events(physinc("run", csv, "--json").stdout)))


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
@pytest.mark.parametrize("module", ["physinc", "numpy", "physinc._physinc", "physinc.cli", "cyclopts", "rich.console"])
def test_ctrl_c_is_quiet_while_it_is_being_loaded(module: str) -> None:
    code = f"""
import os, signal, sys
from importlib.metadata import entry_points
class CtrlC:
    def find_spec(self, name, *rest):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
(command,) = entry_points(group="console_scripts", name="physinc")
sys.meta_path.insert(0, CtrlC())
sys.exit(command.load()())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
@pytest.mark.parametrize("out", ["out.npz", "out.pcapng.zst"])
@pytest.mark.parametrize("scene", ["bounce?throws=1000", "bounce?throws=30"])
def test_ctrl_c_ends_a_simulation_and_leaves_no_file(tmp_path: Path, scene: str, out: str) -> None:
    with started("simulate", scene, tmp_path / out) as process:
        if scene == "bounce?throws=30":
            deadline = time.monotonic() + 30
            while not any(tmp_path.iterdir()) and time.monotonic() < deadline:
                time.sleep(0.05)
        else:
            # Its throws are still being made up.
            time.sleep(3.0)
            assert not any(tmp_path.iterdir())
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        process.wait(timeout=5)
        err = process.stderr.read() if process.stderr else ""
    assert (process.returncode, err) == (130, "physinc: interrupted\n")
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("there", ["out.npz", "out.camera.toml"])
def test_a_simulation_overwrites_only_another(tmp_path: Path, there: str) -> None:
    (tmp_path / there).write_text("mine")
    done = physinc("simulate", "drop", tmp_path / "out.npz")
    assert done.returncode == 2
    assert f"{tmp_path / there}: there is something already" in done.stderr
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(there, "mine")]
    (tmp_path / there).unlink()
    for scene in ("drop?seed=1", "drop?seed=2"):
        assert physinc("simulate", scene, tmp_path / "out.npz").returncode == 0
    assert "drop?seed=2" in (tmp_path / "out.truth.json").read_text()


def test_what_was_dropped_is_told_at_the_end(csv: Path, capsys: pytest.CaptureFixture[str]) -> None:
    *_, end = stream(csv)
    for dropped in (0, 3):
        text = end.__reduce__()[1][0].replace("events_dropped = 0", f"events_dropped = {dropped}")
        narration = Narration()
        narration.tell(event_from_toml(text))
        narration.close(0.0)
        assert ("3 positions or events dropped (more than 16 objects at once" in capsys.readouterr().out) == (dropped > 0)


def test_every_kind_of_source_is_named_where_sources_are_explained(tmp_path: Path) -> None:
    """As the engine lists them where a name says nothing, and the keys of a Kinect."""
    with pytest.raises(UnknownSourceError) as unknown:
        stream(tmp_path)
    kinds = re.findall(r"sim:SCENE|kinect:SERIAL|\w+\.txt|\.\w+|\bkinect|demo|-(?= \()", str(unknown.value).partition("sources are ")[2])
    assert {"kinect", "sim:SCENE", ".npz", ".pcapng", "INDEX.txt", "-", "demo"} <= set(kinds)
    shown = physinc("run", "--help").stdout, stream.__doc__ or ""
    for text in shown:
        for kind in [*kinds, "transfers=", "packets=", "video=", "lose="]:
            assert re.search(rf"(?<![\w-]){re.escape(kind)}" if kind[0].isalpha() or kind == "-" else re.escape(kind), text), kind
