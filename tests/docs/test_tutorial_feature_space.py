"""The tutorial's third-party feature space works as the page says: found, and used by the tracker."""

import json
import re
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.slowness import patience

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "tutorial-feature-space.md"
Run = Callable[..., subprocess.CompletedProcess[str]]


def _blocks(language: str) -> list[str]:
    return re.findall(
        rf"^```{language}\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh environment that sees this one's packages, with the tutorial's package installed into it."""
    folder = tmp_path_factory.mktemp("environment")
    package = folder / "package"
    package.mkdir()
    (package / "hog_space.py").write_text("\n\n".join(_blocks("python")), encoding="utf-8")
    (pyproject,) = _blocks("toml")
    (package / "pyproject.toml").write_text(pyproject, encoding="utf-8")
    venv.create(folder, with_pip=False)
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(folder)}))
    visible = [sysconfig.get_path("purelib"), sysconfig.get_path("platlib"), str(ROOT), str(ROOT / "plugins")]
    (packages / "visible.pth").write_text("\n".join(visible) + "\n", encoding="utf-8")
    subprocess.run(
        [str(folder / "bin" / "python"), "-m", "pip", "install", "--no-index", "--no-deps",
         "--no-build-isolation", "--quiet", "--disable-pip-version-check", str(package)],
        check=True, capture_output=True, text=True, timeout=patience(100), cwd=folder,
    )  # fmt: skip
    return folder


@pytest.fixture
def python(environment: Path) -> Run:
    """Runs Python in that environment."""

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [str(environment / "bin" / "python"), *arguments]
        return subprocess.run(
            command, capture_output=True, text=True, timeout=patience(80), check=False, cwd=environment
        )

    return run


COMMAND = ("-c", "from streamkit.cli.main import main; main()")


def test_it_is_found_and_documented(python: Run) -> None:
    """`inspect` shows package, properties and example."""
    done = python(*COMMAND, "inspect", "hogfeatures")
    assert done.returncode == 0, done.stderr
    assert "hogfeatures - Attaches a HOG vector to each detection" in done.stdout
    assert "hog-space 1.0.0" in done.stdout


def test_it_fulfils_the_protocol(python: Run) -> None:
    """The space has the three names; vectors are of length 1 and do not depend on contrast."""
    done = python(
        "-c",
        "import numpy as np, hog_space, streamkit\n"
        "space = hog_space.HogSpace()\n"
        "assert isinstance(space, streamkit.FeatureSpace)\n"
        "given = np.random.default_rng(0).integers(0, 100, (5, 32, 32)).astype(np.float32)\n"
        "vectors = space.embed(given)\n"
        "assert vectors.dtype == np.float32 and vectors.shape == (5, 144)\n"
        "assert np.allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)\n"
        "assert np.allclose(space.embed(given * 2 + 20), vectors, atol=1e-4)\n"
        "assert not space.embed(np.full((1, 32, 32), 9, np.float32)).any()\n",
    )
    assert done.returncode == 0, done.stderr


def test_it_takes_the_place_of_waveleteigen(python: Run, environment: Path) -> None:
    """Both pipelines of the page run; targets are tracked, and every vector is of length 1."""
    for line in _blocks("sh"):
        text = re.fullmatch(r'streamkit launch "(.*)"\n', line)
        assert text is not None, line
        done = python(*COMMAND, "launch", "-q", text[1])
        assert done.returncode == 0, done.stderr
    records = [json.loads(line) for line in (environment / "tracks.jsonl").read_text().splitlines()]
    assert len(records) == 40
    assert any(track["state"] == "confirmed" for record in records for track in record["tracks"])
    with np.load(environment / "hog.npz", allow_pickle=False) as file:
        vectors, versions = file["vectors"], file["version"]
    assert vectors.shape[1] == 144
    assert len(vectors) > 40
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-4)
    assert set(versions.tolist()) == {1}


def test_the_tests_own_environment_is_untouched() -> None:
    """The package is in the fresh environment only."""
    done = subprocess.run(
        [sys.executable, "-c", "import hog_space"], capture_output=True, text=True, timeout=60, check=False
    )
    assert "No module named 'hog_space'" in done.stderr
