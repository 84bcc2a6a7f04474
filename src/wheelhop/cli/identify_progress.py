"""Progress of a fit, on the command line."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from wheelhop.cli.session import messages
from wheelhop.errors import InputWarning
from wheelhop.identification.descent import OnProgress


@contextmanager
def fit_bar(doing: str, told: Callable[[float], str]) -> Iterator[OnProgress]:
    """A progress bar; yields a function of iterations done, at most, and the best loss.

    What a fit warns of is not shown: the report tells the same problems.

    Args:
        doing: what the iterations do, once everything is compiled.
        told: the best start's loss in words.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("iterations{task.fields[best]}"),
        TimeElapsedColumn(),
    )
    with warnings.catch_warnings(), Progress(*columns, console=messages) as bar:
        warnings.filterwarnings("ignore", "identification: ", InputWarning)
        task = bar.add_task("compiling", total=None, best="")

        def advance(done: int, most: int, best: float) -> None:
            bar.update(
                task,
                description=doing,
                completed=done,
                total=max(done, most),
                best=f", best start {told(best)}",
            )

        yield advance
