"""Errors a user can act on: each names the field, the value it had and the remedy."""

from __future__ import annotations


class InputError(ValueError):
    """An input that cannot be used, with what to do about it.

    Args:
        field: name of the offending file, column, option or parameter.
        problem: what is wrong, with the value that was found.
        remedy: what the user should do.
    """

    def __init__(self, field: str, problem: str, remedy: str):
        self.field, self.problem, self.remedy = field, problem, remedy
        super().__init__(f"{field}: {problem}. {remedy}")


class InputWarning(UserWarning):
    """An input that can be used, but not as the user may think."""


def require_in_range(field: str, value: float, low: float, high: float, unit: str) -> None:
    """Raise `InputError` unless the finite `value` lies in [low, high]."""
    if not (low <= float(value) <= high):
        raise InputError(
            field,
            f"{float(value):g} {unit} is outside {low:g} to {high:g} {unit}",
            "Give a value in that range, in that unit.",
        )


class DivergenceError(RuntimeError):
    """A computation left the finite numbers; says when, and what to try."""
