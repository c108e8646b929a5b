"""How near a training step is to its own convolutions: ``python -m benchmarks.model_step [threads [grid=graded ...]]``
on random data, with overrides of ``train.py``.

The step as it is trained, a batch of eight: forward, loss, backward, clipping, Muon and AdamW, moving average. The limit:
the same network's convolutions alone, forward and backward, on maps of the same shapes, layout and precision. Both in the
same run, the camera learning and frozen; then inference, and the split of the step by part.
"""

import json
import sys
import time
from collections.abc import Callable

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from fusion_net.data.batch import Batch
from fusion_net.data.datamodule import keep_memory
from fusion_net.models.fusion_net import FusionNet
from fusion_net.models.precision import autocast
from fusion_net.training.optimizer import make_optimizer
from tests.fixtures.random_batch import load_model, random_batch

EMA_EVERY = 4
"""Steps, as in ``training.step_end``."""


def median_ms(run: Callable[[], object], repeats: int) -> float:
    """Median milliseconds of a call after two that warm up."""
    times = []
    for _ in range(repeats + 2):
        begin = time.perf_counter()
        run()
        times.append(time.perf_counter() - begin)
    return 1e3 * sorted(times[2:])[repeats // 2]


class Step:
    """One training step, without Lightning and without a data loader."""

    def __init__(self, model: FusionNet, batch: Batch, *, frozen: bool) -> None:
        network = model.image_network
        assert network is not None
        network.freeze(frozen)
        self.model, self.batch, self.count = model.train(), batch, 0
        self.optimizer = make_optimizer(
            model, outputs=(model.head.heatmap[-1], model.head.box[-1]), lr=1e-3, weight_decay=0.01
        )
        self.average = AveragedModel(model, multi_avg_fn=get_ema_multi_avg_fn(0.98**EMA_EVERY), use_buffers=True)

    def __call__(self) -> dict[str, float]:
        """Takes it; milliseconds of its parts."""
        clock = [time.perf_counter()]
        self.batch.ego_T_cam[:, :, 0, 3] += 1e-4  # a new calibration each step, as ego motion makes it
        with autocast("auto"):
            outputs = self.model(self.batch)
            clock.append(time.perf_counter())
            loss = self.model.loss(outputs, self.batch)["loss"]
        clock.append(time.perf_counter())
        loss.backward()
        clock.append(time.perf_counter())
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), 10.0)
        self.optimizer.step()
        self.optimizer.zero_grad()
        clock.append(time.perf_counter())
        if self.count % EMA_EVERY == 0:
            self.average.update_parameters(self.model)
        self.count += 1
        clock.append(time.perf_counter())
        parts = ("forward", "loss", "backward", "clip and optimizer", "moving average")
        return {n: 1e3 * (b - a) for n, a, b in zip(parts, clock[:-1], clock[1:], strict=True)}


def convolutions_alone(step: Step) -> Callable[[], None]:
    """What runs the convolutions of a step, and nothing else, forward and backward."""
    calls: list[tuple[nn.Conv2d, torch.Tensor]] = []
    convs = [m for m in step.model.modules() if isinstance(m, nn.Conv2d)]
    hooks = [m.register_forward_hook(lambda m, inputs, _: calls.append((m, inputs[0]))) for m in convs]
    with autocast("auto"):
        step.model(step.batch)
    for hook in hooks:
        hook.remove()
    prepared = []
    for conv, seen in calls:
        dtype = seen.dtype if not torch.is_autocast_enabled("cpu") else torch.get_autocast_dtype("cpu")
        with autocast("auto"):
            dtype = conv(seen).dtype  # that of the products
        x = torch.randn(seen.shape).to(dtype).contiguous(memory_format=torch.channels_last)
        weight = conv.weight.detach().to(dtype).contiguous(memory_format=torch.channels_last)
        x.requires_grad_(seen.requires_grad)
        weight.requires_grad_(conv.weight.requires_grad)
        y = nn.functional.conv2d(x, weight, None, conv.stride, conv.padding)
        prepared.append((conv, x, weight, torch.randn_like(y)))

    def run() -> None:
        for conv, x, weight, gradient in prepared:
            y = nn.functional.conv2d(x, weight, None, conv.stride, conv.padding)
            if y.requires_grad:
                y.backward(gradient)
                x.grad = weight.grad = None

    return run


def measure(*overrides: str, frozen: bool, repeats: int = 20) -> dict[str, float]:
    """Milliseconds of the whole step, of its parts and of its convolutions alone, in turn."""
    torch.manual_seed(0)
    model = load_model(*overrides)
    step = Step(model, random_batch(grid=model.grid), frozen=frozen)
    step()  # a frozen camera sees each sample once, its features are kept
    limit = convolutions_alone(step)
    parts: list[dict[str, float]] = []
    whole, alone = [], []
    for _ in range(2):  # in turn, so that both see the same machine
        whole.append(median_ms(lambda: parts.append(step()), repeats))
        alone.append(median_ms(limit, repeats))
    split = {name: sorted(p[name] for p in parts)[len(parts) // 2] for name in parts[0]}
    split["moving average"] = sum(p["moving average"] for p in parts) / len(parts)
    return {"step": min(whole), "convolutions alone": min(alone)} | split


def inference(*overrides: str, batch_size: int = 8) -> float:
    """Milliseconds a sample from a batch to boxes, all sensors."""
    model = load_model(*overrides).eval()
    batch = random_batch(batch_size, grid=model.grid)

    def run() -> None:
        batch.ego_T_cam[:, :, 0, 3] += 1e-4
        with torch.no_grad(), autocast("auto"):
            model.decode(model(batch))

    return median_ms(run, 10) / batch_size


def main() -> None:
    """Print the ratio and the split and, last, one JSON object."""
    torch.set_num_threads(int(sys.argv[1]) if len(sys.argv) > 1 else 2)
    keep_memory()
    overrides = sys.argv[2:]
    figures = {mode: measure(*overrides, frozen=mode == "frozen") for mode in ("learning", "frozen")}
    print(f"{torch.get_num_threads()} threads, batch of 8; ms\n{'':20}{'camera learning':>16}{'camera frozen':>16}")
    for name in figures["learning"]:
        print(f"{name:20}{figures['learning'][name]:16.1f}{figures['frozen'][name]:16.1f}")
    ratio = {mode: each["step"] / each["convolutions alone"] for mode, each in figures.items()}
    rates = {mode: 8e3 / each["step"] for mode, each in figures.items()}
    print(f"{'ratio':20}{ratio['learning']:16.2f}{ratio['frozen']:16.2f}")
    each = {"inference_ms_per_sample": inference(*overrides)}
    print(f"inference, all sensors: {each['inference_ms_per_sample']:.1f} ms a sample")
    print(json.dumps({"ratio_to_convolutions": ratio, "samples_per_s": rates, "ms": figures} | each))


if __name__ == "__main__":
    main()
