"""``data=sequence``: nano's sensors, scenes of ten seconds, and none of nano's scenes."""

from fusion_net.common.cli.composed import composed


def test_sequences_have_the_sensors_of_nano_and_scenes_of_their_own():
    nano, sequence = composed("data_gen"), composed("data_gen", "data=sequence")
    assert sequence.rig == nano.rig
    assert sequence.data.keyframes == 20
    assert sequence.data.root == "data/sequence"
    assert sequence.seed != nano.seed, (
        "a scene follows from seed and index: of nano's, these would be the first seconds"
    )
    assert {key: sequence[key] for key in ("scenario", "condition", "lidar")} == {
        key: nano[key] for key in ("scenario", "condition", "lidar")
    }


def test_a_seed_that_is_asked_for_is_the_one_that_counts():
    assert composed("data_gen", "data=sequence", "seed=3").seed == 3
