"""`streamkit new`: the package it makes installs, and its own test passes at once."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

LAUNCHED = {
    "transform": "videotestsrc num-buffers=3 ! mytransform gain=1.5 ! fakesink",
    "source": "mysource num-buffers=3 ! fakesink",
    "sink": "videotestsrc num-buffers=3 ! mysink location=means.txt",
}


@pytest.fixture(scope="module")
def environment(make_environment: Callable[[], Any]) -> Any:
    """A fresh environment with a new package of each kind, which one call of pip installs."""
    environment = make_environment()
    for kind in LAUNCHED:
        made = environment.run("streamkit", "new", f"my-{kind}", "--kind", kind)
        assert made.returncode == 0, made.stderr
    packages = [word for kind in LAUNCHED for word in ("-e", f"./my-{kind}")]
    done = environment.run("pip", "install", *packages)
    assert done.returncode == 0, done.stdout + done.stderr
    return environment


@pytest.mark.parametrize("kind", LAUNCHED)
def test_a_new_package_installs_and_passes_its_test(environment: Any, tmp_path: Path, kind: str) -> None:
    """Then it is found by name, documented, and runs in a pipeline."""
    test = ["python", "-W", "error", "-m", "pytest", "-q"]
    done = environment.run(*test, cwd=environment.folder / f"my-{kind}")
    assert done.returncode == 0, done.stdout + done.stderr
    text = environment.run("streamkit", "inspect", f"my{kind}").stdout
    assert f" of my-{kind} 0.1.0 (my_{kind}.element:My{kind.capitalize()})" in text
    launched = environment.run("streamkit", "launch", LAUNCHED[kind], cwd=tmp_path)
    assert (launched.returncode, launched.stderr.count("\n")) == (0, 1), launched.stderr
