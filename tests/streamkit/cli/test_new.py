"""`streamkit new`: names, existing files, nothing overwritten."""

import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from streamkit.cli.main import make_app


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder the command runs in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def new(*arguments: str) -> Result:
    """Runs the command in this process."""
    return CliRunner().invoke(make_app(), ["new", *arguments])


@pytest.mark.parametrize("kind", ["transform", "source", "sink"])
def test_the_package_is_complete(folder: Path, kind: str) -> None:
    """Project file, element, test and README; the entry point names the class; the next steps are printed."""
    done = new("rolling-average", "--kind", kind)
    assert done.exit_code == 0
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert files == {
        f"rolling-average/{name}"
        for name in ("pyproject.toml", "README.md", "src/rolling_average/__init__.py",
                     "src/rolling_average/element.py", "tests/test_rolling_average.py")
    }  # fmt: skip
    project = tomllib.loads((folder / "rolling-average/pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"]["entry-points"]["streamkit.elements"] == {
        "rollingaverage": "rolling_average.element:RollingAverage"
    }
    source = (folder / "rolling-average/src/rolling_average/element.py").read_text(encoding="utf-8")
    assert f"class RollingAverage({kind.capitalize()}):" in source
    assert "$" not in source
    assert 'pip install -e ".[test]"' in done.stdout


def test_what_runs_have_written_is_not_published(folder: Path, tmp_path: Path) -> None:
    """A video that was made beside the sources is not in the source distribution; README and tests are."""
    assert new("rolling-average").exit_code == 0
    project = folder / "rolling-average"
    (project / "out.mp4").write_bytes(b"video")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(tmp_path / "dist")]
    subprocess.run(command, cwd=project, check=True, capture_output=True, timeout=60)
    with tarfile.open(next((tmp_path / "dist").iterdir())) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert "out.mp4" not in names
    assert {"README.md", "pyproject.toml", "src/rolling_average/element.py"} <= names
    assert "tests/test_rolling_average.py" in names


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("My_Blur", "got 'My_Blur'; 'my-blur' would do"),
        ("9lives", "got '9lives'; 'lives' would do"),
        ("../escape", "got '../escape'; 'escape' would do"),
        ("-", "got '-'"),
        ("", "got ''"),
        ("a--b", "got 'a--b'; 'a-b' would do"),
        ("x" * 51, "at most 50 characters"),
        ("json", "'json' is a name of Python's or streamkit's own; take another, such as 'my-json'"),
        ("class", "'class' is a name of Python's or streamkit's own"),
        ("streamkit", "'streamkit' is a name of Python's or streamkit's own"),
        ("bin", "'bin' is a bin in descriptions; take another name, such as 'my-bin'"),
        ("numpy", "there is a package 'numpy' in this environment, which the new one would hide"),
        (
            "video-test-src",
            "there is an element 'videotestsrc' already, of streamkit 0.1.0; take another name",
        ),
    ],
)
def test_an_invalid_name_is_refused(folder: Path, name: str, message: str) -> None:
    """Rule, value and remedy, with code 2; nothing is written."""
    done = new("--", name)
    assert done.exit_code == 2
    assert message in done.stderr
    assert not list(folder.iterdir())


def test_nothing_is_overwritten(folder: Path) -> None:
    """An existing folder or file of that name is kept."""
    (folder / "mine").mkdir()
    (folder / "mine" / "keep").write_text("x")
    done = new("mine")
    assert done.exit_code == 2
    assert done.stderr == ("error: mine: the folder exists already; take another name, or remove it\n")
    assert [path.name for path in (folder / "mine").iterdir()] == ["keep"]
    (folder / "file").write_text("x")
    assert new("file").exit_code == 2


def test_a_folder_that_cannot_be_written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The reason of the operating system is printed."""

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refuse)
    done = new("mine")
    assert (done.exit_code, done.stderr) == (
        2, "error: mine: the package cannot be written: Permission denied\n",
    )  # fmt: skip
