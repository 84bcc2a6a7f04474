"""TOML files in."""

from __future__ import annotations

import tomllib
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
