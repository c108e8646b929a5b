"""Letters, digits and arrows as flat patches on faces: what stands on signs, posters and lorries."""

from collections.abc import Sequence
from itertools import groupby, pairwise

from data_gen.assets.shapes.mesh import Mesh
from data_gen.assets.shapes.palette import Material
from data_gen.assets.shapes.profiles import end_patch, face_patch, side_patch

_ROWS = {
    "A": "010101111101101", "B": "110101110101110", "C": "011100100100011", "D": "110101101101110", "E": "111100110100111",
    "F": "111100110100100", "G": "011100101101011", "H": "101101111101101", "I": "111010010010111", "K": "101101110101101",
    "L": "100100100100111", "M": "101111111101101", "N": "110101101101101", "O": "010101101101010", "P": "110101110100100",
    "R": "110101110101101", "S": "011100010001110", "T": "111010010010010", "U": "101101101101111", "V": "101101101101010",
    "X": "101101010101101", "Y": "101101010010010", "Z": "111001010100111", "0": "111101101101111", "1": "010110010010111",
    "2": "111001111100111", "3": "111001011001111", "4": "101101111001001", "5": "111100111001111", "6": "111100111101111",
    "7": "111001010010010", "8": "111101111101111", "9": "111101111001111", "%": "101001010100101", " ": "0" * 15,
}  # fmt: skip
"""A letter is three columns by five rows, from the top left."""
Rectangle = tuple[float, float, float, float]


def _rectangles(word: str, height: float) -> list[Rectangle]:
    """Left, right, bottom, top of the strokes of a word that begins at 0, rows of equal ink joined."""
    cell, found = height / 5, []
    for place, letter in enumerate(word):
        rows = [_ROWS[letter][3 * i : 3 * i + 3] for i in range(5)]
        first = 0
        for row, same in groupby(rows):
            last = first + len(list(same))
            edges = [i for i, (a, b) in enumerate(pairwise(f"0{row}0")) if a != b]
            for left, right in zip(edges[::2], edges[1::2], strict=True):
                x = 4 * place
                found.append(((x + left) * cell, (x + right) * cell, height - last * cell, height - first * cell))
            first = last
    return found


def width_of(word: str, height: float) -> float:
    """Metres that a word takes."""
    return (4 * len(word) - 1) * height / 5


def end_text(word: str, x: float, middle: tuple[float, float], height: float, material: Material) -> list[Mesh]:
    """A word on a face across the body at ``x`` that looks back (-x), its middle at (y, z), letters ``height`` tall."""
    left, low = middle[0] + width_of(word, height) / 2, middle[1] - height / 2
    return [
        end_patch(x, (left - b, left - a), (low + c, low + d), material, facing=-1)
        for a, b, c, d in _rectangles(word, height)
    ]


def side_text(
    word: str, middle: tuple[float, float], height: float, half_width: float, material: Material
) -> list[Mesh]:
    """A word on both sides of a body ``half_width`` to each side, its middle at (x, z), to be read from either side."""
    low, start = middle[1] - height / 2, -width_of(word, height) / 2
    patches = []
    for a, b, c, d in _rectangles(word, height):
        for side in (1, -1):  # on the left it runs backwards
            x = sorted(middle[0] - side * (start + edge) for edge in (a, b))
            outline = [(x[0], low + c), (x[1], low + c), (x[1], low + d), (x[0], low + d)]
            patches.append(side_patch(outline, half_width, material, proud=0.02, sides=(side,)))
    return patches


ARROW = ((0.14, -0.5), (0.14, 0.05), (0.38, 0.05), (0.0, 0.5), (-0.38, 0.05), (-0.14, 0.05), (-0.14, -0.5))
"""An arrow that points up, one unit tall, as points (y, z)."""


def symbol(
    outline: Sequence[tuple[float, float]], x: float, middle: tuple[float, float], scale: float, material: Material
) -> Mesh:
    """A shape given by points (y, z) about its middle, ``scale`` times as large, on a face at ``x`` that looks back."""
    points = [(middle[0] + scale * y, middle[1] + scale * z) for y, z in outline]
    return face_patch(x, points, material, facing=-1)
