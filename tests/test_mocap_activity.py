"""Held or flying, in real motion capture: `examples/mocap_activity.py` beside its independent labels."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("PHYSINC_DATA", ROOT.parent / "shared" / "data")) / "jugglebot-mocap"


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no real recordings at {DATA} (PHYSINC_DATA names their folder)")
def test_what_a_machine_holds_is_active_and_what_it_throws_is_passive() -> None:
    command: list[str | Path] = [sys.executable, ROOT / "examples" / "mocap_activity.py", DATA / "session7.json"]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert run.returncode == 0, run.stderr
    flies, held = (line.split()[-3] for line in run.stdout.splitlines()[1:])
    assert float(flies) < 20.0, run.stdout
    assert float(held) > 95.0, run.stdout
