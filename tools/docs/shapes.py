"""Writes ``docs/learn/shapes.md``: one keyframe through the default network, every shape as the network has it.

``python tools/docs/shapes.py``; a test holds the page to what this writes.
"""

from pathlib import Path

import torch
from torch import Tensor, nn

from fusion_net.common.cli.command import build
from fusion_net.common.cli.composed import composed
from fusion_net.common.nuscenes_format import MODALITIES
from fusion_net.data.batch import LIDAR_CHANNELS, RADAR_CHANNELS, Batch
from fusion_net.models.fusion_net import FusionNet

PAGE = Path(__file__).resolve().parents[2] / "docs" / "learn" / "shapes.md"
POINTS, DETECTIONS = 8000, 120
"""LiDAR points and radar detections of the keyframe. The network takes any number."""
MAPS = {
    "heatmap": "by class, how much a centre is in the cell (logit)",
    "offset": "of the centre from the cell's, x and y in m",
    "height": "z of the centre in m",
    "size": "log of width, length, height in m",
    "rot": "sin and cos of yaw",
    "velocity": "m/s; added to the radar's radial one",
    "log_variance": "of the centre's x and y, m²",
}
HEAD = """# Shapes, stage by stage

One keyframe of `data=nano` through the network of `python train.py experiment=nano`. Written by
`python tools/docs/shapes.py`, which runs the network; a test holds the page to it. B is the batch (here 1), N the cameras,
P LiDAR points, R radar detections, C channels, D depth bins, K classes, Y and X rows and columns of the bird's-eye view.
"""


def nano() -> tuple[FusionNet, Batch]:
    """The default network, untrained, and a batch of one keyframe of noise."""
    cfg = composed("train")
    torch.manual_seed(0)
    model: FusionNet = build(cfg.model, "model").eval()
    height, width = 96, 320
    extent = torch.tensor([50.0, 40.0, 3.0])
    lidar, radar = (
        torch.cat([torch.rand(count, 3) * extent - torch.tensor([0.0, 20.0, 0.0]), torch.rand(count, extra)], dim=1)
        for count, extra in ((POINTS, len(LIDAR_CHANNELS) - 3), (DETECTIONS, len(RADAR_CHANNELS) - 3))
    )
    cam_K = torch.tensor([[220.0, 0, width / 2], [0, 220.0, height / 2], [0, 0, 1]])
    ego_T_cam = torch.tensor([[0.0, 0, 1, 1.7], [-1, 0, 0, 0], [0, -1, 0, 1.5], [0, 0, 0, 1]])
    stride = model.encoders["camera"].image_network.stride
    batch = Batch(
        tokens=["noise"],
        images=torch.zeros(1, 1, 3, height, width, dtype=torch.uint8),
        cam_K=cam_K[None, None],
        ego_T_cam=ego_T_cam[None, None],
        lidar_points=lidar,
        lidar_batch=torch.zeros(POINTS, dtype=torch.int64),
        radar_points=radar,
        radar_batch=torch.zeros(DETECTIONS, dtype=torch.int64),
        present=torch.ones(1, len(MODALITIES), dtype=torch.bool),
        lidar_depth=torch.zeros(1, 1, height // stride, width // stride),
    )
    return model, batch


def shapes_page() -> str:
    """The page's text."""
    model, batch = nano()
    camera = model.encoders["camera"]
    seen: dict[str, Tensor] = {}
    watched = {"decoder": model.decoder, "view": camera.view_transform, "fuser": model.fuser}
    watched |= dict(model.encoders.items())
    hooks = [part.register_forward_hook(_keeper(seen, name)) for name, part in watched.items()]
    with torch.inference_mode():
        outputs = model(batch)
    for hook in hooks:
        hook.remove()
    image, grid = outputs.image, model.grid
    rows = [
        ("the keyframe", "images", "(B, N, 3, H, W)", batch.images, "RGB of 0 to 255; direction, no distance"),
        ("", "LiDAR points", "(P, 5)", batch.lidar_points, ", ".join(LIDAR_CHANNELS)),
        ("", "radar detections", "(R, 7)", batch.radar_points, ", ".join(RADAR_CHANNELS)),
        ("", "present", "(B, 3)", batch.present, "which of camera, LiDAR, radar are alive"),
        ("image network", "features", "(B, N, C, h, w)", image.features, "of cells of 8 x 8 pixels"),
        ("", "depth logits", "(B, N, D, h, w)", image.depth_logits, f"{_depths(camera)}"),
        ("", "class logits", "(B, N, K, h, w)", image.class_logits, "what each cell shows"),
        ("lift and splat", "camera layers", "(B, C, Y, X)", seen["view"], "feature times probability, summed per cell"),
        ("encoders", "camera map", "(B, C, Y, X)", seen["camera"], "the first time that the camera has metres"),
        (
            "",
            "LiDAR map",
            "(B, C, Y, X)",
            seen["lidar"],
            f"pillars of {model.encoders['lidar'].pillars.cell:.2f} m, halved",
        ),
        ("", "radar map", "(B, C, Y, X)", seen["radar"], "a raster with Doppler, through convolutions"),
        ("fuser", "fused map", "(B, C, Y, X)", seen["fuser"], "here the sensors meet; an absent one is zero"),
        ("decoder", "decoded map", "(B, C, Y, X)", seen["decoder"], "by way of half and quarter resolution"),
        *(
            ("" if i else "head", name, "(B, ., Y, X)", each, MAPS.get(name, ""))
            for i, (name, each) in enumerate(outputs.maps.items())
        ),
    ]
    lines = ["| stage | what | axes | shape | values | |", "|---|---|---|---|--:|---|"]
    for stage, what, axes, value, note in rows:
        shape = " x ".join(map(str, value.shape))
        lines.append(f"| {stage} | {what} | {axes} | {shape} | {value.numel():,} | {note} |")
    cells_y, cells_x = grid.shape
    ground = f"""The grid has {cells_y} x {cells_x} cells of {grid.cell:.3g} m: x from {grid.x_min:g} to {grid.x_max:g} m ahead,
y from {grid.y_min:g} to {grid.y_max:g} m to the left. A point is in row floor((y + {-grid.y_min:g}) / {grid.cell:.3g}) and
column floor((x - {grid.x_min:g}) / {grid.cell:.3g}), whichever sensor it is of. Peaks of the heat map are the boxes: at most
100, best first.
"""
    return "\n".join([HEAD, *lines, "", ground, *_parameters(model)])


def _keeper(seen: dict[str, Tensor], name: str):
    def keep(_module: nn.Module, _inputs: tuple, output) -> None:
        seen[name] = output if isinstance(output, Tensor) else output.bev

    return keep


def _depths(camera: nn.Module) -> str:
    centers = camera.view_transform.bins.centers()
    return f"a distribution over {len(centers)} depths, {float(centers[0]):.1f} to {float(centers[-1]):.1f} m"


def _parameters(model: FusionNet) -> list[str]:
    parts: dict[str, nn.Module] = {f"{name} encoder": encoder for name, encoder in model.encoders.items()}
    parts |= {"fuser": model.fuser, "decoder": model.decoder, "head": model.head}
    rows = [f"| {name} | {sum(p.numel() for p in part.parameters()):,} |" for name, part in parts.items()]
    return ["| part | parameters |", "|---|--:|", *rows, ""]


if __name__ == "__main__":
    PAGE.write_text(shapes_page(), encoding="utf-8")
    print(PAGE)
