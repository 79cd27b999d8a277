"""`streamkit experiments` writes its files and reports missing data; no pipeline imports it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from streamkit_wavelet_eigen.experiments import run
from streamkit_wavelet_eigen.experiments.command import experiments

DOCS = Path(__file__).parents[4] / "docs"
COMMAND = [sys.executable, "-c", "from streamkit.cli.main import main; main()", "experiments"]


def _run(folder: Path, *arguments: str, data: Path | None) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != "STREAMKIT_DATA"}
    if data is not None:
        environment["STREAMKIT_DATA"] = str(data)
    return subprocess.run(
        [*COMMAND, *arguments],
        capture_output=True, text=True, timeout=85, check=False, cwd=folder, env=environment,
    )  # fmt: skip


@pytest.mark.parametrize("arguments", [(), ("--data", "nothing")])
def test_missing_databases_are_reported(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    """Exit 1, one line that says what to give; no traceback, no file."""
    done = _run(tmp_path, *arguments, data=None)
    assert done.returncode == 1
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_broken_database_is_reported(tmp_path: Path) -> None:
    """A process that fails ends the run with the name of the image."""
    for name in ("orl/s1", "coil20"):
        (tmp_path / "data" / name).mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "data" / "orl" / "s1" / "1.pgm"), np.zeros((112, 92), np.uint8))
    done = _run(tmp_path, "--data", "data", data=None)
    assert done.returncode == 1, done.stderr
    assert "error: " in done.stderr
    assert "Traceback" not in done.stderr


def test_results_are_written_as_json_and_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shared_folder: Path
) -> None:
    """What the last full run found comes out as the files in docs/, byte for byte."""
    results = json.loads((DOCS / "paper-tables.json").read_text(encoding="utf-8"))
    monkeypatch.setattr(run, "run_all", lambda folder, follow, **settings: results)
    output = tmp_path / "a" / "b"
    experiments(data=shared_folder, output=output, plots=False)
    for name in ("paper-tables.json", "paper-tables.md"):
        assert (output / name).read_bytes() == (DOCS / name).read_bytes()
    assert len(list(output.iterdir())) == 2


def test_pipelines_import_no_experiment(tmp_path: Path) -> None:
    """Only the command's entry point leads to the experiments, neither imports nor elements."""
    code = (
        "import sys\n"
        "from streamkit import Pipeline\n"
        "Pipeline.parse('dronetestsrc num-buffers=1 ! video/x-raw, width=64, height=64 '\n"
        "               '! waveleteigen mode=raw ! featuresink location=features.npz').run(timeout_s=60)\n"
        "print(*(name for name in sys.modules if name.startswith('streamkit_wavelet_eigen')))\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=85, check=True, cwd=tmp_path
    )
    imported = set(ended.stdout.split())
    assert {"streamkit_wavelet_eigen.element", "streamkit_wavelet_eigen.featuresink"} <= imported
    assert {name for name in imported if ".experiments" in name} == set()
    plugins = Path(__file__).parents[4] / "plugins"
    importing = {
        path.relative_to(plugins).parts[:2]
        for path in plugins.rglob("*.py")
        if "streamkit_wavelet_eigen.experiments" in path.read_text(encoding="utf-8")
    }
    assert importing == {("streamkit_wavelet_eigen", "experiments")}
