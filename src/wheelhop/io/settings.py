"""TOML files in."""

from __future__ import annotations

import tomllib
from collections.abc import Collection
from pathlib import Path
from typing import Any

from wheelhop.errors import InputError


def read_toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file.

    Raises:
        InputError: if it is missing or not TOML.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(str(path), "there is no such file", "Check the path.")
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(str(path), f"it is not TOML ({error})", "Mend that line.") from error


def read_declaration(path: Path, known: Collection[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Units and column names that a TOML file declares for a log, by field.

    Args:
        path: file with sections `[units]` and `[columns]`, either of which may be missing.
        known: fields that may be declared.

    Raises:
        InputError: naming the file, the section and the field that cannot be used.
    """
    content = read_toml(path)
    sections = []
    for section in ("units", "columns"):
        fields = content.get(section, {})
        if not isinstance(fields, dict):
            raise InputError(
                f"{path.name} {section}", f"{fields!r} is no section", f"Write [{section}]."
            )
        for field, value in fields.items():
            if field not in known:
                raise InputError(
                    f"{path.name} [{section}]", f"{field!r} is no field", f"Use {sorted(known)}."
                )
            if not isinstance(value, str):
                raise InputError(
                    f"{path.name} [{section}] {field}", f"{value!r} is no text", "Put it in quotes."
                )
        sections.append(dict(fields))
    return sections[0], sections[1]
