"""``python -m data_gen.pictures.contact_sheet``: every layout, or every sensor, in every condition as one picture."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from data_gen.episode import Scenario
from data_gen.pictures.sensor_sheet import draw_sensors
from data_gen.pictures.sheet import Image, data_of, short_scene, single_condition, write_sheet
from data_gen.recording.capture import capture
from data_gen.rig.rig import Rig
from data_gen.scene.conditions import ConditionMix
from data_gen.scene.scene import Scene
from fusion_net.common.cli.command import build, command
from fusion_net.common.drawing import label, picture_file


@command(config_name="contact_sheet")
def main(cfg: DictConfig) -> None:
    """Draws the sheet that ``cfg.show`` names into ``cfg.out``."""
    out = picture_file(cfg.out)
    rig, mix = build(cfg.rig, "rig"), build(cfg.condition, "condition")
    scenario: Scenario = build(cfg.scenario, "scenario")
    settings: dict[str, Any] = {"severity": cfg.severity, "seed": cfg.seed}
    if cfg.show == "layouts":
        draw_layouts(out, rig, scenario, mix, **settings)
    elif cfg.show == "sensors":
        draw_sensors(out, rig, scenario, mix, layout=cfg.layout, **settings)
    else:
        raise ValueError(f"show={cfg.show} is neither layouts nor sensors")
    print(f"wrote {out}")


def draw_layouts(path: Path, rig: Rig, scenario: Scenario, mix: ConditionMix, *, severity: int, seed: int) -> None:
    """Writes the images of the rig's first camera: a row per layout, a column per condition; a row shows the same road and
    traffic throughout, but for the truck that throws up the spray."""
    if not rig.cameras:
        raise ValueError(f"rig '{rig.name}' has no camera, and this sheet shows one; try show=sensors or rig=nano")
    channel, camera = next(iter(rig.cameras.items()))
    one_camera = replace(rig, cameras={channel: camera}, radars={})
    names = list(mix.weights)
    rows = []
    for layout in scenario.all_streets:
        scenes = (short_scene(rig, layout, scenario, single_condition(mix, name, severity), seed) for name in names)
        rows.append([_picture(scene, one_camera, seed) for scene in scenes])
    row_names = [label(name) for name in scenario.all_streets]
    write_sheet(path, rows, row_names=row_names, column_names=[label(name) for name in names])


def _picture(scene: Scene, rig: Rig, seed: int) -> Image:
    """The first image of a rig; what comes after it is not measured."""
    captured = capture(scene, rig, keyframes=1, seed=seed)
    return next(data_of((pair for pair in captured if pair[0].is_keyframe), rig.cameras)).image


if __name__ == "__main__":
    main()
