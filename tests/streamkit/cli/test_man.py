"""`streamkit man`: pages from the declarations of the commands."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from streamkit.cli.commands import installed_commands
from streamkit.cli.main import make_app


@pytest.fixture
def pages(tmp_path: Path) -> Path:
    """A folder with all pages."""
    folder = tmp_path / "man" / "man1"
    done = CliRunner().invoke(make_app(), ["man", str(folder)])
    assert done.exit_code == 0, done.output
    # man does not look for pages in any folder.
    command = f"man -l {folder}/streamkit.1"
    assert f"{len(list(folder.iterdir()))} pages in {folder}; read them with: {command}\n" in done.stdout
    return folder


def test_every_command_has_a_page(pages: Path) -> None:
    """Of plugins, too, and of the subcommands of a group."""
    names = {path.name for path in pages.iterdir()}
    assert {f"streamkit-{name}.1" for name in installed_commands()} | {"streamkit.1"} <= names
    assert "streamkit-fleet-up.1" in names


def test_a_page_has_what_help_prints(pages: Path) -> None:
    """Usage, options with their values and texts; dashes can be searched for."""
    text = (pages / "streamkit-launch.1").read_text()
    assert text.startswith('.TH "STREAMKIT-LAUNCH" 1')
    assert "\n.B streamkit launch\n[OPTIONS] [description]...\n" in text
    assert "\n.TP\n.B \\-e, \\-\\-eos\\-on\\-shutdown\nCtrl\\-C sends EOS and waits for it.\n" in text
    assert "\n.B launch\n" in (pages / "streamkit.1").read_text()


def test_no_text_is_taken_for_a_command_of_man(pages: Path) -> None:
    """Lines with a dot at their start are requests of man, and no dash or backslash is bare."""
    for path in pages.iterdir():
        lines = path.read_text().splitlines()
        assert {line.split()[0] for line in lines if line[:1] in ".'"} <= {".TH", ".SH", ".B", ".TP", ".PP"}
        assert not [line for line in lines[1:] if re.search(r"(?<!\\)-|\\(?![-e&])", line)]


def test_a_folder_that_cannot_be_written() -> None:
    """Exit code 1 and the reason."""
    done = CliRunner().invoke(make_app(), ["man", "/dev/null/man1"])
    assert done.exit_code == 1
    assert done.stderr == "error: /dev/null/man1 cannot be written: Not a directory\n"
