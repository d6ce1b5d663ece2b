"""The application: its commands, and what becomes of errors."""

import re
import sys
import traceback
from collections.abc import Callable, Iterator
from itertools import zip_longest

import typer
from typer.exceptions import TyperException

from faultgauge.cli import options
from faultgauge.cli.benchmark import benchmark
from faultgauge.cli.cache import renew_when_damaged
from faultgauge.cli.calibrate import calibrate
from faultgauge.cli.campaign import campaign
from faultgauge.cli.check import check
from faultgauge.cli.demo import demo
from faultgauge.cli.detectability import detectability
from faultgauge.cli.estimate import estimate
from faultgauge.cli.evaluate import evaluate
from faultgauge.cli.export import export
from faultgauge.cli.fit import fit
from faultgauge.cli.inspect import inspect
from faultgauge.cli.presets import presets
from faultgauge.cli.rehearse import rehearse
from faultgauge.cli.reproduce import reproduce
from faultgauge.cli.simulate import simulate
from faultgauge.cli.streaming import end_as_interrupts, end_in_peace, let_go
from faultgauge.cli.writing import guarded
from faultgauge.errors import InputError
from faultgauge.files import full_disk
from faultgauge.phases import profiled
from faultgauge.settings import set_for_commands

__all__ = ["app", "main"]

ISSUES = "https://github.com/faultgauge/faultgauge/issues"
INTERRUPTED = 130  # exit code, as shells have it
STOPPED = "interrupted; nothing was written half-way."

app = typer.Typer(
    name="faultgauge",
    help="How big is the fault, in your units, while the loop is still closed?",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
COMMANDS = {  # as the list of commands says it, each on one line
    demo: "See it work on a real drive and on a satellite's wheel.",
    check: "Is SUSPECT like HEALTHY? Fit, calibrate, estimate, report.",
    inspect: "Show what is in a log; draft a plant file.",
    presets: "List the plant files that come along; print one to edit.",
    fit: "Learn a plant's unknowns from healthy logs.",
    evaluate: "Score a model by pure simulation.",
    calibrate: "Find noise, model error and alarm level on healthy logs.",
    estimate: "Find faults in logs or a stream, in physical units.",
    rehearse: "Put faults into healthy logs: what would be found?",
    detectability: "What could be seen of each fault in logs like these?",
    campaign: "Simulate many runs with faults; judge and score them.",
    export: "Write a calibrated model as C or as FMUs.",
    simulate: "Simulate a plant with faults and write the log.",
    reproduce: "Repeat the paper's reaction-wheel study.",
    benchmark: "Fit a public benchmark; score it beside published results.",
}
for command, short in COMMANDS.items():
    app.command(short_help=short)(guarded(command))


def _version(wanted: bool | None) -> None:
    if wanted:
        from importlib import metadata

        print(metadata.version("faultgauge"))
        raise typer.Exit


@app.callback()
def root(
    version: bool | None = typer.Option(
        None, "--version", callback=_version, is_eager=True, help="Print the version and stop."
    ),
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error."),
    profile: bool = typer.Option(False, "--profile", help="Say where the processor's time went."),
) -> None:
    set_for_commands()


def main() -> None:
    """Run the command line: exit 0 done, 2 wrong input, 1 our own fault, 130 interrupted."""
    renew_when_damaged()
    try:
        code = run(sys.argv[1:], end_as_interrupts())
    except KeyboardInterrupt:  # a second one, while the first was told
        code = INTERRUPTED
    end_in_peace()
    sys.exit(code)


def run(arguments: list[str], interrupted: Callable[[], bool] = lambda: False) -> int:
    """Exit code of one call; every error is one sentence on stderr, of which an interrupt is the
    cause once one came."""
    if "--profile" in arguments:  # legal anywhere on the line
        with profiled(options.say):
            return run([a for a in arguments if a != "--profile"], interrupted)
    debug = "--debug" in arguments
    if debug:  # legal anywhere on the line
        arguments = ["--debug", *(a for a in arguments if a != "--debug")]
    try:
        arguments = list(_with_speed(arguments))
        command = typer.main.get_command(app)
        code = command(arguments, prog_name=app.info.name, standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()  # here its failure can be told
        if code == INTERRUPTED:  # typer has caught the interrupt itself, and says nothing
            return _fail(STOPPED, INTERRUPTED, debug=False)
        return code if isinstance(code, int) else 0
    except (KeyboardInterrupt, typer.Abort):
        return _fail(STOPPED, INTERRUPTED, debug)
    except Exception as failure:  # noqa: BLE001  (the last net: what is not known is our own fault)
        return _fail(STOPPED, INTERRUPTED, debug) if interrupted() else _failed(failure, debug)


def _failed(failure: Exception, debug: bool) -> int:
    match failure:
        case InputError():
            return _fail(str(failure), 2, debug)
        case TyperException():
            if not failure.format_message():  # no arguments at all: the help has been printed
                return 2
            context = getattr(failure, "ctx", None)
            where = "faultgauge" if context is None else context.command_path
            return _fail(f"{failure.format_message().rstrip('.')}. See {where} --help.", 2, debug)
        case BrokenPipeError():
            let_go()
            return 0
        case OSError() if full_disk(failure):
            let_go()
            name = failure.filename or "standard output"
            return _fail(
                f"{name}: cannot be written, because the disk is full; make room.", 2, debug
            )
    return _our_fault(failure, debug)


def _our_fault(fault: Exception, debug: bool) -> int:
    text = " ".join(str(fault).split())[:300]
    return _fail(
        f"internal error ({type(fault).__name__}: {text}). This is our fault: please report "
        f"it at {ISSUES} with the output of the same command and --debug.",
        1,
        debug,
    )


def _with_speed(arguments: list[str]) -> Iterator[str]:
    """`--realtime` without a SPEED means 1: options whose value may be left out typer has not."""
    for argument, following in zip_longest(arguments, arguments[1:], fillvalue=""):
        alone = argument == "--realtime" and not re.fullmatch(r"[-+]?[\d.].*|nan|inf", following)
        yield "--realtime=1" if alone else argument


def _fail(message: str, code: int, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    options.say(f"faultgauge: {message}")
    return code
