"""A share of a data set's scenes in a folder of its own: the work of one machine among many that know nothing of each other."""

import re
from dataclasses import dataclass
from pathlib import Path

from beartype import beartype


@beartype
@dataclass(frozen=True)
class Shard:
    """Share ``number`` (from 1) of ``count``: every ``count``-th scene, so that a longer data set adds scenes to each
    share and takes none away. The scenes are those of the whole data set, token by token."""

    number: int
    count: int

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise ValueError(f"shard={self.number}/{self.count}: the first number runs from 1 to the second")

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """The shard written as ``3/64``. ValueError for anything else."""
        parts = re.fullmatch(r"(\d+)/(\d+)", text)
        if parts is None:
            raise ValueError(f"shard={text} is not NUMBER/COUNT, such as shard=3/64")
        return cls(int(parts[1]), int(parts[2]))

    def scenes(self, num_scenes: int) -> list[int]:
        """Indices of its scenes among ``num_scenes``. ValueError when there are more shards than scenes."""
        if self.count > num_scenes:
            raise ValueError(
                f"shard={self.number}/{self.count}: {num_scenes} scenes fill at most {num_scenes} shards; raise"
                " data.num_scenes or divide by less"
            )
        return list(range(self.number - 1, num_scenes, self.count))

    def folder(self, root: Path) -> Path:
        """Where it lies in the folder of the data set; names sort by number."""
        return root / f"shard-{self.number:0{len(str(self.count))}d}-of-{self.count}"
