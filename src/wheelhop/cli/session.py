"""What every command shares: precision, compilation cache, messages, progress, exit status."""

from __future__ import annotations

import functools
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import jax
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from wheelhop import __version__
from wheelhop.errors import DivergenceError, InputError, InputWarning

console = Console()
messages = Console(stderr=True)

PRECISIONS = ("float64", "float32")

OutDirectory = Annotated[Path, typer.Option("--out", help="Directory for the results.")]
Seed = Annotated[
    int, typer.Option("--seed", min=0, max=2**32 - 1, help="Seed of all random numbers.")
]
UnusedSeed = Annotated[
    int, typer.Option("--seed", min=0, help="Kept in the summary; nothing here is random.")
]
Precision = Annotated[str, typer.Option("--precision", help="float64 or float32.")]

Command = TypeVar("Command", bound=Callable[..., Any])


def command(function: Command) -> Command:
    """Tell bad input in one line and leave with status 2, divergence with status 1."""

    @functools.wraps(function)
    def wrapped(*args: Any, **kwargs: Any) -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("always", InputWarning)
            warnings.showwarning = _show_warning
            try:
                return function(*args, **kwargs)
            except InputError as error:
                messages.print(f"[bold red]error[/] {escape(str(error))}", soft_wrap=True)
                raise typer.Exit(2) from None
            except DivergenceError as error:
                messages.print(f"[bold red]diverged[/] {escape(str(error))}", soft_wrap=True)
                raise typer.Exit(1) from None

    return wrapped  # type: ignore[return-value]


@contextmanager
def computing(precision: str) -> Iterator[None]:
    """Run a command's computations in this precision, with compiled code kept on disk.

    Raises:
        InputError: for an unknown precision.
    """
    if precision not in PRECISIONS:
        raise InputError("--precision", f"{precision!r} is unknown", f"Use one of {PRECISIONS}.")
    jax.config.update("jax_compilation_cache_dir", str(cache_directory()))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    with jax.enable_x64(precision == "float64"):
        yield


def cache_directory() -> Path:
    """Where compiled code is kept: WHEELHOP_CACHE, or the user's cache directory."""
    chosen = os.environ.get("WHEELHOP_CACHE")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "wheelhop" / "jax"


@contextmanager
def progress_bar(label: str, unit: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar; yields a function of work done and work in all."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=messages) as bar:
        task = bar.add_task(label, total=None)

        def advance(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        yield advance


def provenance(name: str, precision: str, **settings: Any) -> dict[str, Any]:
    """What made a result: the command, its settings and the version."""
    return {
        "command": name,
        "wheelhop_version": __version__,
        "jax_version": jax.__version__,
        "settings": {"precision": precision, **settings},
    }


def say_files(directory: Path, *names: str) -> None:
    """Say where the results are."""
    console.print(f"wrote {', '.join(names)} in {escape(str(directory))}", soft_wrap=True)


def headed_table(*headings: str, title: str | None = None) -> Table:
    """A table whose headings keep their units in square brackets, which are no markup."""
    return Table(*(escape(heading) for heading in headings), title=title)


def _show_warning(message: Any, category: Any, *args: Any, **kwargs: Any) -> None:
    messages.print(f"[yellow]warning[/] {escape(str(message))}", soft_wrap=True)


def escape(text: str) -> str:
    """Text whose square brackets, as of units, are no markup."""
    return text.replace("[", "\\[")
