"""Commands of the engine and of plugins; each is imported when it is called."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from streamkit.cli.commands import GROUP
from streamkit.cli.main import make_app
from tests.entry_points import adding_entry_points

MODULE = "commands_of_a_test"
Offer = Callable[..., None]


@pytest.fixture
def offer(monkeypatch: pytest.MonkeyPatch) -> Offer:
    """Makes functions usable as commands, `offer(name=function)` or `offer(name="module:function")`."""
    add_entry_point = adding_entry_points(monkeypatch, MODULE)

    def add(**functions: object) -> None:
        for name, found in functions.items():
            add_entry_point(GROUP, name, found)

    return add


def streamkit(*arguments: str) -> Result:
    """Runs the command line in this process, as `main` does."""
    return CliRunner().invoke(make_app(), arguments)


def greet(name: str) -> None:
    """Greets."""
    typer.echo(f"hello {name}")


def test_a_plugin_adds_a_command(offer: Offer) -> None:
    """Its function is called with its arguments, and listed with the first line of its docstring."""
    offer(greet=greet)
    assert streamkit("greet", "drone").stdout == "hello drone\n"
    listing = streamkit("--help").stdout
    assert "Greets." in listing
    for name in ("launch", "inspect", "graph", "new", "subscribe", "greet"):
        assert f" {name} " in listing


def test_a_plugin_adds_a_command_with_subcommands(offer: Offer) -> None:
    """The entry point names a typer application."""
    app = typer.Typer()
    app.command("one")(greet)
    app.command("two")(greet)
    offer(many=app)
    assert streamkit("many", "two", "drone").stdout == "hello drone\n"


def test_only_the_called_command_is_imported(offer: Offer) -> None:
    """A broken command of another plugin does not matter."""
    offer(greet=greet, other="no_such_module:run")
    assert streamkit("greet", "drone").exit_code == 0
    assert "cannot be loaded" not in streamkit("greet", "--help").stdout


def test_a_broken_command_fails_alone(offer: Offer) -> None:
    """It is listed, and calling it names command, function, package, cause and remedy; others run."""
    offer(broken="no_such_module:run", greet=greet)
    assert "(cannot be loaded: ModuleNotFoundError)" in streamkit("--help").stdout
    done = streamkit("broken", "--anything", "x")
    assert done.exit_code == 1
    assert done.stderr == (
        "error: command 'broken' (no_such_module:run, unknown package) cannot be loaded: "
        "ModuleNotFoundError: No module named 'no_such_module'; "
        "reinstall or update unknown package, or tell its author\n"
    )
    assert streamkit("greet", "drone").exit_code == 0


def test_an_entry_point_that_is_not_callable_is_refused(offer: Offer) -> None:
    """The error shows the object."""
    offer(number=7)
    done = streamkit("number")
    assert done.exit_code == 1
    assert "must be a function, got 7; tell its author" in done.stderr


def test_an_unknown_command_is_code_2_with_a_suggestion(offer: Offer) -> None:
    """Commands of plugins are suggested too."""
    offer(greet=greet)
    for typed, meant in (("lunch", "launch"), ("greed", "greet")):
        done = streamkit(typed)
        assert done.exit_code == 2
        assert f"No such command '{typed}'. Did you mean '{meant}'?" in done.stderr


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["fakesrc ! fakesink"], "launch 'fakesrc ! fakesink'"),
        (["fakesrc", "num-buffers=3", "!", "fakesink"], "launch fakesrc num-buffers=3 '!' fakesink"),
        (["flight.pipe"], "launch -f flight.pipe"),
    ],
)
def test_a_description_without_the_command_is_answered_with_launch(words: list[str], meant: str) -> None:
    """gst-launch needs no command."""
    done = streamkit(*words)
    assert done.exit_code == 2
    assert done.stderr == f"error: {words[0]!r} is no command; did you mean: streamkit {meant}\n"


def test_a_file_or_address_without_a_command_is_answered_with_those_for_it(tmp_path: Path) -> None:
    """The first thing that some type; secrets are not repeated."""
    file = tmp_path / "flight.mp4"
    file.touch()
    for word, shown in ((str(file), str(file)), ("rtsp://me:secret@drone/live", "rtsp://***@drone/live")):
        done = streamkit(word)
        meant = f"streamkit doctor {shown} or streamkit view {shown}"
        assert done.exit_code == 2
        assert done.stderr == f"error: {shown!r} is no command; did you mean: {meant}\n"
    assert "No such command" in streamkit(str(tmp_path / "none.mp4")).stderr


def test_a_plugin_cannot_replace_a_command_of_the_engine(offer: Offer) -> None:
    """`launch` of a plugin is ignored."""
    offer(launch=greet)
    assert "hello" not in streamkit("launch", "drone").output


@pytest.fixture
def unimported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a module with a command, which fails when it is imported."""
    name = "a_command_that_cannot_be_imported"
    text = 'raise RuntimeError("imported")\n\ndef run():\n    """Runs far.\n\n    More."""\n'
    (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return name


def test_a_listing_imports_no_command(offer: Offer, unimported: str) -> None:
    """The help text is read from the source; the command is imported when it is called."""
    offer(far=f"{unimported}:run", greet=greet)
    for arguments in (("--help",), ("--version",), ("nosuch",)):
        done = streamkit(*arguments)
        assert "cannot be loaded" not in done.output
    assert "Runs far." in streamkit("--help").stdout
    assert "cannot be loaded: RuntimeError: imported" in streamkit("far").stderr


def test_paragraphs_of_the_help_fit_the_terminal() -> None:
    """Lines break at the terminal's width, not where those of the docstring end."""
    done = CliRunner().invoke(make_app(), ["launch", "--help"], env={"COLUMNS": "80"})
    lines = [line.strip() for line in done.stdout.splitlines()]
    at = next(number for number, line in enumerate(lines) if line.startswith("Exit code 0"))
    assert " ".join(lines[at : at + 3]).endswith("a further one ends the process at once.")
    assert min(map(len, lines[at : at + 2])) > 60


def test_a_group_of_a_plugin_offers_no_completion_of_its_own() -> None:
    """The shell completes `streamkit`, with all groups."""
    assert "completion" not in CliRunner().invoke(make_app(), ["fleet", "--help"]).stdout


def test_the_package_runs_as_a_module() -> None:
    """The command line of the interpreter that is named, where several environments have one."""
    done = subprocess.run(
        [sys.executable, "-m", "streamkit", "launch", "-q", "fakesrc num-buffers=1 ! fakesink"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_command_after_a_double_dash_runs() -> None:
    """It gets its own arguments and has its own help."""
    code = (
        "import sys\n"
        "from streamkit.cli.main import main\n"
        "sys.argv = ['streamkit', '--', *sys.argv[1:]]\n"
        "main()\n"
    )
    for arguments, found in (
        (["inspect", "tee"], "Sends every frame to each branch"),
        (["caps", "--help"], "Computes with caps"),
        (["launch", "-h"], "Runs a pipeline"),
        (["launch", "--stats=json", "fakesrc num-buffers=2 ! fakesink"], '"frames_in":2'),
    ):
        command = [sys.executable, "-c", code, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert (done.returncode, found in done.stdout) == (0, True), done.stderr


@pytest.mark.parametrize(
    ("first", "module", "exit_code"),
    [
        ("launch", "typer", 0),
        ("launch", "streamkit.cli.launch", 0),  # typer makes it an exit with 130
        ("inspect", "typer", 130),
        ("inspect", "streamkit.cli.inspect", 130),
        ("--help", "typer", 130),
    ],
)
def test_an_interrupt_during_imports_prints_nothing(first: str, module: str, exit_code: int) -> None:
    """Ctrl-C while the command line is being imported ends it without a traceback."""
    code = (
        "import sys\n"
        "class Interrupts:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == {module!r}:\n"
        "            raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupts())\n"
        "from streamkit.cli.main import main\n"
        "sys.argv = ['streamkit', sys.argv[1]]\n"
        "main()\n"
    )
    command = [sys.executable, "-c", code, first]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (exit_code, "", "")


@pytest.mark.parametrize("arguments", [["--help"], ["inspect"]])
def test_a_full_disk_is_reported(arguments: list[str]) -> None:
    """Output that cannot be written is one line and exit code 1."""
    command = [str(Path(sys.executable).with_name("streamkit")), *arguments]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    assert done.returncode == 1
    assert done.stderr == "error: the output cannot be written: No space left on device\n"
