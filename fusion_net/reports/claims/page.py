"""The page of the claims as Markdown."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from fusion_net.reports.claims import failures, geometry, levels, sensors, training
from fusion_net.reports.claims.claim import VERDICTS, Claim
from fusion_net.reports.claims.results import Results

HEAD = (
    "# The lesson's claims",
    "",
    "Written by `python -m fusion_net.reports.claims` from the result files in [`results`](results), and from arithmetic"
    " that is done each time; a test holds the page to them. Do not edit it. How a figure is measured:"
    " [ablations](ablations.md), [audits](audits.md).",
    "Intervals are 95 % over scenes, +- is the standard deviation over seeds (n). *Holds* is said of these scenes, these"
    " sensors and these minutes of training; what is asked for stands in the code of `fusion_net/reports/claims/`.",
)


def sections(results: Results) -> dict[str, list[Claim]]:
    """The claims by heading."""
    return {
        "Geometry": geometry.claims(),
        "What each sensor is good for": sensors.claims(results),
        "Training": training.claims(results),
        "Where to fuse": levels.claims(results),
        "The five failures and their checks": failures.claims(results),
    }


def as_markdown(found: Mapping[str, Sequence[Claim]]) -> str:
    """All sections, and how many claims have which verdict."""
    everything = [claim for claims in found.values() for claim in claims]
    count = Counter(claim.verdict for claim in everything)
    tally = ", ".join(f"{count[word]} {word}" for word in VERDICTS if count[word])
    lines = [*HEAD, "", f"{len(everything)} claims: {tally}.", ""]
    for heading, claims in found.items():
        lines += [
            f"## {heading}",
            "",
            "| claim | verdict | measured | why, or what is different here | command |",
            "|---|---|---|---|---|",
        ]
        lines += [_row(claim) for claim in claims]
        lines.append("")
    return "\n".join(lines)


def _row(claim: Claim) -> str:
    cells = (claim.text, f"**{claim.verdict}**", claim.measured, claim.why, f"`{claim.command}`")
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


def page(root: Path) -> str:
    """The page that follows from the results below ``root``."""
    return as_markdown(sections(Results(root)))
