"""The command line: `physinc run SOURCE` and its kin."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter, validators

from . import __version__
from ._physinc import dump_config as configuration_in_force
from ._physinc import open_recording
from ._physinc import simulate as simulate_scene
from .device_commands import devices, doctor
from .errors import (
    ConfigError,
    DeviceDisconnectedError,
    DeviceNotFoundError,
    PhysincError,
    StreamTimeoutError,
    UnknownSourceError,
)
from .escaping import escape_output
from .interrupting import interruptible
from .level import Level, gravity_of
from .level_command import level as level_camera
from .motor_commands import led, tilt
from .narration import Narration, Plain, Progress, remark
from .options import Flag, Frames
from .reproduce_command import reproduce
from .scale_command import scale
from .streaming import open_named, path_of

app = App(
    name="physinc",
    version=__version__,
    console=Plain(),
    suppress_keyboard_interrupt=False,
    help="""Watch a depth camera, or a ball's trajectory, and tell what happened, physically: where a ball bounced,
    off which surfaces, even those that the camera can't see.

    Try `physinc run demo`: a ball is thrown over a floor and a box of glass.

    Exit codes: 0 the source ended, 1 it broke, 2 usage or configuration, 3 no device, 4 disconnected, 130 Ctrl-C.""",
)


def no_option(_: Any, source: str | None) -> None:
    """Of what begins with a hyphen only `-` is a source."""
    if source is not None and source.startswith("-") and source != "-":
        raise ValueError(f"there is no option {source}")


EXIT_CODES = {
    ConfigError: 2,
    UnknownSourceError: 2,
    DeviceNotFoundError: 3,
    DeviceDisconnectedError: 4,
}
"""Of what else goes wrong it is 1."""


@app.command
def run(
    source: Annotated[str | None, Parameter(allow_leading_hyphen=True, validator=no_option)] = None,
    /,
    *,
    json: Annotated[bool, Flag] = False,
    positions: Annotated[bool, Flag] = False,
    provisional: Annotated[bool, Flag] = False,
    config: Path | None = None,
    camera: Path | None = None,
    frames: Frames = None,
    duration: Annotated[float | None, Parameter(validator=validators.Number(gte=0))] = None,
    every_frame: Annotated[bool, Flag] = False,
    level: Annotated[Level | None, Parameter(show_default=False)] = None,
    reconnect: Annotated[float | None, Parameter(validator=validators.Number(gte=0))] = None,
    record: Annotated[Path | None, Parameter(show_default=False)] = None,
    tum: Annotated[bool, Flag] = False,
    dump_config: Annotated[bool, Flag] = False,
) -> int:
    """Tell what happens in SOURCE, as it happens.

    Parameters
    ----------
    source
        demo: a recording inside the package. FILE.npz: depth frames (timestamps_ns [N] int64, and depth_mm or disparity [N,H,W] uint16).
        FILE.pcapng or .pcap, also .gz or .zst: a usbmon capture of a Kinect; "FILE.pcapng?lose=0.05&seed=3" with faults on purpose
        (probabilities of a packet: lose, empty, short, double, foreign, late, flip, silence; burst=10, the mean length of losses).
        A folder with INDEX.txt (fakenect) or depth.txt (TUM RGB-D): depth frames, one a file.
        FILE.csv, or - for stdin: positions, with the header t,x,y,z (s, m, z up) and optionally track, xx,xy,xz,yy,yz,zz.
        sim:SCENE: a simulated scene, "sim:bounce?seed=3"; physinc simulate --help names all; with packets=1 as a Kinect sends it.
        Left out, or kinect: a live Kinect; kinect:SERIAL the one of that serial number, or place (1-2.1), or index (0, 1, …);
        "kinect?transfers=16&packets=8": so many transfers of so many packets under way, fewer packets come sooner and cost more;
        video=color or video=infrared, too, is of use in Python.
    json
        Print events, one JSON object a line, and nothing else; messages go to stderr.
    positions
        Tell every position of every ball.
    provisional
        Also tell events that a later one will replace.
    config
        TOML file; --dump-config prints one to start from.
    camera
        Camera file, instead of NAME.camera.toml or camera.toml beside the recording.
    frames
        Stop after so many frames.
    duration
        Stop after so many seconds of the stream.
    every_frame
        Live devices wait instead of dropping frames; of recordings every frame is used anyway.
    level
        accelerometer: the world of a live Kinect is level by its own accelerometer; balls that fly otherwise are told.
    reconnect
        A device may be away for so many seconds: the stream goes on when it is back.
    record
        Also record SOURCE there, as physinc record does.
    tum
        A folder that is recorded has the layout of TUM RGB-D.
    dump_config
        Print the configuration in force (for SOURCE, if it is given), and exit.

    """
    if dump_config:
        sys.stdout.write(configuration_in_force(None if source is None else path_of(source), config, camera))
        return 0
    if tum and record is None:
        raise ConfigError("--tum is the layout of the folder that --record names: name it, or leave --tum out")
    source = "kinect" if source is None else source
    # Whoever types into a pipe, or throws the next ball, may take his time.
    timeout = None if source == "-" else 2.0
    stream = open_named(
        source,
        config=config,
        camera=camera,
        positions=positions,
        provisional=provisional,
        level=level,
        frames=frames,
        duration=duration,
        every_frame=every_frame,
        reconnect=reconnect,
        record=record,
        tum=tum,
        timeout=timeout,
    )
    with interruptible(stream, source) as interruption:
        if json:
            for event in stream:
                sys.stdout.write(event.to_json() + "\n")
                sys.stdout.flush()
        else:
            narration = Narration()
            for event in stream:
                narration.tell(event)
            narration.close(stream.busy)
    return 130 if interruption.came else 0


@app.command
def record(
    source: str,
    out: Path,
    /,
    *,
    frames: Frames = None,
    every_frame: Annotated[bool, Flag] = False,
    level: Annotated[Level | None, Parameter(show_default=False)] = None,
    tum: Annotated[bool, Flag] = False,
) -> int:
    """Record SOURCE in OUT, with the camera in camera.toml, for `physinc run OUT`.

    That tells the same as SOURCE, unless packets were lost: only a capture (pcapng) keeps that they were. In other formats every sample
    that came is the same, and lost ones read as 2047, like places without a reading.

    Parameters
    ----------
    source
        Any source of depth frames, as for run.
    out
        FILE.npz (disparity as it is, depth in whole mm), or else a folder in fakenect's layout: stamps become ticks of 60 MHz, at most
        8 ns away. Of a source of packets also FILE.pcapng, FILE.pcapng.gz or FILE.pcapng.zst: the packets themselves. Nothing is
        overwritten. A folder is readable up to its last frame even if the recording is killed, a file up to its last second.
    frames
        Stop after so many frames.
    every_frame
        Live devices wait instead of dropping frames; of recordings every frame is used anyway.
    level
        accelerometer: camera.toml tells what a live Kinect's accelerometer says, so that the recording's world is level, too.
    tum
        The folder has the layout of TUM RGB-D instead, which keeps every stamp and every sample.

    """
    del every_frame
    # Ctrl-C ends the recording, which is completed first.
    with (
        open_recording(path_of(source), out, gravity=gravity_of(source, level), tum=tum, frames=frames) as recording,
        Progress(out, frames) as progress,
    ):
        try:
            for _, timestamp_ns in recording:
                progress.tell(recording.counters, recording.bytes, timestamp_ns)
        finally:
            # Ctrl-C comes between a frame and its telling, too.
            progress.tell(recording.counters, recording.bytes)
        remarks = recording.remarks
    remark(source, remarks)
    return 0


@app.command
def simulate(scene: str, out: Path, /) -> int:
    """Simulate SCENE into OUT, with the camera in OUT.camera.toml and the truth in OUT.truth.json.

    Parameters
    ----------
    scene
        bounce (six throws over a floor and a box that the camera can't see), room, two_balls, many, passive_flight, drop, roll,
        rotated_camera (rolled by roll_deg), translating_camera (a hand moves it in mid-flight by travel, m), flying_robot or toy_car
        (one that takes off, flies and lands; one that drives straight on but for a turn; in these three structure=none, floor, wall or
        both is what else is seen), with keys, if any, as in "bounce?seed=3&distance=2".
    out
        FILE.npz (frames), or FILE.pcapng, also .gz or .zst (a capture of the packets that a Kinect would send). `physinc run OUT` tells
        what happens in it. Only another simulation is overwritten.

    """
    frames, balls, contacts = simulate_scene(scene, out)
    sys.stderr.write(f"{out}: {frames} frames, {balls} throws, {contacts} contacts\n")
    return 0


for command in (level_camera, scale, reproduce, tilt, led, devices, doctor):
    app.command(command)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; its exit code."""
    for name in ("stdout", "stderr"):
        # Whoever closed it beforehand doesn't read either.
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 - as long as the program runs
    escape_output()
    try:
        return int(app(arguments, exit_on_error=False, result_action="return_value") or 0)
    except CycloptsError:
        return 2
    except KeyboardInterrupt:
        sys.stderr.write("physinc: interrupted\n")
        return 130
    except BrokenPipeError:
        # Whoever read has heard enough; what is still buffered goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except StreamTimeoutError as error:
        # What it says of `timeout=` is for Python.
        silent, python, _ = str(error).partition("; timeout=")
        waiting = "; `physinc doctor` looks why a Kinect is silent, positions on stdin (`physinc run -`) are awaited as long as it takes"
        sys.stderr.write(f"physinc: {silent}{waiting if python else ''}\n")
        return 1
    except (PhysincError, OSError) as error:
        sys.stderr.write(f"physinc: {error}\n")
        return next((code for kind, code in EXIT_CODES.items() if isinstance(error, kind)), 1)
