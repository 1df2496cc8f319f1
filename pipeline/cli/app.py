"""Every command of `vt-pipeline`, by the panels in which help lists them; the module of a command is imported when it is used."""

from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from typing import Annotated, Any, cast

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from pipeline import plugins
from pipeline.cli.failures import report_failures
from pipeline.errors import PipelineError, unknown_name

PANELS = {  # the commands of each panel, with the module of `pipeline.cli` that has the function of this name
    "Make": {"run": "run", "submit": "run", "remake": "share", "tradeoff": "tradeoff", "advise": "tradeoff"},
    "Learn": {"sweep": "tradeoff", **dict.fromkeys(("predict", "demo", "score", "read-touch"), "reconstruct")},
    "Describe": {"check": "inspection", "stages": "inspection"},
    "Look and export": {"status": "inspection", "summary": "inspection", "export": "share", "recipe": "share"},
    "Maintain": {"validate": "inspection", "collect-garbage": "inspection", "doctor": "inspection"},
}

EXTENSIONS = "Extensions"  # the panel of commands that packages declare as `vt_pipeline.commands`, with a function each


class Commands(TyperGroup):
    """The commands of `PANELS`, then those of packages."""

    def list_commands(self, context: Any) -> list[str]:
        """List the names of all commands."""
        ours = [name for commands in PANELS.values() for name in commands]
        return ours + [entry.name for entry in plugins.declared("commands") if entry.name not in ours]

    def get_command(self, context: Any, name: str) -> TyperCommand | None:
        """Import a command."""
        for panel, commands in PANELS.items():
            if name in commands:
                function = getattr(import_module(f"pipeline.cli.{commands[name]}"), name.replace("-", "_"))
                return _command(name, panel, function)
        for entry in plugins.declared("commands"):
            if entry.name == name:
                return _command(name, EXTENSIONS, plugins.load(entry, PipelineError))
        return None if context.resilient_parsing else context.fail(unknown_name("command", name, self.list_commands(context)))


class _Once(TyperCommand):
    """A command that refuses an option given twice, of which click would take the last without a word."""

    def parse_args(self, context: Any, args: list[str]) -> list[str]:
        """Parse arguments; an option that takes one value may be there once."""
        _, _, given = self.make_parser(context).parse_args(list(args))
        for option in () if context.resilient_parsing else set(given):  # a shell that completes a line gets no errors
            if isinstance(option, TyperOption) and not option.multiple and not option.is_flag and given.count(option) > 1:
                context.fail(f"{option.opts[0]} is given {given.count(option)} times; it takes one value: run the command once for each")
        return super().parse_args(context, args)


def _command(name: str, panel: str, function: Callable[..., None]) -> TyperCommand:
    single = typer.Typer(add_completion=False, pretty_exceptions_show_locals=False)
    single.command(name, cls=_Once, rich_help_panel=panel)(report_failures()(function))
    command = cast(TyperCommand, typer.main.get_command(single))
    command.name = name
    return command


app = typer.Typer(cls=Commands, no_args_is_help=True, pretty_exceptions_show_locals=False)


def _print_version(requested: bool) -> None:
    if requested:
        typer.echo(f"vt-pipeline {version('vt-pipeline')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")] = False,
) -> None:
    """Make a visuotactile dataset stage by stage, learn from it, and use what was learned."""
