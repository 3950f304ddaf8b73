"""Held or flying, in real motion capture: `examples/mocap_activity.py` beside its independent labels."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("PHYSINC_DATA", ROOT.parent / "shared" / "data")) / "jugglebot-mocap"


@pytest.fixture(scope="module")
def active() -> tuple[float, float]:
    """Percents told to be active, of what flies and of what is held."""
    if not DATA.is_dir():
        pytest.skip(f"no real recordings at {DATA} (PHYSINC_DATA names their folder)")
    command: list[str | Path] = [sys.executable, ROOT / "examples" / "mocap_activity.py", DATA / "session7.json"]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert run.returncode == 0, run.stderr
    flies, held = (line.split()[-3] for line in run.stdout.splitlines()[1:])
    return float(flies), float(held)


def test_what_a_machine_holds_is_active(active: tuple[float, float]) -> None:
    assert active[1] > 95.0


def test_what_a_machine_throws_is_passive(active: tuple[float, float]) -> None:
    assert active[0] < 5.0
