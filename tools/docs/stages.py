"""Pictures of one keyframe on its way through the network, a picture a stage, for ``docs/learn``.

``python tools/docs/stages.py [data/nano]`` writes docs/pictures/stage_*.jpg with the shipped weights, of a validation keyframe.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.axes import Axes
from torch import Tensor

from fusion_net.common.boxes import Boxes, box_corners
from fusion_net.common.cli.command import build
from fusion_net.data.batch import Batch
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.models.center_head import CenterHead
from fusion_net.models.encoders.radar_encoder import RASTER_CHANNELS, rasterize
from fusion_net.models.fusion_net import FusionNet
from fusion_net.runs.trained import shipped

PICTURES = Path(__file__).resolve().parents[2] / "docs" / "pictures"
SAMPLE = 41
"""Place of the keyframe in the validation split."""
LABEL, FOUND = "#2ecc71", "#ff9f1c"


class Stages:
    """The keyframe, the network, and what each part of it gave."""

    def __init__(self, root: str) -> None:
        trained = shipped("nano")
        cfg = trained.cfg
        cfg.dataset.val.root, cfg.dataset.val.cache = root, "none"
        self.data: NuScenesDataset = build(cfg.dataset.val, "dataset.val")
        self.model: FusionNet = trained.model()
        self.sample = self.data[SAMPLE]
        self.batch: Batch = self.data.collate([self.sample])
        self.grid = self.model.grid
        self.seen: dict[str, Tensor] = {}
        watched = {"fused": self.model.fuser, "decoded": self.model.decoder, **self.model.encoders}
        watched["layers"] = self.model.encoders["camera"].view_transform
        for name, part in watched.items():
            part.register_forward_hook(lambda module, inputs, output, name=name: self._keep(name, output))
        with torch.no_grad():
            self.outputs = self.model(self.batch)
            self.found = self.model.decode(self.outputs)[0]
        self.cells = self._sure_and_unsure()

    def _sure_and_unsure(self) -> list[tuple[int, int]]:
        """Of the feature cells that show an object, the one whose depth is surest, and the one whose depth is least so."""
        chance = self.outputs.image.depth_logits[0, 0].softmax(dim=0)
        entropy = -(chance * chance.clamp(min=1e-9).log()).sum(dim=0)
        is_object = self.batch.class_map[0, 0] >= 0
        places = (entropy.masked_fill(~is_object, 99.0).argmin(), entropy.masked_fill(~is_object, -1.0).argmax())
        return [divmod(int(place), entropy.shape[1]) for place in places]

    def _keep(self, name: str, output) -> None:
        self.seen.setdefault(name, output if isinstance(output, Tensor) else output.bev)

    def norm(self, name: str) -> np.ndarray:
        """The length (Y, X) of the features in each cell of a map."""
        return torch.linalg.vector_norm(self.seen[name][0].float(), dim=0).numpy()

    def ground(self, axes: Axes, values: np.ndarray | None, title: str, color: str = "magma") -> None:
        """A map (Y, X) from above, the car at the bottom in the middle and its way up."""
        grid = self.grid
        extent = (grid.y_max, grid.y_min, grid.x_min, grid.x_max)
        if values is not None:
            axes.imshow(values.T[::-1, ::-1], extent=extent, cmap=color, interpolation="nearest")
        axes.set(xlim=extent[:2], ylim=extent[2:], facecolor="#101014", aspect="equal", autoscale_on=False)
        axes.set_title(title, fontsize=8)
        axes.tick_params(labelsize=6)

    def outlines(self, axes: Axes, boxes: Boxes, color: str, width: float = 0.8) -> None:
        """Boxes from above."""
        for corners in box_corners(boxes.center, boxes.wlh, boxes.yaw)[:, [1, 3, 7, 5, 1], :2]:
            axes.plot(corners[:, 1], corners[:, 0], color=color, lw=width)

    def camera(self) -> None:
        """Image, depth and classes in the image plane, and what two cells know of their depth."""
        image = self.outputs.image
        bins = self.model.image_network.bins
        chance = image.depth_logits[0, 0].softmax(dim=0).numpy()
        figure, axes = _figure(2, 2, (9.6, 4.0))
        axes[0, 0].imshow(self.sample.images[0])
        axes[0, 0].set_title("the image, 320 x 96, and two of its cells of 8 x 8 pixels", fontsize=8)
        colors = ("#00c8ff", "#ff4fd8")
        for (row, column), color in zip(self.cells, colors, strict=True):
            axes[0, 0].add_patch(plt.Rectangle((8 * column, 8 * row), 8, 8, fill=False, ec=color, lw=1.5))
            axes[1, 1].plot(bins.centers(), chance[:, row, column], color=color, drawstyle="steps-mid")
            axes[1, 1].axvline(float(self.batch.dense_depth[0, 0, row, column]), color=color, ls=":")
        axes[1, 1].set_title("probability of 40 depths in these two; dotted: the truth", fontsize=8)
        axes[1, 1].set_xlabel("m", fontsize=7)
        depth = bins.centers().numpy()[chance.argmax(axis=0)]
        axes[0, 1].imshow(depth, cmap="turbo_r", vmin=0, vmax=50)
        axes[0, 1].set_title("most likely depth, near red to far blue", fontsize=8)
        axes[1, 0].imshow(image.class_logits[0, 0].sigmoid().amax(dim=0).numpy(), cmap="magma", vmin=0, vmax=1)
        axes[1, 0].set_title("largest class score", fontsize=8)
        for each in (axes[0, 0], axes[0, 1], axes[1, 0]):
            each.set_axis_off()
        _write(figure, "camera")

    def lift(self) -> None:
        """One cell's ray on the ground, all rays, and the map that the camera's encoder makes of them."""
        view = self.model.encoders["camera"].view_transform
        chance = self.outputs.image.depth_logits.permute(0, 1, 3, 4, 2).softmax(dim=-1)
        geometry = (self.batch.cam_K.float(), self.batch.ego_T_cam.float())

        def weights(of: Tensor) -> np.ndarray:
            """The summed probability (Y, X) of the cells in ``of`` (h, w)."""
            ones = of.float()[None, None, ..., None, None].expand(*chance.shape[:4], view.num_layers, 1)
            return view(ones, chance, *geometry)[0, 0].numpy()

        rays = torch.zeros(chance.shape[2:4])
        for row, column in self.cells:
            rays[row, column] = 1
        figure, axes = _figure(1, 3, (9.6, 3.7))
        self.ground(axes[0], weights(rays) ** 0.5, "the two cells: probability along their rays")
        self.ground(axes[1], np.log1p(weights(torch.ones_like(rays))), "all cells: summed probability, log")
        self.ground(axes[2], self.norm("camera"), f"the camera's map: length of its {self.model.bev_channels} features")
        for each in axes:
            self.outlines(each, self.sample.boxes, LABEL)
        _write(figure, "lift_splat")

    def lidar(self) -> None:
        """Points, how many a pillar has, and the map."""
        points, pillars = self.batch.lidar_points.numpy(), self.model.encoders["lidar"].pillars
        row, column, inside = pillars.rows_columns(self.batch.lidar_points[:, :2])
        counts = np.zeros(pillars.shape)
        np.add.at(counts, (row[inside].numpy(), column[inside].numpy()), 1)
        figure, axes = _figure(1, 3, (9.6, 3.7))
        self.ground(axes[0], None, f"{len(points):,} points, by height")
        axes[0].scatter(points[:, 1], points[:, 0], s=0.3, c=points[:, 2], cmap="turbo", vmin=-0.5, vmax=3)
        self.ground(
            axes[1], np.log1p(counts), f"points of {int((counts > 0).sum()):,} pillars of {pillars.cell:.2f} m, log"
        )
        self.ground(axes[2], self.norm("lidar"), "the LiDAR's map")
        for each in axes:
            self.outlines(each, self.sample.boxes, LABEL)
        _write(figure, "pillars")

    def radar(self) -> None:
        """Detections with their radial velocities, the speed in the raster, and the map."""
        points = self.batch.radar_points
        raster = rasterize(points, self.batch.radar_batch, 1, self.grid)[0].numpy()
        x, y, _, _, vx, vy, _ = points.numpy().T
        figure, axes = _figure(1, 3, (9.6, 3.7))
        self.ground(axes[0], None, f"{len(points)} detections, one second of velocity")
        axes[0].quiver(y, x, vy, vx, angles="xy", scale_units="xy", scale=1, color="#ffd166", width=0.004)
        axes[0].scatter(y, x, s=4, color="white")
        self.ground(axes[1], raster[RASTER_CHANNELS.index("speed")], "one channel of the raster: mean speed / 10")
        self.ground(axes[2], self.norm("radar"), "the radar's map")
        for each in axes:
            self.outlines(each, self.sample.boxes, LABEL)
        _write(figure, "radar")

    def fuse(self) -> None:
        """What the fuser gets and gives, with all sensors and without the LiDAR."""
        present = self.batch.present.clone()
        present[:, 1] = False
        columns = self.model.columns
        maps = {name: self.seen[name] for name in self.model.encoders}
        with torch.no_grad():
            without = self.model.fuser(maps, present[:, columns])[0].float()
        figure, axes = _figure(1, 5, (12.0, 3.2))
        for each, name in zip(axes, maps, strict=False):
            self.ground(each, self.norm(name), {"lidar": "LiDAR"}.get(name, name))
        self.ground(axes[3], self.norm("fused"), "fused")
        self.ground(axes[4], torch.linalg.vector_norm(without, dim=0).numpy(), "fused, LiDAR absent")
        _write(figure, "fuse")

    def decode(self) -> None:
        """Before and after the decoder, and the heat map of the head."""
        heat = self.outputs.maps["heatmap"][0].sigmoid().amax(dim=0).numpy()
        figure, axes = _figure(1, 3, (9.6, 3.7))
        self.ground(axes[0], self.norm("fused"), "fused map")
        self.ground(axes[1], self.norm("decoded"), "decoded map: every cell has seen its surroundings")
        self.ground(axes[2], heat, "heat map, all classes")
        self.outlines(axes[2], self.sample.boxes, LABEL)
        _write(figure, "decode")

    def loss(self) -> None:
        """Target, prediction, and the focal loss of each cell."""
        target, logits = self.batch.targets.heatmap[0], self.outputs.maps["heatmap"][0]
        chance = logits.sigmoid()
        hit = -torch.nn.functional.logsigmoid(logits) * (1 - chance) ** 2
        miss = -torch.nn.functional.logsigmoid(-logits) * chance**2 * (1 - target) ** 4
        cost = torch.where(target == 1, hit, miss).sum(dim=0)
        figure, axes = _figure(1, 3, (9.6, 3.7))
        self.ground(axes[0], target.amax(dim=0).numpy(), "target: a Gaussian at each object")
        self.ground(axes[1], chance.amax(dim=0).numpy(), "prediction")
        self.ground(axes[2], cost.numpy() ** 0.5, "what the focal loss charges each cell, square root")
        _write(figure, "loss")

    def boxes(self) -> None:
        """Candidates, boxes that are left, and the labels."""
        heat = self.outputs.maps["heatmap"][0].sigmoid()
        peak = (torch.nn.functional.max_pool2d(heat[None], 3, stride=1, padding=1)[0] == heat) & (heat > 0.05)
        head: CenterHead = self.model.head
        where = peak.nonzero()
        centers = head.centers[:, where[:, 1], where[:, 2]].T.numpy()
        kept = self.found[self.found.score > 0.3]
        figure, axes = _figure(1, 3, (9.6, 3.7))
        self.ground(axes[0], heat.amax(dim=0).numpy(), f"{len(where)} peaks of 3 x 3 cells above 0.05")
        axes[0].scatter(centers[:, 1], centers[:, 0], s=6, color="#00c8ff")
        self.ground(axes[1], None, f"{len(kept)} boxes with a score above 0.3")
        self.outlines(axes[1], kept, FOUND)
        self.ground(axes[2], None, "with the labels, green")
        self.outlines(axes[2], self.sample.boxes, LABEL, 1.6)
        self.outlines(axes[2], kept, FOUND)
        _write(figure, "boxes")


def _figure(rows: int, columns: int, size: Sequence[float]):
    return plt.subplots(rows, columns, figsize=size, layout="constrained")


def _write(figure, name: str) -> None:
    path = PICTURES / f"stage_{name}.jpg"
    figure.savefig(path, dpi=110, pil_kwargs={"quality": 82})
    plt.close(figure)
    print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    stages = Stages(sys.argv[1] if len(sys.argv) > 1 else "data/nano")
    for draw in (
        stages.camera,
        stages.lift,
        stages.lidar,
        stages.radar,
        stages.fuse,
        stages.decode,
        stages.loss,
        stages.boxes,
    ):
        draw()
