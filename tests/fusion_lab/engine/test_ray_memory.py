"""Rays that were cast before get the answer that they got, of their own scene, and memory is bounded."""

import numpy as np
import pytest

from data_gen.scene.conditions import Condition
from data_gen.scene.scene import Hits
from fusion_lab.engine.ray_memory import RayMemory

DOWN = np.array([[0, 0, -1], [0, 0.6, -0.8]], np.float32)


class Casts:
    """A scene that counts what is cast into it, and answers with that number as the distance."""

    def __init__(self):
        self.count = 0

    def cast(self, origins, directions, times, max_range=250.0, *, counted=True):
        self.count += 1
        rays = len(directions)
        whole, vectors = np.zeros(rays, np.int32), np.zeros((rays, 3), np.float32)
        return Hits(np.full(rays, self.count, np.float32), whole, whole, vectors, vectors, whole[:0], whole[:0])


def served(limit=10_000, scenes=1):
    memory, found = RayMemory(limit), [Casts() for _ in range(scenes)]
    for scene in found:
        memory.serve(scene)
    return found


def test_the_same_rays_are_cast_once_and_others_are_others():
    (scene,) = served()
    first = scene.cast(np.zeros(3), DOWN, 1.0, 100.0, counted=False)
    assert scene.cast(np.zeros(3), DOWN.copy(), 1.0, 100.0, counted=False) is first
    assert scene.count == 1
    for other in ((np.ones(3), DOWN, 1.0, 100.0), (np.zeros(3), -DOWN, 1.0, 100.0), (np.zeros(3), DOWN, 2.0, 100.0)):
        assert scene.cast(*other, counted=False) is not first
    assert scene.cast(np.zeros(3), DOWN, 1.0, 100.0, counted=True) is not first
    assert scene.count == 5


def test_scenes_have_answers_of_their_own():
    one, two = served(scenes=2)
    assert one.cast(np.zeros(3), DOWN, 1.0) is not two.cast(np.zeros(3), DOWN, 1.0)
    assert two.count == 1


def test_what_was_asked_for_longest_ago_is_forgotten_first():
    (scene,) = served(limit=200)  # two answers of 72 bytes
    for time in (1.0, 2.0, 1.0, 3.0):
        scene.cast(np.zeros(3), DOWN, time)
    assert scene.count == 3
    scene.cast(np.zeros(3), DOWN, 1.0)
    assert scene.count == 3
    scene.cast(np.zeros(3), DOWN, 2.0)
    assert scene.count == 4


@pytest.mark.parametrize("weather", [Condition(name="fog", visibility=50.0), Condition(name="night", illuminance=1.0)])
def test_a_scene_in_other_weather_asks_the_same_memory(studio, weather):
    scene = studio._episode(0).scene
    rays = np.zeros(3), DOWN, 0.5
    assert scene.under(weather).cast(*rays) is scene.cast(*rays)
