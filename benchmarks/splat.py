"""The lift and the splat, four ways: ``python -m benchmarks.splat [threads]``.

The published size: batch of four, six cameras, 16 x 44 feature cells, 48 depth bins, 64 channels, 128 x 128 cells. Each
way runs in a process of its own, so that its peak memory is its own.
"""

import json
import multiprocessing
import resource
import sys
import time

import torch
from torch import Tensor

from fusion_net.models.blocks.splat import SplatIndex, splat

BATCH, CAMERAS, HEIGHT, WIDTH, BINS, CHANNELS, SIDE = 4, 6, 16, 44, 48, 64, 128
PIXELS, CELLS = BATCH * CAMERAS * HEIGHT * WIDTH, BATCH * SIDE * SIDE


def ours(features: Tensor, probability: Tensor, cell: Tensor, kept: Tensor, index: SplatIndex) -> Tensor:
    """The sparse product of ``splat``."""
    return splat(features, probability.flatten().index_select(0, kept), index)


def index_add(features: Tensor, probability: Tensor, cell: Tensor, kept: Tensor, index: SplatIndex) -> Tensor:
    """Outer product, then ``index_add``."""
    return features.new_zeros(CELLS, CHANNELS).index_add(0, cell, _lifted(features, probability, kept))


def scatter_add(features: Tensor, probability: Tensor, cell: Tensor, kept: Tensor, index: SplatIndex) -> Tensor:
    """Outer product, then ``scatter_add``."""
    lifted = _lifted(features, probability, kept)
    return features.new_zeros(CELLS, CHANNELS).scatter_add(0, cell[:, None].expand(-1, CHANNELS), lifted)


def cumsum_trick(features: Tensor, probability: Tensor, cell: Tensor, kept: Tensor, index: SplatIndex) -> Tensor:
    """Outer product, sort by cell, running sum, differences at the ends of the cells (Philion & Fidler 2020)."""
    lifted, ordered = _lifted(features, probability, kept)[index.by_cell.order], cell[index.by_cell.order]
    total, last = lifted.cumsum(0), torch.ones(len(ordered), dtype=torch.bool)
    last[:-1] = ordered[1:] != ordered[:-1]
    total = total[last]
    sums = torch.cat([total[:1], total[1:] - total[:-1]])
    return features.new_zeros(CELLS, CHANNELS).index_put((ordered[last],), sums)


def _lifted(features: Tensor, probability: Tensor, kept: Tensor) -> Tensor:
    return (probability[:, :, None] * features[:, None]).view(-1, CHANNELS)[kept]


WAYS = {"cumsum trick": cumsum_trick, "index_add": index_add, "scatter_add": scatter_add, "ours": ours}


def scene() -> tuple[Tensor, Tensor, Tensor, Tensor, SplatIndex, Tensor]:
    """Features, probabilities, kept entries and their cells: six cameras around the car, rays cut into bins."""
    rng = torch.Generator().manual_seed(0)
    features = torch.randn(PIXELS, CHANNELS, generator=rng)
    probability = torch.randn(PIXELS, BINS, generator=rng).softmax(-1)
    camera, column = torch.arange(CAMERAS)[:, None], torch.arange(WIDTH)
    azimuth = (camera + (column + 0.5) / WIDTH) * (2 * torch.pi / CAMERAS)
    reach = 2.0 + torch.arange(BINS) + 0.5
    xy = torch.stack([torch.cos(azimuth), torch.sin(azimuth)], -1)[:, :, None] * reach[:, None]  # (N, w, D, 2)
    row_column = torch.floor((xy.flip(-1) + 40.0) / 0.625).long()
    inside = ((row_column >= 0) & (row_column < SIDE)).all(-1)
    flat = row_column[..., 0] * SIDE + row_column[..., 1]
    shape = (BATCH, CAMERAS, HEIGHT, WIDTH, BINS)
    cell = (torch.arange(BATCH).view(-1, 1, 1, 1, 1) * SIDE**2 + flat[None, :, None]).expand(shape)
    kept = inside[None, :, None].expand(shape).flatten().nonzero()[:, 0]
    cell = cell.flatten()[kept]
    index = SplatIndex.of(torch.div(kept, BINS, rounding_mode="floor"), cell, pixels=PIXELS, cells=CELLS)
    return features, probability, cell, kept, index, torch.randn(CELLS, CHANNELS, generator=rng)


def measure(name: str, threads: int, repeats: int = 7) -> dict[str, float]:
    """Median milliseconds forward and backward, peak megabytes above the inputs; errors of the gradients."""
    torch.set_num_threads(threads)
    features, probability, cell, kept, index, grad = scene()
    features.requires_grad_()
    probability.requires_grad_()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    forward, backward = [], []
    for _ in range(repeats):
        features.grad = probability.grad = None
        start = time.perf_counter()
        out = WAYS[name](features, probability, cell, kept, index)
        middle = time.perf_counter()
        out.backward(grad)
        forward.append(middle - start)
        backward.append(time.perf_counter() - middle)
    peak = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    exact = features.detach().double().requires_grad_(), probability.detach().double().requires_grad_()
    out = ours(*exact, cell, kept, index)
    truth = torch.autograd.grad(out, exact, grad.double())
    found = torch.autograd.grad(WAYS[name](features, probability, cell, kept, index), (features, probability), grad)
    error = [float((x - y).abs().max()) for x, y in zip(found, truth, strict=True)]
    times = {n: 1e3 * sorted(t)[repeats // 2] for n, t in (("forward_ms", forward), ("backward_ms", backward))}
    return times | {"peak_mb": peak, "feature_grad_error": error[0], "depth_grad_error": error[1], "entries": len(cell)}


def main() -> None:
    """Print the table and, last, one JSON object."""
    threads = int(sys.argv[1]) if len(sys.argv) > 1 else 2
    figures = {}
    for name in WAYS:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            figures[name] = pool.apply(measure, (name, threads))
    print(f"{figures['ours']['entries']} entries, {threads} threads; errors against our float64 gradients")
    print(f"{'':14}{'forward ms':>12}{'backward ms':>13}{'peak MB':>10}{'d features':>12}{'d depth':>10}")
    for name, row in figures.items():
        print(
            f"{name:14}{row['forward_ms']:12.1f}{row['backward_ms']:13.1f}{row['peak_mb']:10.0f}"
            f"{row['feature_grad_error']:12.1e}{row['depth_grad_error']:10.1e}"
        )
    total = {name: row["forward_ms"] + row["backward_ms"] for name, row in figures.items()}
    ratios = {f"ours_vs_{name.replace(' ', '_')}": total[name] / total["ours"] for name in WAYS if name != "ours"}
    print(json.dumps({"threads": threads, "ways": figures, "speedup_forward_backward": ratios}))


if __name__ == "__main__":
    main()
