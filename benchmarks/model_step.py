"""Where the time of a training step goes: ``python -m benchmarks.model_step [threads]`` on random data.

The default model on a batch of eight: milliseconds by stage, with the camera learning and with it frozen.
"""

import json
import sys
import time
from pathlib import Path

import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf

from fusion_net.common import geometry
from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.nuscenes_format import CLASSES, MODALITIES
from fusion_net.data.batch import Batch, Targets
from fusion_net.models.camera_encoder import CameraEncoder
from fusion_net.models.fusion_net import FusionNet

CONFIGS = Path(__file__).parents[1] / "configs"


def load_model(**overrides) -> FusionNet:
    """The model of configs/model/mid.yaml on configs/grid/nano.yaml, with values for the keys that train.yaml holds."""
    keys = {"classes": list(CLASSES), "encoders": list(MODALITIES), "fuser": "concat"}
    config = OmegaConf.create(keys | {"depth_supervision": "dense"} | overrides)
    config.grid = OmegaConf.load(CONFIGS / "grid" / "nano.yaml")
    config.model = OmegaConf.load(CONFIGS / "model" / "mid.yaml")
    return instantiate(config.model)


def random_batch(
    size: int = 8,
    *,
    grid: BEVGrid,
    image: tuple[int, int] = (96, 320),
    cameras: int = 1,
    lidar: int = 12_000,
    radar: int = 60,
    classes: int = len(CLASSES),
    stride: int = 8,
    seed: int = 0,
) -> Batch:
    """Noise of the right shapes: ``lidar`` and ``radar`` points a sample, tilted cameras, three objects a sample."""
    rng = torch.Generator().manual_seed(seed)
    rows, columns = grid.shape
    labels = (size, cameras, image[0] // stride, image[1] // stride)
    cam_K = torch.tensor([[220.0, 0, image[1] / 2 + 3], [0, 220.0, image[0] / 2 - 4], [0, 0, 1]])
    optical = geometry.rigid([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0, 0, 0])
    body = geometry.from_rpy(0.005, 0.026, -0.03, [1.7, 0.1, 1.5])
    ego_T_cam = torch.tensor(body @ optical, dtype=torch.float32)
    noise = 0.01 * torch.randn(size, cameras, 3, generator=rng)
    ego_T_cam = ego_T_cam.repeat(size, cameras, 1, 1)
    ego_T_cam[..., :3, 3] += noise
    extent = torch.tensor([grid.x_max - grid.x_min, grid.y_max - grid.y_min, 3.0])
    low = torch.tensor([grid.x_min, grid.y_min, -0.5])

    def points(count: int, extra: int) -> torch.Tensor:
        return torch.cat(
            [low + extent * torch.rand(size * count, 3, generator=rng), torch.rand(size * count, extra, generator=rng)],
            1,
        )

    heatmap, mask = torch.rand(size, classes, rows, columns, generator=rng) * 0.1, torch.zeros(size, rows, columns) > 0
    for b in range(size):
        for k in range(3):
            row, column = (int(torch.randint(1, n - 1, (1,), generator=rng)) for n in (rows, columns))
            heatmap[b, k % classes, row, column] = 1.0
            mask[b, row, column] = True
    maps = {
        n: torch.rand(size, c, rows, columns, generator=rng) for n, c in (("offset", 2), ("height", 1), ("size", 3))
    }
    maps |= {n: torch.rand(size, 2, rows, columns, generator=rng) for n in ("rot", "velocity")}
    depth = 4 + 40 * torch.rand(labels, generator=rng)
    return Batch(
        tokens=[f"sample-{i}" for i in range(size)],
        images=torch.randint(0, 256, (size, cameras, 3, *image), generator=rng, dtype=torch.uint8),
        cam_K=cam_K.repeat(size, cameras, 1, 1),
        ego_T_cam=ego_T_cam,
        lidar_points=points(lidar, 2),
        lidar_batch=torch.arange(size).repeat_interleave(lidar),
        radar_points=points(radar, 4),
        radar_batch=torch.arange(size).repeat_interleave(radar),
        present=torch.ones(size, 3, dtype=torch.bool),
        lidar_depth=torch.where(torch.rand(labels, generator=rng) < 0.4, depth, 0.0),
        dense_depth=depth,
        class_map=torch.randint(-1, classes, labels, generator=rng),
        targets=Targets(heatmap=heatmap, mask=mask, **maps),
    )


def timed_steps(model: FusionNet, batch: Batch, *, frozen: bool, steps: int = 12) -> dict[str, float]:
    """Median milliseconds of the stages of a training step, by hooks around the parts."""
    camera = model.encoders["camera"]
    assert isinstance(camera, CameraEncoder)
    camera.freeze(frozen)
    model.train()
    optimizer = torch.optim.AdamW([p for p in model.parameters() if p.requires_grad], lr=1e-3)
    parts: dict[str, torch.nn.Module] = {f"{n} forward": m for n, m in model.encoders.items()}
    parts |= {"fuser forward": model.fuser, "decoder forward": model.decoder, "head forward": model.head}
    clock: dict[str, list[float]] = {}
    began: dict[str, float] = {}

    def start(name):
        return lambda *_: began.__setitem__(name, time.perf_counter())

    def stop(name):
        return lambda *_: clock.setdefault(name, []).append(time.perf_counter() - began[name])

    hooks = [m.register_forward_pre_hook(start(n)) for n, m in parts.items()]
    hooks += [m.register_forward_hook(stop(n)) for n, m in parts.items()]
    for step in range(steps):
        batch.ego_T_cam[:, :, 0, 3] += 1e-4 * step  # a new calibration each step, as ego motion makes it
        begin = time.perf_counter()
        with torch.autocast("cpu", torch.bfloat16):
            outputs = model(batch)
        start("loss")()
        loss = model.loss(outputs, batch)["loss"]
        stop("loss")()
        start("backward")()
        loss.backward()
        stop("backward")()
        start("optimizer")()
        optimizer.step()
        optimizer.zero_grad()
        stop("optimizer")()
        clock.setdefault("step", []).append(time.perf_counter() - begin)
    for hook in hooks:
        hook.remove()
    return {name: 1e3 * sorted(times[2:])[len(times[2:]) // 2] for name, times in clock.items()}


def main() -> None:
    """Print the split and, last, one JSON object."""
    torch.set_num_threads(int(sys.argv[1]) if len(sys.argv) > 1 else 2)
    torch.manual_seed(0)
    model = load_model()
    batch = random_batch(grid=model.grid)
    figures = {mode: timed_steps(model, batch, frozen=mode == "frozen") for mode in ("learning", "frozen")}
    print(f"{sum(p.numel() for p in model.parameters()) / 1e6:.2f} M parameters; batch of {batch.size}; ms")
    print(f"{'':20}{'camera learning':>16}{'camera frozen':>16}")
    for name in figures["learning"]:
        print(f"{name:20}{figures['learning'][name]:16.1f}{figures['frozen'][name]:16.1f}")
    rates = {mode: batch.size * 1e3 / times["step"] for mode, times in figures.items()}
    print(json.dumps({"ms": figures, "samples_per_s": rates}))


if __name__ == "__main__":
    main()
