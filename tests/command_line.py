"""The commands of streamkit, called in the process of the tests: most of a short one is its start."""

from subprocess import CompletedProcess

from typer.testing import CliRunner

from streamkit.cli.main import make_app


def run(*words: object, stdin: str | None = None) -> CompletedProcess[str]:
    """Runs a command that needs no process of its own, such as `run("tracks", path)`."""
    arguments = [str(word) for word in words]
    done = CliRunner().invoke(make_app(), arguments, input=stdin)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return CompletedProcess(arguments, done.exit_code, done.stdout, done.stderr)
