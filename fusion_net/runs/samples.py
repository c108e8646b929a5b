"""The samples that a trained detector is shown: by default those that it was validated on, which must be its own data."""

import sys
from collections.abc import Sequence

from omegaconf import DictConfig

from fusion_net.common.cli.command import build
from fusion_net.data.datamodule import NuScenesDataset
from fusion_net.evaluation.result_folder import is_same_data
from fusion_net.runs.run_dir import refuse_other_data
from fusion_net.runs.trained import Trained


def open_samples(
    trained: Trained,
    *,
    split: str | None = None,
    root: str | Sequence[str] | None = None,
    version: str | None = None,
    fault: DictConfig | None = None,
) -> NuScenesDataset:
    """The samples of a split with ``fault`` applied. ``split``, ``root`` and ``version`` are those that the detector was
    validated on where they are None; then the data must be what it was trained on."""
    cfg = trained.cfg
    settings = cfg.dataset.val.copy()
    own_version = cfg.data.get("version")
    is_own_data = (root is None or is_same_data(root, cfg.data.root)) and version in (None, own_version)
    settings.root = cfg.data.root if root is None else root
    is_clean = fault is None or fault.name == "none"
    settings.cache = "disk" if settings.cache == "disk" and is_clean else "none"  # each sample is read once
    settings.version = own_version if is_own_data else version
    settings.split = split or settings.split
    if fault is not None:
        settings.faults = fault
    dataset: NuScenesDataset = build(settings)
    _check_fault(trained, dataset)
    if is_own_data:
        _check_data(trained, dataset)
    return dataset


def _check_fault(trained: Trained, dataset: NuScenesDataset) -> None:
    """ValueError for faults that hit no sensor which the detector reads: its scores would be those without them."""
    faults, channels = dataset.reader.faults, dataset.datasets[0].modalities
    hit = {channels[channel] for fault in faults for channel in fault.matches(channels)}
    if hit and not hit & {*trained.cfg.encoders}:
        own = " and ".join(trained.cfg.encoders)
        raise ValueError(
            f"fault: it hits {' and '.join(sorted(hit))}, and this detector reads {own} alone; write fault=none"
        )


def _check_data(trained: Trained, dataset: NuScenesDataset) -> None:
    """A run's own data must be what it was trained on. Shipped weights may be scored on what a later generator made in the
    same place, but then it is said."""
    if not trained.is_shipped:
        refuse_other_data(trained.folder, dataset.fingerprint)
    elif not {*dataset.fingerprint} <= {*trained.record["data"]}:
        here, there = (", ".join(each[:12] for each in both) for both in (dataset.fingerprint, trained.record["data"]))
        print(
            f"warning: {trained.source.name} was trained on data of other settings (manifest {there}, here {here}): its"
            " scores differ, and scenes scored here may be among those it has seen",
            file=sys.stderr,
        )
