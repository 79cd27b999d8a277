"""The tutorial's third-party feature space works as the page says: found, and used by the tracker."""

import json
import re
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE = Path(__file__).parents[2] / "docs" / "tutorial-feature-space.md"


def _blocks(language: str) -> list[str]:
    return re.findall(
        rf"^```{language}\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )


@pytest.fixture(scope="module")
def environment(make_environment: Callable[[], Any]) -> Any:
    """A fresh environment with the tutorial's package installed into it."""
    made = make_environment()
    package = made.folder / "package"
    package.mkdir()
    (package / "hog_space.py").write_text("\n\n".join(_blocks("python")), encoding="utf-8")
    (pyproject,) = _blocks("toml")
    (package / "pyproject.toml").write_text(pyproject, encoding="utf-8")
    done = made.run("pip", "install", str(package))
    assert done.returncode == 0, done.stderr
    return made


def test_it_is_found_and_documented(environment: Any) -> None:
    """`inspect` shows package, properties and example."""
    done = environment.run("streamkit", "inspect", "hogfeatures")
    assert done.returncode == 0, done.stderr
    assert "hogfeatures - Attaches a HOG vector to each detection" in done.stdout
    assert "hog-space 1.0.0" in done.stdout


def test_it_fulfils_the_protocol(environment: Any) -> None:
    """The space has the three names; vectors are of length 1 and do not depend on contrast."""
    done = environment.run(
        "python",
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


def test_it_takes_the_place_of_waveleteigen(environment: Any) -> None:
    """Both pipelines of the page run; targets are tracked, and every vector is of length 1."""
    for line in _blocks("sh"):
        text = re.fullmatch(r'streamkit launch "(.*)"\n', line)
        assert text is not None, line
        done = environment.run("streamkit", "launch", "-q", text[1])
        assert done.returncode == 0, done.stderr
    records = [json.loads(line) for line in (environment.folder / "tracks.jsonl").read_text().splitlines()]
    assert len(records) == 25
    assert any(track["state"] == "confirmed" for record in records for track in record["tracks"])
    with np.load(environment.folder / "hog.npz", allow_pickle=False) as file:
        vectors, versions = file["vectors"], file["version"]
    assert vectors.shape[1] == 144
    assert len(vectors) > 40
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-4)
    assert set(versions.tolist()) == {1}


def test_the_tests_own_environment_is_untouched() -> None:
    """The package is in the fresh environment only."""
    assert find_spec("hog_space") is None
