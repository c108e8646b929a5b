"""Where the time of a training step goes: ``python -m benchmarks.model_step [threads]`` on random data.

The default model on a batch of eight: milliseconds by stage, with the camera learning and with it frozen.
"""

import json
import sys
import time

import torch

from fusion_net.data.batch import Batch
from fusion_net.models.encoders.camera_encoder import CameraEncoder
from fusion_net.models.fusion_net import FusionNet
from tests.fixtures.random_batch import load_model, random_batch


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
