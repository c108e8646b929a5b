"""Claims about training: depth supervision, modality dropout, imbalance. From the ablation of both."""

from dataclasses import dataclass
from typing import Any

from fusion_net.reports.claims.claim import Claim, not_measured, verdict
from fusion_net.reports.claims.results import Results, mean_sd

SWEEP = "depth_x_dropout"
COMMAND = f"python train.py -m +sweep={SWEEP}"
TEXTS = (
    "Explicit depth supervision helps a lot: LiDAR depths teach the camera",
    "With depth supervision the fused result is better, too",
    "Trained with all sensors always there, a network leans on the easiest one and collapses without it",
    "Such a network looks great as long as everything works",
    "Modality dropout makes the network degrade gracefully",
    "Modality dropout is cheap",
)


@dataclass(frozen=True)
class Table:
    """The variants of the ablation: depth supervision none, lidar or dense; dropout 0.0 or 0.3."""

    variants: dict[str, dict[str, Any]]

    def mean(self, depth: str, dropout: float, sensors: str) -> float:
        """mAP, mean over seeds."""
        return float(self._of(depth, dropout)["mAP"][sensors]["mean"])

    def cell(self, depth: str, dropout: float, sensors: str) -> str:
        """mAP, mean and spread, with the number of seeds."""
        variant = self._of(depth, dropout)
        return f"{mean_sd(variant['mAP'][sensors], variant['n'])} (n = {variant['n']})"

    def by_depth(self, sensors: str) -> str:
        """With dropout, without and with supervision."""
        return ", ".join(
            f"{name} {self.cell(depth, 0.3, sensors)}"
            for name, depth in (("none", "none"), ("the LiDAR's", "lidar"), ("exact", "dense"))
        )

    def by_dropout(self, *names: str) -> str:
        """With exact depth, without and with dropout."""
        return "; ".join(
            f"{sensors} {self.cell('dense', 0.0, sensors)} without, {self.cell('dense', 0.3, sensors)} with dropout"
            for sensors in names
        )

    def _of(self, depth: str, dropout: float) -> dict[str, Any]:
        return self.variants[f"depth_supervision={depth}, modality_dropout={dropout}"]


def claims(results: Results) -> list[Claim]:
    """All of them."""
    variants = results.variants(SWEEP)
    if variants is None:
        return [not_measured(text, COMMAND, results.shown(SWEEP, "ablation.json")) for text in TEXTS]
    table = Table(variants)
    helped, fused, leans, great, graceful, cheap = TEXTS
    whole = {dropout: table.mean("dense", dropout, "C+L+R") for dropout in (0.0, 0.3)}
    unhelped, taught = table.mean("none", 0.3, "C"), table.mean("lidar", 0.3, "C")
    gain = table.mean("lidar", 0.3, "C+L+R") - table.mean("none", 0.3, "C+L+R")
    left = {name: table.mean("dense", 0.0, name) / whole[0.0] for name in ("C+R", "L", "C+L", "L+R")}
    better = [
        table.mean("dense", 0.3, name) > 1.1 * table.mean("dense", 0.0, name)
        for name in ("L+R", "C+L", "C+R", "L", "C")
    ]
    return [
        Claim(
            helped,
            COMMAND,
            f"mAP of the camera alone, taught by {table.by_depth('C')}",
            verdict(taught > 1.5 * unhelped),
            "Where the camera is alone. The LiDAR's depths teach it as well as exact ones.",
        ),
        Claim(
            fused,
            COMMAND,
            f"mAP of C+L+R, taught by {table.by_depth('C+L+R')}",
            verdict(gain > 0.05, gain > 0.01),
            f"By {gain:+.3f}: with a LiDAR there the network need not ask the camera how far something is.",
        ),
        Claim(
            leans,
            COMMAND,
            f"mAP {table.by_dropout('C+L+R', 'C+R', 'L')}",
            verdict(left["C+R"] < 1 / 3, left["L"] > 0.8),
            f"Without the LiDAR {100 * left['C+R']:.0f} % is left, the LiDAR alone has {100 * left['L']:.0f} %. If it leaned on"
            " the LiDAR only, that would have nearly all of it: such a network needs what it was trained with, together.",
        ),
        Claim(great, COMMAND, f"mAP {table.by_dropout('C+L+R')}", verdict(whole[0.0] >= whole[0.3])),
        Claim(graceful, COMMAND, f"mAP {table.by_dropout('L+R', 'C+L', 'C+R', 'L', 'C')}", verdict(*better)),
        Claim(
            cheap,
            COMMAND,
            f"mAP {table.by_dropout('C+L+R')}",
            verdict(whole[0.3] > whole[0.0] - 0.05),
            f"{whole[0.3] - whole[0.0]:+.3f} mAP with all sensors, and the same number of steps.",
        ),
    ]
