"""What a study found, on the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from wheelhop.cli.session import console, escape, headed_table
from wheelhop.io.report import Finding


def print_findings(findings: Sequence[Finding]) -> None:
    """Every claim, what was measured and the verdict."""
    table = headed_table("target", "measured", "verdict", title="What was to be shown")
    for finding in findings:
        table.add_row(*(escape(t) for t in (finding.claim, finding.measured, finding.verdict)))
    console.print(table)
