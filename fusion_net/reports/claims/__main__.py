"""Writes the page of the lesson's claims: ``python -m fusion_net.reports.claims``.

Settings are in ``configs/claims.yaml``.
"""

import re
import sys
from pathlib import Path

from omegaconf import DictConfig

from fusion_net.common.cli.command import command


def write_claims(results: Path, out: Path) -> str:
    """Writes the page that follows from the result files below ``results``. ValueError when there is no such folder."""
    if not results.is_dir():
        raise ValueError(f"results={results} is no folder; results are committed in docs/results")
    from fusion_net.reports.claims.page import page  # measures some claims itself, and takes seconds to import

    text = page(results)
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(text, encoding="utf-8")
    return text


def missing_files(text: str) -> list[str]:
    """The result files that a page says are not there."""
    return sorted({*re.findall(r"`([^`]+)` is not there", text)})


@command(config_name="claims")
def main(cfg: DictConfig) -> None:
    """Writes the page that ``cfg`` names."""
    text = write_claims(Path(cfg.results), Path(cfg.out))
    print(f"{cfg.out}: {next(line for line in text.splitlines() if ' claims: ' in line)}")
    for missing in missing_files(text):
        print(f"warning: {missing} is not there, and its claims are not measured", file=sys.stderr)


if __name__ == "__main__":
    main()
