"""Samples to batches: the torch Dataset, the order of an epoch, the collation and the loader."""

import ctypes
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import torch
from beartype import beartype
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

from fusion_net.bev_grid import BEVGrid
from fusion_net.data.augment import Augment
from fusion_net.data.faults import FaultPlan
from fusion_net.data.missing_files import refuse_missing_files
from fusion_net.data.samples import Sample, SampleReader, labelled_boxes
from fusion_net.data.targets import center_targets
from fusion_net.data.trees import open_trees, refuse_unlike_images, split_of
from fusion_net.structures import Batch


@beartype
class NuScenesDataset(Dataset):
    """The samples of a split of one nuScenes tree, or of several read as one: ``root`` is a tree, a folder of shards or a
    list of these. ``version`` chooses among the folders of tables of a root.

    ``grid``: the cells of the targets; boxes off it are left out. ``cache`` keeps what was decoded (not what was
    augmented) in memory. Further arguments are those of :class:`SampleReader`, whose faults draw from ``seed``. An index is a
    sample's place or (epoch, place): augmentation follows from (seed, epoch, place) alone.
    """

    def __init__(
        self,
        root: str | list[str],
        split: str,
        *,
        grid: BEVGrid,
        version: str | None = None,
        augment: Augment | None = None,
        min_radius: int = 2,
        cache: bool = False,
        seed: int = 0,
        **reader,
    ) -> None:
        self.grid, self.augment, self.min_radius, self.cache, self.seed = grid, augment, min_radius, cache, seed
        self.reader = SampleReader(**reader, fault_seed=seed)
        self.trees = open_trees(root, version)
        self.index = split_of(self.trees, split)
        refuse_missing_files(self.index, self.reader)
        refuse_unlike_images(self.reader, self.index)
        for tree in self.trees:
            FaultPlan(self.reader.faults).check(tree.modalities)
        self._decoded: dict[int, Sample] = {}

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, key: int | tuple[int, int]) -> Sample:
        epoch, place = key if isinstance(key, tuple) else (0, key)
        sample = self._decoded.get(place)
        if sample is None:
            sample = self.reader.read(*self.index[place])
            if self.cache:
                self._decoded[place] = sample
        if self.augment is not None:
            sample = self.augment(sample, np.random.default_rng([self.seed, epoch, place]))
        return replace(sample, boxes=sample.boxes[self.grid.contains(sample.boxes.center)])

    @property
    def fingerprint(self) -> list[str]:
        """Of each data set, whole or in shards, the hash of the settings that it was generated with."""
        return list(dict.fromkeys(tree.fingerprint for tree in self.trees))

    def has_labels(self) -> bool:
        """Whether any sample has a labelled object on the grid."""
        return any(
            self.grid.contains(labelled_boxes(tree, token, self.classes).center).any() for tree, token in self.index
        )

    def why_no_labels(self) -> str:
        """Of a split without labels (:meth:`has_labels`), what they lack."""
        found = [tree.annotations(token, self.classes) for tree, token in self.index]
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
        images=stacked("images", torch.uint8).permute(0, 1, 4, 2, 3).contiguous(),
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
        boxes=tuple(sample.boxes for sample in samples),
    )


class EpochSampler(Sampler[tuple[int, int]]):
    """Gives (epoch, place): the order of an epoch, and what is drawn for a sample in it, follow from (seed, epoch)
    alone, so that a resumed run sees what an unbroken one sees."""

    def __init__(self, length: int, *, shuffle: bool, seed: int = 0) -> None:
        self.length, self.shuffle, self.seed, self.epoch = length, shuffle, seed, 0
        self.seen = 0

    def set_epoch(self, epoch: int) -> None:
        """Which epoch comes next."""
        self.epoch = epoch

    def go_on(self, epoch: int, seen: int) -> None:
        """Begins in an epoch of which an interrupted run saw the first ``seen`` places. (Loader processes fetch batches
        before Lightning calls ``set_epoch``, and it does not skip those that were seen.)"""
        self.epoch, self.seen = epoch, seen

    def __iter__(self) -> Iterator[tuple[int, int]]:
        order = np.arange(self.length)
        if self.shuffle:
            np.random.default_rng([self.seed, self.epoch]).shuffle(order)
        first, self.seen = self.seen, 0
        return iter([(self.epoch, place) for place in order[first:].tolist()])

    def __len__(self) -> int:
        return self.length


def make_loader(
    dataset: NuScenesDataset, *, batch_size: int, shuffle: bool = False, num_workers: int = 0, drop_last: bool = False
) -> DataLoader:
    """Batches of a dataset. Its sampler's ``set_epoch`` is to be called before each epoch (Lightning does)."""
    if num_workers:
        cv2.setNumThreads(1)  # here, before the fork: a child that ends the parent's pool of threads waits for ever
    return DataLoader(
        dataset,
        batch_size=batch_size,
        sampler=EpochSampler(len(dataset), shuffle=shuffle, seed=dataset.seed),
        collate_fn=dataset.collate,
        num_workers=num_workers,
        persistent_workers=num_workers > 0,
        drop_last=drop_last,
    )


def trim_memory() -> None:
    """Gives freed memory back to the system. Point lists of ever new lengths break the heap of glibc into pieces that
    it keeps; called every 50 steps or so this holds the resident size of a training process at what it uses."""
    try:
        ctypes.CDLL("libc.so.6").malloc_trim(0)
    except OSError:  # another C library: nothing to trim
        return
