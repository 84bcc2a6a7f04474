"""What the code that made a result was, for results that are kept and read again."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

_ROOMS = ("filtering", "vehicle", "estimators", "evaluation", "identification", "studies")
_SHOWN = ("claims", "figures", "report")


@lru_cache(maxsize=1)
def source_digest() -> str:
    """Digest of every source file that numbers depend on; commands, plots and texts are none."""
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for room in _ROOMS:
        for file in sorted((package / room).rglob("*.py")):
            if not file.stem.startswith(_SHOWN):
                digest.update(file.relative_to(package).as_posix().encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
