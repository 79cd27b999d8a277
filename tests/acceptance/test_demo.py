"""`make demo`, with a shorter flight."""

import subprocess
import sys
from pathlib import Path

DEMO = Path(__file__).parents[2] / "pipelines" / "demo.py"


def test_the_demo_receives_every_record(tmp_path: Path) -> None:
    """It counts what its subscriber prints, and names what was written."""
    command = [sys.executable, str(DEMO), "--output", str(tmp_path), "--frames", "30"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=80, check=False)
    assert done.returncode == 0, done.stderr
    assert "30 records received; one per frame, none lost." in done.stdout
    assert (tmp_path / "mosaic.jpg").stat().st_size > 10_000
