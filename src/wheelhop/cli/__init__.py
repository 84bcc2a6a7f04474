"""The command line: `wheelhop COMMAND --help`."""

from __future__ import annotations

from typing import Annotated

import typer

from wheelhop import __version__
from wheelhop.cli.bound import bound
from wheelhop.cli.cornering import cornering
from wheelhop.cli.estimate import demo, estimate
from wheelhop.cli.identify import identify
from wheelhop.cli.montecarlo import montecarlo
from wheelhop.cli.reproduce import reproduce
from wheelhop.cli.road import road
from wheelhop.cli.simulate import simulate
from wheelhop.cli.tire import tire
from wheelhop.cli.vehicle import vehicle
from wheelhop.cli.wheel_load import wheel_load

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
    help="Tyre pressure from accelerometers, and which tyre is soft from cornering.",
)

for _command in (
    demo,
    estimate,
    identify,
    simulate,
    road,
    montecarlo,
    vehicle,
    tire,
    reproduce,
    bound,
    cornering,
    wheel_load,
):
    app.command()(_command)


def _show_version(value: bool) -> bool:
    if value:
        typer.echo(f"wheelhop {__version__}")
        raise typer.Exit
    return value


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show it.")
    ] = False,
) -> None:
    del version


def main() -> None:
    """Entry point of the `wheelhop` command."""
    app()
