"""Samples to batches: the torch Dataset, the order of an epoch, the collation and the loader."""

import ctypes
import signal
from collections.abc import Iterator, Sequence
from dataclasses import replace
from multiprocessing.reduction import ForkingPickler

import cv2
import numpy as np
import torch
from beartype import beartype
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

from fusion_net.common.bev_grid import BEVGrid
from fusion_net.common.faults import FaultPlan
from fusion_net.data.augment import Augment
from fusion_net.data.batch import Batch
from fusion_net.data.cache_folder import SampleCache, check_cache
from fusion_net.data.readable import refuse_missing_files, refuse_mixed_image_sizes
from fusion_net.data.samples import Sample, SampleReader, labelled_boxes
from fusion_net.data.targets import center_targets
from fusion_net.nuscenes.datasets import open_datasets, samples_of_split
from fusion_net.nuscenes.nuscenes import NuScenes
from fusion_net.nuscenes.origin import whole_command
from fusion_net.nuscenes.tables import manifest


@beartype
class NuScenesDataset(Dataset):
    """The samples of a split of one nuScenes data set, or of several read as one: ``root`` is the folder of a data set, a
    folder of shards or a list of these. ``version`` chooses among the folders of tables of a root. ``scenes``: of the split
    only so many, the first ones of each data set; None: all.

    ``grid``: the cells of the targets; boxes off it are left out. ``cache``: where what was decoded (not what was augmented)
    is kept, one of ``CACHES``. ``datasets``: those of ``root``, where they are open already. Further arguments are those
    of :class:`SampleReader`, whose faults are sampled from ``seed``. An index is a sample's place or (epoch, place):
    augmentation follows from (seed, epoch, place) alone.
    """

    def __init__(
        self,
        root: str | list[str],
        split: str,
        *,
        grid: BEVGrid,
        version: str | None = None,
        scenes: int | None = None,
        augment: Augment | None = None,
        min_radius: int = 2,
        cache: str | bool = "none",
        seed: int = 0,
        datasets: list[NuScenes] | None = None,
        **reader,
    ) -> None:
        check_cache(cache)
        self.grid, self.augment, self.min_radius, self.seed = grid, augment, min_radius, seed
        self.reader = SampleReader(**reader, fault_seed=seed)
        self.datasets = open_datasets(root, version, mapped=cache == "disk") if datasets is None else datasets
        self.index = samples_of_split(self.datasets, split, scenes=scenes)
        self._decoded = SampleCache(str(cache), self.index, split, self.reader)
        refuse_missing_files(self._decoded.new, self.reader)
        refuse_mixed_image_sizes(self.reader, self.index)
        for nusc in self.datasets:
            FaultPlan(self.reader.faults).check(nusc.modalities, nusc.beams)

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, key: int | tuple[int, int]) -> Sample:
        epoch, place = key if isinstance(key, tuple) else (0, key)
        sample = self.decoded(place)
        if self.augment is not None:
            sample = self.augment(sample, np.random.default_rng([self.seed, epoch, place]))
        return replace(sample, boxes=sample.boxes[self.grid.contains(sample.boxes.center)])

    def decoded(self, place: int) -> Sample:
        """The sample at a place as it is read, before augmentation; its arrays may be read-only."""
        sample = self._decoded.get(place)
        return self._decoded.put(place, self.reader.read(*self.index[place])) if sample is None else sample

    @property
    def fingerprint(self) -> list[str]:
        """Of each data set, whole or in shards, the hash of the settings that it was generated with."""
        return list(dict.fromkeys(nusc.fingerprint for nusc in self.datasets))

    @property
    def made_by(self) -> dict[str, str]:
        """By fingerprint the command that makes the data set, shards as one; "" where its manifest does not say."""
        return {nusc.fingerprint: whole_command(nusc.root, manifest(nusc.root)) for nusc in self.datasets}

    def has_labels(self) -> bool:
        """Whether any sample has a labelled object on the grid."""
        return any(
            self.grid.contains(labelled_boxes(nusc, token, self.classes).center).any() for nusc, token in self.index
        )

    def why_no_labels(self) -> str:
        """Of a split without labels (:meth:`has_labels`), what they lack."""
        found = [nusc.annotations(token, self.classes) for nusc, token in self.index]
        if not any(map(len, found)):
            return f"none of its {len(self.index)} samples has a label of {', '.join(self.classes)}"
        if not any(each.num_pts.any() for each in found):
            return (
                "every label has num_lidar_pts=0 and num_radar_pts=0 in sample_annotation.json, and only those with a point"
                " count"
            )
        grid = self.grid
        return (
            "no label with a LiDAR or radar point lies on the grid"
            f" (x {grid.x_min} to {grid.x_max} m, y {grid.y_min} to {grid.y_max} m)"
        )

    @property
    def classes(self) -> list[str]:
        """Names that box labels and heat maps index."""
        return self.reader.classes

    def collate(self, samples: list[Sample]) -> Batch:
        """Samples as one batch with targets."""
        boxes = tuple(sample.boxes for sample in samples)
        targets = center_targets(boxes, grid=self.grid, num_classes=len(self.classes), min_radius=self.min_radius)
        return replace(collate(samples), targets=targets)


def collate(samples: list[Sample]) -> Batch:
    """Samples as one batch without targets. Points are joined end to end, nothing is padded."""

    def stacked(name: str, dtype: torch.dtype) -> Tensor:
        return torch.from_numpy(np.stack([getattr(sample, name) for sample in samples])).to(dtype)

    def stacked_if_known(name: str, dtype: torch.dtype) -> Tensor | None:
        return None if any(getattr(sample, name) is None for sample in samples) else stacked(name, dtype)

    def owner(name: str) -> Tensor:
        return torch.from_numpy(np.repeat(np.arange(len(samples)), [len(getattr(sample, name)) for sample in samples]))

    return Batch(
        tokens=[sample.token for sample in samples],
        images=_stacked_images([sample.images for sample in samples]),
        cam_K=stacked("cam_K", torch.float32),
        ego_T_cam=stacked("ego_T_cam", torch.float32),
        lidar_points=torch.from_numpy(np.concatenate([sample.lidar_points for sample in samples])),
        lidar_batch=owner("lidar_points"),
        radar_points=torch.from_numpy(np.concatenate([sample.radar_points for sample in samples])),
        radar_batch=owner("radar_points"),
        present=stacked("present", torch.bool),
        lidar_depth=stacked("lidar_depth", torch.float32),
        dense_depth=stacked_if_known("dense_depth", torch.float32),
        class_map=stacked_if_known("class_map", torch.int64),
        colors=stacked_if_known("colors", torch.float32),
        boxes=tuple(sample.boxes for sample in samples),
    )


def _stacked_images(images: list[NDArray[np.uint8]]) -> Tensor:
    """(B, N, 3, H, W) of B times (N, H, W, 3): each colour is written once, to where it belongs."""
    count, height, width, colors = images[0].shape
    stacked = np.empty((len(images), count, colors, height, width), np.uint8)
    for own, planes in zip(images, stacked, strict=True):
        for image, out in zip(own, planes, strict=True):
            cv2.split(image, list(out))
    return torch.from_numpy(stacked)


class StepSampler(Sampler[list[tuple[int, int]]]):
    """The keys (epoch, place) of each training step's batch, of the ``places`` alone. They follow from (seed, step) alone, so
    that a run that is resumed before step ``first`` sees what an unbroken one sees. An epoch's last samples that fill no batch
    are left out.

    To the training loop all ``steps`` are one long epoch, so loader processes start once. Of ``ranks`` processes that train
    together each takes its part of the batch.
    """

    def __init__(
        self, places: Sequence[int], *, batch_size: int, steps: int, first: int = 0, seed: int = 0, ranks: int = 1
    ) -> None:
        self.places, self.batch_size, self.steps, self.first, self.seed = places, batch_size, steps, first, seed
        self.ranks = ranks
        self._epoch, self._order = -1, np.arange(0)

    def keys(self, step: int) -> list[tuple[int, int]]:
        """Keys of one step's batch, of all ranks together."""
        epoch, batch = divmod(step, len(self.places) // self.batch_size)
        if epoch != self._epoch:
            self._epoch, self._order = epoch, np.random.default_rng([self.seed, epoch]).permutation(self.places)
        return [(epoch, place) for place in self._order[batch * self.batch_size :][: self.batch_size].tolist()]

    def __iter__(self) -> Iterator[list[tuple[int, int]]]:
        rank = torch.distributed.get_rank() if self.ranks > 1 else 0
        return (self.keys(step)[rank :: self.ranks] for step in range(self.first, self.steps))

    def __len__(self) -> int:
        return self.steps


def train_loader(dataset: NuScenesDataset, sampler: StepSampler, num_workers: int = 0) -> DataLoader:
    """The batches of a run's training steps."""
    if num_workers:
        cv2.setNumThreads(1)  # here, before the fork: a child that ends the parent's pool of threads waits for ever
    return DataLoader(
        dataset,
        batch_sampler=sampler,
        collate_fn=dataset.collate,
        num_workers=num_workers,
        worker_init_fn=_start_worker,
    )


def make_loader(dataset: NuScenesDataset, batch_size: int) -> DataLoader:
    """All samples once, in order."""
    return DataLoader(dataset, batch_size=batch_size, collate_fn=dataset.collate)


def _start_worker(number: int) -> None:
    """Sets up a loader process. Batches go to the training process through a pipe, not through shared memory: Docker
    gives that 64 MB, and a batch that finds no room is lost, while the training process waits for it. Signals that reach
    the whole group, as Ctrl-C does, are the training process's to answer; its loaders end with it."""
    ForkingPickler.register(Tensor, lambda tensor: (torch.from_numpy, (tensor.numpy(),)))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)


def keep_memory() -> None:
    """Lets the allocator keep what is freed: by default glibc gives large blocks back at once, and a training step, which
    frees and takes 20 MB maps by the dozen, spends a twentieth of its time on page faults."""
    trim_threshold, mmap_max = -1, -4  # of malloc.h
    try:
        libc = ctypes.CDLL("libc.so.6")
        libc.mallopt(trim_threshold, 2**31 - 1)
        libc.mallopt(mmap_max, 0)
    except OSError:  # another C library
        return


def trim_memory() -> None:
    """Gives freed memory back to the system. Point lists of ever new lengths break the heap of glibc into pieces that
    it keeps; called every 50 steps or so this holds the resident size of a training process at what it uses."""
    try:
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    except OSError:  # another C library: nothing to trim
        return
