"""The cells that the levels of fusion are compared by: how sensors die, lose their calibration, run late and wear."""

from collections.abc import Sequence
from typing import Any, get_args

from hydra.utils import instantiate
from omegaconf import OmegaConf

from fusion_net.common.cli.config_files import CONFIGS
from fusion_net.common.fault_effects import Dead, FewerBeams, Mismount, Stale
from fusion_net.common.faults import Fault
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.evaluation.cells.cell import Cell
from fusion_net.evaluation.cells.delays import COMPENSATIONS, Delay, Sensor
from fusion_net.evaluation.drop_table import SUBSETS

GROUPS = ("conditions", "deaths", "calibration", "shake", "clocks", "corruptions", "swap")
"""What can be asked for, in the order in which it is measured. The sound sensors come first whatever is asked for."""
SOUND = Cell(group="sound", name="sound", subsets=SUBSETS, parts=("speed",))
CONDITIONS = Cell(
    group="conditions",
    name="sound, by condition",
    subsets=SUBSETS,
    parts=("condition", "severity", "range", "visibility", "condition x range"),
    every_scene=True,
)
ROTATIONS = (0.25, 0.5, 1.0, 2.0, 3.0)
"""Degrees; a quick plan takes the two that are marked below, as of the next."""
TRANSLATIONS = (0.05, 0.1, 0.2, 0.35, 0.5)
"""Metres."""
DELAYS = (0.025, 0.05, 0.1, 0.2)
"""Seconds."""
QUICK = {ROTATIONS: (1.0, 3.0), TRANSLATIONS: (0.2, 0.5), DELAYS: (0.05, 0.2)}
HALF_A_SECOND = {"camera": 1, "lidar": 1, "radar": 2}
"""Firings on disk from a keyframe to the one before: the nano rig writes one radar scan in between, and nothing else."""
SWAPPED_BEAMS = 16
"""Beams of the LiDAR that stands in for another model."""


def plan(groups: Sequence[str], *, quick: bool, other_lidar: str | None = None) -> list[Cell]:
    """The cells of these groups. ``quick``: fewer amounts. ``other_lidar``: a folder of the same scenes seen by another
    LiDAR."""
    if wrong := [name for name in groups if name not in GROUPS]:
        raise ValueError(f"cells={wrong[0]} is unknown; there are {', '.join(GROUPS)}")
    makers = {
        "conditions": lambda: [CONDITIONS],
        "deaths": deaths,
        "calibration": lambda: calibration(quick=quick, shake=False),
        "shake": lambda: calibration(quick=quick, shake=True),
        "clocks": lambda: clocks(quick=quick),
        "corruptions": lambda: corruptions(quick=quick),
        "swap": lambda: swaps(other_lidar),
    }
    return [SOUND, *(cell for name in GROUPS if name in groups for cell in makers[name]())]


def deaths() -> list[Cell]:
    """Each sensor blank, or half a second old, without a word. How it is without a sensor that is known to be absent, the
    sound cell's subsets say."""
    cells = []
    for sensor in MODALITIES:
        blank = (Fault(sensors=[sensor], effect=Dead()),)
        stale = (Fault(sensors=[sensor], effect=Stale(firings=HALF_A_SECOND[sensor])),)
        cells.append(Cell(group="deaths", name=f"{sensor} blank", faults=blank, silent=True))
        cells.append(Cell(group="deaths", name=f"{sensor} stale", faults=stale))
    return cells


def calibration(*, quick: bool, shake: bool) -> list[Cell]:
    """One sensor turned about, or moved along, one axis of the car: for good, or ``shake``: anew in each keyframe, the amount
    then being the standard deviation. A quick plan shakes about the vertical and to the side only."""
    cells = []
    kinds = (
        ("rotation_deg", ("roll", "pitch", "yaw"), "deg", ROTATIONS),
        ("translation", ("x", "y", "z"), "m", TRANSLATIONS),
    )
    for sensor in MODALITIES:
        for kind, axes, unit, amounts in kinds:
            for place, axis in enumerate(axes):
                if quick and shake and axis not in ("yaw", "y"):
                    continue
                for amount in QUICK[amounts] if quick else amounts:
                    values = [amount if place == other else 0.0 for other in range(3)]
                    effect = Mismount(**{kind: values}, random=shake)
                    fault = Fault(sensors=[sensor], effect=effect, per="sample" if shake else "scene")
                    curve = f"{sensor} {axis}{' shakes' if shake else ''}"
                    cells.append(_on_curve("shake" if shake else "calibration", curve, amount, unit, faults=(fault,)))
    return cells


def clocks(*, quick: bool) -> list[Cell]:
    """One sensor late, with each compensation that can be shown, by the speed of the labels."""
    return [
        _on_curve(
            "clocks",
            f"{sensor} late, {compensation}",
            seconds,
            "s",
            delay=Delay(sensor, seconds, compensation),
            parts=("speed",),
        )
        for sensor in get_args(Sensor)
        for compensation in (COMPENSATIONS if sensor != "camera" else COMPENSATIONS[:1])
        for seconds in (QUICK[DELAYS] if quick else DELAYS)
    ]


def corruptions(*, quick: bool) -> list[Cell]:
    """Every preset of ``configs/fault`` at each severity, or quickly at the one in the middle."""
    cells = []
    for path in sorted((CONFIGS / "fault").glob("*.yaml")):
        preset: Any = OmegaConf.to_container(OmegaConf.load(path))
        severities = range(1, len(preset["levels"]) + 1)
        for severity in [severities[len(severities) // 2]] if quick else severities:
            if faults := tuple(instantiate(preset | {"severity": severity}, _convert_="all")):
                cells.append(_on_curve("corruptions", path.stem, severity, "", faults=faults))
    return cells


def swaps(other_lidar: str | None) -> list[Cell]:
    """Another LiDAR without any training: every second beam of the own one, and the data of a real other model if there
    are any."""
    fewer = (Fault(sensors=["lidar"], effect=FewerBeams(keep=SWAPPED_BEAMS)),)
    cells = [Cell(group="swap", name=f"{SWAPPED_BEAMS} beams of the own LiDAR", faults=fewer)]
    return cells + ([Cell(group="swap", name="another LiDAR", root=other_lidar)] if other_lidar else [])


def _on_curve(group: str, curve: str, amount: float, unit: str, **what) -> Cell:
    return Cell(group=group, name=f"{curve} {amount:g} {unit}".strip(), curve=curve, amount=float(amount), **what)
