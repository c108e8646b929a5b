"""Files that are cut short or of another kind are named, and so is a sample without its reference record."""

import pytest

from fusion_net.data.samples import SampleReader

TOKEN = "scene-0000-1"


@pytest.mark.parametrize("channel", ["CAM_FRONT", "LIDAR_TOP", "RADAR_FRONT"])
def test_a_file_cut_short_is_named(own_tree, channel):
    path = own_tree.path(own_tree.keyframes[TOKEN][channel])
    path.write_bytes(path.read_bytes()[:-44])
    with pytest.raises(ValueError, match="cut short") as error:
        SampleReader().read(own_tree, TOKEN)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("suffix", [".depth.png", ".class.png", ".time.npy"])
def test_a_side_file_cut_short_is_named(own_tree, suffix):
    path = next(own_tree.root.glob(f"samples/*/{TOKEN[:10]}*{suffix}"))
    path.write_bytes(path.read_bytes()[:-13])
    with pytest.raises(ValueError, match=path.name):
        [SampleReader().read(own_tree, token) for token in own_tree.split("all")]


OTHER_CLOUD = b"VERSION 0.7\nFIELDS x y\nSIZE 4 4\nTYPE F F\nWIDTH 1\nHEIGHT 1\nDATA binary\n12345678"


@pytest.mark.parametrize("head", [b"", OTHER_CLOUD])
def test_a_radar_file_of_another_kind_is_named(own_tree, head):
    path = own_tree.path(own_tree.keyframes[TOKEN]["RADAR_FRONT"])
    path.write_bytes(head)
    with pytest.raises(ValueError, match="no whole header"):
        SampleReader().read(own_tree, TOKEN)


def test_a_sample_without_the_reference_record_is_named(own_tree):
    del own_tree.keyframes[TOKEN]["LIDAR_TOP"]
    with pytest.raises(ValueError, match=rf"sample '{TOKEN}' has no LIDAR_TOP keyframe"):
        SampleReader().read(own_tree, TOKEN)
