"""Who follows whom: the correspondences of CLEAR MOT (Bernardin and Stiefelhagen 2008), as nuScenes makes them.

Frame by frame a label keeps the prediction that it had, if that is still near enough; what is left is assigned so that as
many pairs as possible are made and their distances add up to the least (as motmetrics 1.4.0 does). A label that gets another
prediction than the one it had before is switched, however long ago that was.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from fusion_net.metrics.track_paths import Paths

MISS, MATCH, SWITCH = 0, 1, 2
"""What becomes of a label in a frame."""


class Pair(NamedTuple):
    """A label and a prediction that are near each other, by their rows, with their tracks."""

    frame: int
    label: int
    found: int
    label_track: int
    found_track: int
    score: float
    metres: float


@dataclass(frozen=True)
class Followed:
    """The G labels of a class, track by track in the order of time, and what becomes of each."""

    track: NDArray[np.int64]  # (G,)
    event: NDArray[np.int64]  # (G,) MISS, MATCH or SWITCH
    distance: NDArray[np.float64]  # (G,) metres; 0 where missed
    score: NDArray[np.float64]  # (G,) of the prediction; 0 where missed
    scene: NDArray[np.int64]  # (G,) number of the scene
    num_found: NDArray[np.int64]  # predictions of each scene that took part
    num_frames: int  # frames with a label or a prediction


class Correspondences:
    """Labels and predictions of one class over all scenes; called with a score it says who follows whom, of the predictions
    with at least that score. ``distance``: metres within which they correspond; ``scene`` (S,) of each frame."""

    def __init__(self, truth: Paths, found: Paths, *, distance: float, scene: NDArray[np.int64]) -> None:
        self._truth, self._found, self._scene = truth, found, scene
        self._order = np.lexsort([truth.frame, truth.track])
        self._pairs: dict[int, list[Pair]] = {}
        for pair in _near(truth, found, distance):
            self._pairs.setdefault(pair.frame, []).append(pair)

    @property
    def has_labels(self) -> bool:
        """Whether there is anything to follow."""
        return len(self._truth) > 0

    @property
    def levels(self) -> NDArray[np.float64]:
        """The scores of the predictions, each once, rising: between two of them the answer is the same."""
        return np.unique(self._found.score)

    def __call__(self, min_score: float = -np.inf) -> Followed:
        """Who follows whom."""
        count = len(self._truth)
        event, distance, score = np.full(count, MISS), np.zeros(count), np.zeros(count)
        scene, had = -1, dict[int, int]()
        for frame, pairs in self._pairs.items():
            if self._scene[frame] != scene:
                scene, had = self._scene[frame], {}
            for pair in _followers([pair for pair in pairs if pair.score >= min_score], had):
                is_other = had.get(pair.label_track, pair.found_track) != pair.found_track
                had[pair.label_track] = pair.found_track
                event[pair.label] = SWITCH if is_other else MATCH
                distance[pair.label], score[pair.label] = pair.metres, pair.score
        takes_part, order = self._found.score >= min_score, self._order
        frames = np.unique(np.concatenate([self._truth.frame, self._found.frame[takes_part]]))
        return Followed(
            track=self._truth.track[order],
            event=event[order],
            distance=distance[order],
            score=score[order],
            scene=self._scene[self._truth.frame[order]],
            num_found=np.bincount(self._scene[self._found.frame[takes_part]], minlength=int(self._scene.max()) + 1),
            num_frames=len(frames),
        )


def _followers(pairs: list[Pair], had: dict[int, int]) -> list[Pair]:
    """Of a frame's near pairs, by label, those that correspond. ``had``: what each label's track was followed by last."""
    kept: list[Pair] = []
    labels, found = set[int](), set[int]()
    for pair in pairs:
        if had.get(pair.label_track) == pair.found_track and pair.found not in found:
            kept.append(pair)
            labels.add(pair.label)
            found.add(pair.found)
    rest = [pair for pair in pairs if pair.label not in labels and pair.found not in found]
    if len({pair.label for pair in rest}) == len({pair.found for pair in rest}) == len(rest):
        return kept + rest
    rows, row = np.unique([pair.label for pair in rest], return_inverse=True)
    columns, column = np.unique([pair.found for pair in rest], return_inverse=True)
    far = 1.0 + 2 * len(rest) * max(pair.metres for pair in rest)  # one pair more is worth any distance
    cost, place = np.full((len(rows), len(columns)), far), np.full((len(rows), len(columns)), -1)
    cost[row, column], place[row, column] = [pair.metres for pair in rest], np.arange(len(rest))
    chosen = place[linear_sum_assignment(cost)]
    return kept + [rest[i] for i in chosen[chosen >= 0].tolist()]


def _near(truth: Paths, found: Paths, distance: float) -> list[Pair]:
    """Every pair of one frame that is nearer than ``distance`` metres, by frame and label."""
    if not len(truth) or not len(found):
        return []
    apart = 1e7  # metres between frames along a third axis: no neighbour is of another
    trees = [cKDTree(np.column_stack([paths.xy, apart * paths.frame])) for paths in (truth, found)]
    near = trees[0].query_ball_tree(trees[1], distance * (1 + 1e-9))
    row = np.repeat(np.arange(len(near)), [len(rows) for rows in near])
    other = np.array([i for rows in near for i in sorted(rows)], np.int64)
    metres = np.hypot(*(truth.xy[row] - found.xy[other]).T)
    kept = metres < distance
    row, other, metres = row[kept], other[kept], metres[kept]
    columns = (truth.frame[row], row, other, truth.track[row], found.track[other], found.score[other], metres)
    return [Pair(*values) for values in zip(*(column.tolist() for column in columns), strict=True)]
