"""Programs beside a Kinect that isn't there: `rust/virtual`, built once."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent

VirtualKinect = Callable[..., list[str]]


@pytest.fixture(scope="session")
def virtual_kinect() -> VirtualKinect:
    """The beginning of a command line: `[*virtual_kinect("sim:bounce", "--faults", "lose=0.1"), "physinc", "run", "kinect"]`."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    manifest = ROOT / "rust/virtual/Cargo.toml"
    build = ["cargo", "build", "--release", "--locked", "--quiet", "--manifest-path", str(manifest), "--target-dir", str(target)]
    subprocess.run(build, check=True)

    def command(*options: str) -> list[str]:
        return [str(target / "release/virtual-kinect"), *options, "--"]

    return command


def truth(path: Path) -> list[dict[str, Any]]:
    """The frames that `--truth` tells of, in the order in which they were sent."""
    return [json.loads(line)["sent"] for line in path.read_text().splitlines()]
