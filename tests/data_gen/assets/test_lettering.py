"""Letters: as much ink as they have cells, the right way round for those who read them."""

import numpy as np
import pytest

from data_gen.assets.shapes.lettering import _ROWS, _rectangles, end_text, side_text, width_of
from data_gen.assets.shapes.mesh import Mesh
from data_gen.assets.shapes.palette import TRIM


def area_and_centre(mesh: Mesh):
    a, b, c = mesh.vertices[mesh.faces].astype(float).transpose(1, 0, 2)
    normal = np.cross(b - a, c - a) / 2
    area = np.linalg.norm(normal, axis=1)
    return area.sum(), (area[:, None] * (a + b + c) / 3).sum(axis=0) / area.sum(), normal.sum(axis=0)


@pytest.mark.parametrize("letter", sorted(set(_ROWS) - {" "}))
def test_strokes_cover_exactly_the_cells(letter):
    height = 1.5
    area = sum((b - a) * (d - c) for a, b, c, d in _rectangles(letter, height))
    assert area == pytest.approx(_ROWS[letter].count("1") * (height / 5) ** 2)


def test_a_word_on_an_end_is_read_by_who_comes_along_x():
    """Most of an L's ink is in its stem, on the reader's left: +y for somebody who looks along +x. It faces them."""
    low = Mesh.concatenate(end_text("L", 0.0, (3.0, 2.0), 1.0, TRIM))
    _, centre, normal = area_and_centre(low)
    assert centre[1] > 3.0
    assert centre[2] < 2.0
    assert normal[0] < 0
    assert np.ptp(low.vertices[:, 1]) == pytest.approx(width_of("L", 1.0))


def test_a_word_on_the_sides_is_read_from_either_side():
    both = Mesh.concatenate(side_text("L", (4.0, 2.0), 1.0, 1.2, TRIM))
    a, b, c = both.vertices[both.faces].astype(float).transpose(1, 0, 2)
    normal, middle = np.cross(b - a, c - a), (a + b + c) / 3
    assert (normal[:, 1] * middle[:, 1] > 0).all()
    for side in (-1, 1):
        mine = middle[:, 1] * side > 0
        x = np.average(middle[mine, 0], weights=np.linalg.norm(normal[mine], axis=1))
        assert (x - 4.0) * side > 0  # to the left of who stands on that side
