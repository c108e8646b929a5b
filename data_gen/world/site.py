"""Where there is room beside the road for what stands there, where people walk, and which way traffic runs."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data_gen.road.layout import Layout
from data_gen.world.ground import GroundMap
from data_gen.world.paint import URBAN, VERGE
from data_gen.world.roadside import Verge, carriageway

Array = NDArray[np.float64]

REACH = 110.0
"""Nothing stands further than this from the ego's path, in metres."""
_COARSE = 5  # pixels of the ground raster a cell of the clearance map


class Site:
    """What is free: ``room`` (rows, columns) metres from the carriageway, 0 where something stands or the ego never comes
    near; where people walk; and which way traffic runs."""

    def __init__(self, layout: Layout, ground: GroundMap, verges: list[Verge]) -> None:
        self.cell = ground.resolution * _COARSE
        off_road = ~carriageway(ground, _COARSE)
        self.room = cv2.distanceTransform(off_road.view(np.uint8), cv2.DIST_L2, 3) * self.cell
        self.path = layout.ego.position[:, :2]
        near = np.zeros(off_road.shape, np.uint8)
        cv2.polylines(near, [np.rint(self.path / self.cell).astype(np.int32)], False, 1, int(2 * REACH / self.cell))
        self.room[near == 0] = 0.0
        walk = [verge.points + VERGE / 2 * verge.outward for verge in verges] if layout.name in URBAN else []
        self._walk = cKDTree(np.concatenate([*walk, np.full((1, 2), -1e3)]))
        self._lanes = cKDTree(np.concatenate([lane.centre for lane in layout.lanes]))
        self._yaw = np.concatenate([lane.yaw for lane in layout.lanes])

    def room_at(self, at: Array) -> NDArray[np.float32]:
        """Metres of room at places (K, 2); 0 outside and in the middle of a pavement."""
        column, row = np.floor(at / self.cell).astype(int).T
        inside = (row >= 0) & (row < self.room.shape[0]) & (column >= 0) & (column < self.room.shape[1])
        inside &= self._walk.query(at)[0] > 0.62
        return np.where(inside, self.room[row * inside, column * inside], 0.0)

    def fits(self, corners: Array, room: float) -> NDArray[np.bool_]:
        """Whether plots with corners (K, P, 2) have ``room`` all along their outline."""
        share = np.linspace(0, 1, 6)[:, None, None, None]
        outline = corners + share * (np.roll(corners, -1, axis=1) - corners)
        return self.room_at(outline.reshape(-1, 2)).reshape(6, len(corners), corners.shape[1]).min(axis=(0, 2)) >= room

    def take(self, corners: Array) -> None:
        """Build on the plot with corners (P, 2)."""
        cv2.fillConvexPoly(self.room, np.rint(corners / self.cell).astype(np.int32), 0.0)

    def travel(self, at: Array) -> Array:
        """Heading (K,) of the traffic on the lane nearest to each place."""
        return self._yaw[self._lanes.query(at)[1]]

    def on_lane(self, at: Array) -> tuple[Array, float]:
        """The point (2,) in the middle of a lane that is nearest to a place (2,), and the heading there."""
        nearest = self._lanes.query(at)[1]
        return self._lanes.data[nearest], float(self._yaw[nearest])
