"""Which actors of a scene are labelled at which keyframes, and what their annotations say."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_gen.recording.tokens import SceneNames, token
from data_gen.recording.visibility import Visibility
from data_gen.scene.scene import Actor, Scene
from fusion_net.common.nuscenes_format import (
    DECOY_CATEGORY,
    EXACT_VELOCITY,
    IMITATED_CATEGORY,
    LIDAR_ECHOES,
    RADAR_ECHOES,
)

Row = dict[str, Any]

LABEL_RANGE = 60.0
"""Metres from the ego within which an object is annotated."""
MIN_RAYS = 4
"""Camera and LiDAR rays of a keyframe that must reach an object for it to be annotated there: nuScenes' annotators label
what they can see, and a radar's faint echo from below the truck in front is not seeing."""


def annotation_rows(
    scene: Scene, names: SceneNames, times: NDArray[np.float64], visibility: Sequence[Visibility]
) -> tuple[list[Row], list[Row]]:
    """Rows of the tables instance and sample_annotation. ``times`` (K,) of the keyframes in seconds, and the counts of each."""
    ego, samples = scene.ego.at(times)[0], names.sample_tokens(len(times))
    instances: list[Row] = []
    annotations: list[Row] = []
    for index, actor in enumerate(scene.actors):
        category = actor.asset.category or (DECOY_CATEGORY if actor.asset.imitates else "")
        if not category:
            continue
        position = actor.track.at(times)[0]
        in_sight = np.array([counts.reached[index] >= MIN_RAYS for counts in visibility])
        near = np.flatnonzero((np.hypot(*(position - ego)[:, :2].T) < LABEL_RANGE) & in_sight).tolist()
        if not near:
            continue
        instance = token(names.log, "instance", actor.instance)
        keys = ["", *(token(instance, k) for k in near), ""]
        for place, k in enumerate(near, start=1):
            annotations.append(
                {
                    "token": keys[place],
                    "sample_token": samples[k],
                    "instance_token": instance,
                    "visibility_token": str(visibility[k].level(index)),
                    **_state(actor, float(times[k])),
                    "prev": keys[place - 1],
                    "next": keys[place + 1],
                    "num_lidar_pts": int(visibility[k].points["lidar"][index]),
                    "num_radar_pts": int(visibility[k].points["radar"][index]),
                    LIDAR_ECHOES: int(visibility[k].echoes["lidar"][index]),
                    RADAR_ECHOES: int(visibility[k].echoes["radar"][index]),
                }
            )
        instances.append(
            {"token": instance, "category_token": token("category", category), "nbr_annotations": len(near),
             "first_annotation_token": keys[1], "last_annotation_token": keys[-2]}
        )  # fmt: skip
    return instances, annotations


def _state(actor: Actor, t: float) -> Row:
    """What an actor is and does at ``t`` seconds: attribute, box in the global frame, velocity."""
    (x, y, z), yaw, velocity = actor.track.at(t)
    length, width, height = actor.asset.size
    attribute = actor.attribute_at(float(np.linalg.norm(velocity)))
    return {
        "attribute_tokens": [token("attribute", attribute)] if attribute else [],
        "translation": [float(x), float(y), float(z + height / 2)],
        "size": [width, length, height],
        "rotation": yaw_quaternion(float(yaw)),
        EXACT_VELOCITY: velocity[:2].tolist(),
        IMITATED_CATEGORY: actor.asset.imitates,
    }


def yaw_quaternion(yaw: float) -> list[float]:
    """(w, x, y, z), w >= 0, of a turn about z by ``yaw`` radians."""
    half = math.remainder(yaw, math.tau) / 2
    return [math.cos(half), 0.0, 0.0, math.sin(half)]
