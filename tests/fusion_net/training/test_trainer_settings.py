"""``configs/trainer`` and what of it reaches the plan of a run."""

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from fusion_net.common.cli.command import CONFIGS, build
from fusion_net.fit import _plan


def composed(*overrides):
    with initialize_config_dir(str(CONFIGS), version_base="1.3"):
        return compose("train", overrides=list(overrides))


def test_smoke_is_cpu_but_for_seven_values():
    cpu, smoke = (OmegaConf.to_container(composed(f"trainer={name}").trainer) for name in ("cpu", "smoke"))
    assert cpu.keys() == smoke.keys()
    assert {key for key in cpu if cpu[key] != smoke[key]} == {
        "batch_size", "camera_steps", "camera_only_steps", "fusion_steps", "dropout_from", "validate_every", "save_every",
    }  # fmt: skip


def test_warm_up_and_stage_fractions_reach_the_plan():
    fractions = "trainer.stage_fractions={camera:0.5,camera_only:0.25,fusion:0.25}"
    cfg = composed("trainer.warmup_fraction=0.4", "trainer.max_minutes=2", fractions)
    plan = _plan(cfg, build(cfg.model, "model"))
    assert plan.learning_rate(0.4) == pytest.approx(plan.max_lr)
    assert plan.learning_rate(0.2) < 0.6 * plan.max_lr
    assert plan.position(1, 30.0) == ("camera", pytest.approx(0.5))
    assert plan.position(2, 60.0) == ("camera_only", 0.0)
    assert plan.position(3, 90.0) == ("fusion", 0.0)


def test_the_default_is_one_process_on_the_cpu():
    trainer = composed().trainer
    assert (trainer.accelerator, trainer.devices, trainer.strategy) == ("cpu", 1, "auto")
