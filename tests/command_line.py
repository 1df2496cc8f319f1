"""Commands of `vt-pipeline` in this process, where libraries are imported once."""

from typer.testing import CliRunner

from pipeline.cli import app


def invoke(*arguments: object) -> tuple[int, str]:
    """Run a command; return its status and what it prints, without line breaks."""
    done = CliRunner().invoke(app, [*map(str, arguments)])
    return done.exit_code, " ".join(done.output.split())


def vt(*arguments: object, fails: bool = False) -> str:
    """Run a command that succeeds, or fails; return what it prints, without line breaks."""
    status, printed = invoke(*arguments)
    assert (status != 0) == fails, printed
    assert "Traceback" not in printed, printed
    return printed
