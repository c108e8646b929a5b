"""The cells that are asked for: every group, no two alike, within the amounts of the issue."""

import pytest

from fusion_net.evaluation.cells.plan import GROUPS, SOUND, plan


@pytest.mark.parametrize("quick", [True, False])
def test_cells_are_unlike_and_every_group_has_some(quick):
    cells = plan(GROUPS, quick=quick, other_lidar="data/other")
    assert cells[0] == SOUND
    assert len({(cell.group, cell.name) for cell in cells}) == len(cells)
    assert {cell.group for cell in cells} == {SOUND.group, *GROUPS}
    assert {sensor for cell in cells for sensor in cell.sensors} >= {"camera", "lidar", "radar"}


def test_a_quick_plan_is_a_part_of_the_whole_one():
    whole, quick = ({(cell.group, cell.name) for cell in plan(GROUPS, quick=quick)} for quick in (False, True))
    assert quick < whole
    assert len(quick) < len(whole) / 2.5


def test_amounts_reach_what_the_lesson_speaks_of():
    largest = {}
    for cell in plan(["calibration", "shake", "clocks"], quick=False):
        if cell.curve:
            kind = (cell.group, cell.curve.split()[1])
            largest[kind] = max(largest.get(kind, 0.0), cell.amount)
    assert {largest["calibration", axis] for axis in ("roll", "pitch", "yaw")} == {3.0}
    assert {largest["shake", axis] for axis in ("x", "y", "z")} == {0.5}
    assert largest["clocks", "late,"] == 0.2


def test_an_unknown_group_is_named_with_those_that_there_are():
    with pytest.raises(ValueError, match="cells=clock is unknown; there are conditions, deaths"):
        plan(["clock"], quick=True)
