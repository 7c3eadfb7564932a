"""``obsplan ...``: the command line. What a command needs is imported when it runs."""

import errno
import sys
from contextlib import suppress
from typing import Annotated

import typer

from obsplan.cli.campaigns import campaign, campaign_check, campaign_report
from obsplan.cli.commands import compare, new, run, scenarios, schema, thesis
from obsplan.cli.documentation import docs
from obsplan.cli.replays import recordings, replay
from obsplan.cli.reports import report
from obsplan.cli.stopping import is_stop, listen, stop_at_last
from obsplan.cli.terminal import WRONG_INPUT, complain, open_door, put, say, unwritable
from obsplan.signals import received

__all__ = ["main"]

COMMANDS = (
    *(run, compare, replay, report, campaign, campaign_check, campaign_report),
    *(thesis, new, scenarios, recordings, schema, docs),
)
EPILOG = (
    "Exit codes: 0 done; 2 what was given is wrong, and one sentence says what; "
    "3 some missions of a campaign failed; 130, 143, 129 ended in order by Ctrl-C, SIGTERM, SIGHUP."
)

app = typer.Typer(
    help=(
        "Plan the path of an aid vehicle so that AUVs measuring only acoustic range to it know "
        "where they are."
    ),
    epilog=EPILOG,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
for command in COMMANDS:
    app.command()(command)


def say_version(wanted: bool | None) -> None:
    """Print the version, if that is what is wanted."""
    if wanted:
        from obsplan import __version__

        say(f"obsplan {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool | None,  # None when the command line is called from code
        typer.Option(
            "--version", help="Print the version and exit.", is_eager=True, callback=say_version
        ),
    ] = None,
) -> None:
    """Take what belongs to no command."""


def main() -> None:
    """Run the command line; exit codes: 0 done, 2 bad input, 3 missions failed, 128 + signal."""
    open_door()
    listen()
    try:
        code = app(prog_name="obsplan", standalone_mode=False)
        put("")  # what the parser printed and is still on its way
    except SystemExit as end:  # of the parser, if nobody is left to read its help
        sys.exit(0 if isinstance(end.__context__, BrokenPipeError) else end.code)
    except BaseException as error:
        if is_stop(error) or isinstance(error, typer.Abort):
            stop_at_last()
        message = fault(error)
        if message is None:
            raise  # ours: the traceback is what we need to mend it
        complain(message)
        code = WRONG_INPUT
    if received:  # which the command line's own parser turns into a code
        stop_at_last()
    sys.exit(code if isinstance(code, int) else 0)


def fault(error: BaseException) -> str | None:
    """What the user gave that is wrong, or None if the fault is ours."""
    from obsplan.types import UNCOMPUTABLE, ObsplanError, uncomputable

    if isinstance(error, ObsplanError):
        return str(error)
    if isinstance(error, UNCOMPUTABLE):
        return f"the mission cannot be finished: {uncomputable(error)}; nothing was written"
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename} cannot be used ({error.strerror}): give another name or folder"
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:  # under the parser's own help
        with suppress(ObsplanError):
            put("")  # what is still on its way goes to nobody
        return str(unwritable(error))
    message = getattr(error, "format_message", None)  # of the command line's own parser
    if message is None:
        return None
    said = message().rstrip(".").replace("Input should be", "must be") or "no command was given"
    return f"{said}; see obsplan --help"
