"""The on-disk contract: names, suffixes, keys and scales of a nuScenes tree, and what generated trees add to it.

The format is that of https://www.nuscenes.org/nuscenes#data-format; the generator writes it, the reader, the pictures and
the checks with the official devkit read it. Plain Python: the devkit's environment, with its older numpy, imports it too.
"""

MODALITIES = ("camera", "lidar", "radar")
"""Kinds of sensors, in the order of the ``present`` mask and of every table."""
REFERENCE = "LIDAR_TOP"
"""The channel whose keyframe gives a sample its time and its ego pose."""

# Folders and files below the root
SAMPLES, SWEEPS, MAPS = "samples", "sweeps", "maps"
"""Folders of the keyframes' files, of the firings between them, and of the map masks."""
VERSION_PREFIX = "v1.0-"
"""What the name of a folder of tables begins with."""
SPLITS_FILE, MANIFEST_FILE = "splits.json", "manifest.json"
"""Scene names by split, beside the tables; how a generated tree was made, in its root."""
FILE_SUFFIX = {"camera": ".jpg", "lidar": ".pcd.bin", "radar": ".pcd"}
FILE_FORMAT = {"camera": "jpg", "lidar": "pcd", "radar": "pcd"}
"""``fileformat`` of a sample_data record."""

# Side files of generated trees: the stem of the sensor file and one of these
DEPTH_SUFFIX = ".depth.png"
"""Exact depth beside an image: 16 bits, metres along the optical axis times DEPTH_SCALE, 0 where there is none (sky)."""
DEPTH_SCALE = 256.0
"""KITTI's convention: 1/256 m."""
CLASS_SUFFIX = ".class.png"
"""Exact class beside an image: 8 bits, 1 + the index in CLASSES, 0 for what is no object."""
TIME_SUFFIX = ".time.npy"
"""Beside a sweep: seconds of each point relative to the sweep's time stamp."""
CAUSE_SUFFIX = ".cause.npy"
"""Beside a radar scan: what caused each detection."""

RADAR_FIELDS = (
    ("x", "F", 4), ("y", "F", 4), ("z", "F", 4), ("dyn_prop", "I", 1), ("id", "I", 2), ("rcs", "F", 4), ("vx", "F", 4),
    ("vy", "F", 4), ("vx_comp", "F", 4), ("vy_comp", "F", 4), ("is_quality_valid", "I", 1), ("ambig_state", "I", 1),
    ("x_rms", "I", 1), ("y_rms", "I", 1), ("invalid_state", "I", 1), ("pdh0", "I", 1), ("vx_rms", "I", 1),
    ("vy_rms", "I", 1),
)  # fmt: skip
"""Name, type and bytes of the 18 columns of a radar file; 43 bytes a record, packed."""

# Names in the tables
CLASSES = (
    "car", "truck", "bus", "trailer", "construction_vehicle", "pedestrian", "motorcycle", "bicycle", "traffic_cone",
    "barrier",
)  # fmt: skip
"""The ten detection classes, in the order of labels and tables."""
CATEGORY_TO_CLASS = {
    "vehicle.car": "car",
    "vehicle.truck": "truck",
    "vehicle.bus.rigid": "bus",
    "vehicle.bus.bendy": "bus",
    "vehicle.trailer": "trailer",
    "vehicle.construction": "construction_vehicle",
    "human.pedestrian.adult": "pedestrian",
    "human.pedestrian.child": "pedestrian",
    "human.pedestrian.construction_worker": "pedestrian",
    "human.pedestrian.police_officer": "pedestrian",
    "vehicle.motorcycle": "motorcycle",
    "vehicle.bicycle": "bicycle",
    "movable_object.trafficcone": "traffic_cone",
    "movable_object.barrier": "barrier",
}
"""Categories that are detection classes; all others are ignored by the metric."""
BICYCLE_RACK = "static_object.bicycle_rack"
"""Category of the boxes inside of which bicycles and motorcycles are not scored."""
DECOY_CATEGORY = "movable_object.debris"
"""Category of what is no object but looks like one to some sensor: no detection class, so every metric ignores it, and one
of nuScenes' own, so that the devkit draws it."""
ATTRIBUTES = (
    "vehicle.moving", "vehicle.stopped", "vehicle.parked", "cycle.with_rider", "cycle.without_rider",
    "pedestrian.moving", "pedestrian.standing", "pedestrian.sitting_lying_down",
)  # fmt: skip
VISIBILITY_LEVELS = ("v0-40", "v40-60", "v60-80", "v80-100")
"""Visible percentage of an object; the token of a level is its place in this tuple, from 1."""

# Keys that generated trees add
TRUE_TIMESTAMP, TRUE_TRANSLATION, TRUE_ROTATION = "true_timestamp", "true_translation", "true_rotation"
"""Of sample_data: when and from which mount the sensor truly measured, where the calibration or the clock is wrong."""
LIDAR_ECHOES, RADAR_ECHOES = "num_lidar_echoes", "num_radar_echoes"
"""Of sample_annotation: returns that the object itself caused, wherever they lie (``num_*_pts``: points inside the box)."""
EXACT_VELOCITY = "velocity"
"""Of sample_annotation: m/s in the global frame; the official velocity is a finite difference between keyframes."""
IMITATED_CATEGORY = "imitates"
"""Of sample_annotation: the category that a decoy is mistaken for, empty for an object."""
BEAMS = "beams"
"""Of calibrated_sensor: how many beams a LiDAR has."""
