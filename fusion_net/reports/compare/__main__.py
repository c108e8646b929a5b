"""Puts several runs side by side: ``python -m fusion_net.reports.compare runs/A runs/B``.

Settings are in ``configs/compare.yaml``.
"""

import sys
from itertools import takewhile

from omegaconf import DictConfig

from fusion_net.common.cli.command import command
from fusion_net.common.cli.command_line import as_override


@command(config_name="compare")
def report(cfg: DictConfig) -> None:
    """Compares what ``cfg`` names."""
    from fusion_net.reports.compare.folders import find_evaluations

    find_evaluations(list(cfg.runs))  # before torch is imported, which takes longer
    from fusion_net.reports.compare.write import write_comparison

    write_comparison(list(cfg.runs), out=cfg.out)


def main() -> None:
    """Folders may be given without their key, first."""
    words = sys.argv[1:]
    folders = [word.rstrip("/") for word in takewhile(lambda word: "=" not in word and not word.startswith("-"), words)]
    if folders:
        sys.argv[1:] = [f"runs={as_override(folders)}", *words[len(folders) :]]
    report()


if __name__ == "__main__":
    main()
