"""The program `vlmb`: its commands, and what one prints where it fails."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from vlmb._version import __version__
from vlmb.cli import bench, check, convert, info, matrices, models, plot, run, schema, steady, sweep, view
from vlmb.cli.terminal import parsed, printable
from vlmb.errors import VlmbError
from vlmb.simulation.keeping import ended_by_signals

# A module a command, named as it is: WHAT it is for, `arguments` describes what it takes, `execute` runs it and returns the
# exit code; `settle`, where there is one, sorts out what was read before that.
COMMANDS = (run, models, info, check, matrices, view, bench, plot, sweep, steady, convert, schema)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; print errors as one sentence on stderr."""
    parser = make_parser()
    with printable(), ended_by_signals():
        args = parsed(parser, arguments)
        try:
            return int(args.execute(args))
        except VlmbError as error:
            scene = getattr(args, "scene", None)
            where = f"{scene}: " if scene and str(scene) not in str(error) else ""
            print(f"vlmb {args.command}: {where}{error}", file=sys.stderr)
        except BrokenPipeError:
            pass
        except OSError as error:
            print(f"vlmb {args.command}: {error.filename or ''}: {error.strerror}", file=sys.stderr)
        except (KeyboardInterrupt, ImportError) as error:
            if not _interrupted(error):
                raise
            print(f"vlmb {args.command}: interrupted; earlier results are as they were", file=sys.stderr)
    return 1


def _interrupted(error: BaseException | None) -> bool:
    """Whether an interrupt is behind an error: one within the import of a compiled module becomes an ImportError."""
    return error is not None and (isinstance(error, KeyboardInterrupt) or _interrupted(error.__cause__ or error.__context__))


def make_parser() -> argparse.ArgumentParser:
    """Describe every command."""
    parser = argparse.ArgumentParser(prog="vlmb", description="Simulate mechanisms whose links change their length.")
    parser.add_argument("--version", action="version", version=f"vlmb {__version__}")
    parser.commands = {}  # type: ignore[attr-defined]
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in COMMANDS:
        name = module.__name__.rpartition(".")[2]
        added = commands.add_parser(name, help=module.WHAT, description=module.WHAT)
        module.arguments(added)
        added.set_defaults(execute=module.execute, settle=getattr(module, "settle", None))
        parser.commands[name] = added  # type: ignore[attr-defined]
    return parser
