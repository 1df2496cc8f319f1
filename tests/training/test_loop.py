"""The training loop: resumable to the bit, seeded, and stopped by losses that no later step repairs."""

from __future__ import annotations

import multiprocessing

import pytest
import torch

from pipeline.errors import StageError
from pipeline.training import checkpoint
from pipeline.training.loop import read_metrics
from pipeline.training.settings import TrainingSettings
from tests.training.regression import Regression, Scripted, fit, run, settings


def same(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> bool:
    return all(torch.equal(one[name], other[name]) for name in one)


def validated(learner: Regression) -> float:
    learner.network.eval()
    with torch.no_grad():
        return learner.validate(learner.network)["loss"]


LATER = [pytest.param(3, "32-true", marks=pytest.mark.slow), pytest.param(20, "32-true", marks=pytest.mark.slow)]


@pytest.mark.parametrize(("kill_at", "precision"), [(0, "32-true"), (7, "64-true"), *LATER])
def test_resumed_training_gives_the_weights_of_an_uninterrupted_one(tmp_path, kill_at, precision):
    undisturbed = run(tmp_path / "whole", precision=precision)
    process = multiprocessing.get_context("spawn").Process(target=run, args=(tmp_path / "killed", 0, kill_at, precision))
    process.start()
    process.join()
    assert process.exitcode == -9
    assert (tmp_path / "killed" / checkpoint.FILE).exists() == (kill_at > 0)
    assert same(run(tmp_path / "killed", precision=precision), undisturbed)
    assert read_metrics(tmp_path / "killed") == read_metrics(tmp_path / "whole")


def test_finished_training_is_not_repeated(tmp_path):
    first = run(tmp_path)
    assert same(run(tmp_path), first)


def test_weights_follow_from_the_seed_bit_for_bit(tmp_path):
    first, again, other = (run(tmp_path / name, seed) for name, seed in (("a", 0), ("b", 0), ("c", 1)))
    assert same(first, again)
    assert not same(first, other)


def test_cosine_schedule_warms_up_over_a_twentieth_and_falls_to_zero():
    cosine, constant = (settings(learning_rate=0.5, schedule=schedule) for schedule in ("cosine", "constant"))
    rates = [cosine.rate_at(step, 200) for step in range(200)]
    assert rates[:10] == pytest.approx([0.05 * (step + 1) for step in range(10)])
    assert rates[10] == 0.5
    assert rates[105] == pytest.approx(0.25)
    assert 0 < rates[-1] < 1e-3
    assert rates[10:] == sorted(rates[10:], reverse=True)
    assert [cosine.rate_at(step, 3) for step in range(3)] == pytest.approx([0.5, 0.5, 0.25])
    assert {constant.rate_at(step, 9) for step in range(9)} == {0.5}


def test_each_step_uses_its_learning_rate(tmp_path, monkeypatch):
    monkeypatch.setattr(TrainingSettings, "rate_at", lambda self, step, steps: {(0, 1): 0.25 * self.learning_rate}[step, steps])
    learner = Regression(plain=True)
    before = [parameter.detach().clone() for parameter in learner.network.parameters()]
    fit(learner, tmp_path, epochs=1, batch_size=48, learning_rate=0.01, schedule="cosine")
    moved = [float((now.detach() - then).abs().max()) for now, then in zip(learner.network.parameters(), before, strict=True)]
    assert moved == pytest.approx([0.0025] * 4, rel=1e-3), "Adam's first step is as long as the rate, whatever the gradient"


def test_long_gradient_is_clipped(tmp_path):
    whole, limited = ({}, {})
    for gradients, changes in ((whole, {}), (limited, {"gradient_limit": 0.5})):
        learner = Regression(plain=True)
        fit(learner, tmp_path / str(changes), epochs=1, batch_size=48, **changes)
        gradients.update({name: parameter.grad for name, parameter in learner.network.named_parameters()})
    norm = torch.nn.utils.get_total_norm(whole.values())
    assert norm > 1
    assert all(torch.allclose(limited[name], gradient * 0.5 / norm, rtol=1e-4) for name, gradient in whole.items())


def test_best_epochs_weights_are_kept(tmp_path):
    learner = Regression()
    facts = fit(learner, tmp_path, epochs=40, learning_rate=0.03)
    losses = [row["loss"] for row in read_metrics(tmp_path)]
    assert losses[facts["best_epoch"]] == min(losses) == facts["best"]["loss"] < 0.5 * losses[0]
    assert len(losses) == facts["epochs"] == 40
    assert validated(learner) == min(losses)
    assert facts["hardware"]["threads"] == 1
    assert list(tmp_path.glob("tensorboard/**/events*"))


def test_training_in_a_slurm_job_has_the_same_result(tmp_path, monkeypatch):
    alone = run(tmp_path / "alone")
    (tmp_path / "srun").write_text("")
    (tmp_path / "srun").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")  # lightning looks for srun, and then believes these
    for name, value in {"SLURM_JOB_NAME": "train-gcn", "SLURM_NTASKS": "4", "SLURM_PROCID": "1", "SLURM_LOCALID": "1"}.items():
        monkeypatch.setenv(name, value)
    assert same(run(tmp_path / "job"), alone)


def test_patience_ends_a_training(tmp_path):
    learner = Scripted(validation=[3.0, 1.0, 2.0, 1.5, 0.5])
    facts = fit(learner, tmp_path, epochs=5, patience=2)
    assert (facts["best_epoch"], facts["epochs"]) == (1, 4)


def test_loss_that_is_nan_stops_and_names_its_batch(tmp_path):
    with pytest.raises(StageError, match=r"loss is nan .*, in epoch 1, step \d; lower learning_rate .* its batch: .*point-17\b"):
        fit(Regression(poison=17), tmp_path)


def test_loss_beyond_the_explosion_limit_stops(tmp_path):
    with pytest.raises(StageError, match=r"loss is 10001 \(limit 10000\), in epoch 2, step 1; lower .* its batch: point-"):
        fit(Scripted(training=[1.0, 10001.0]), tmp_path)


def test_missing_device_is_a_stage_error(tmp_path):
    if torch.cuda.is_available():
        pytest.skip("there is one")
    with pytest.raises(StageError, match="accelerator cuda"):
        fit(Regression(), tmp_path, accelerator="cuda")


@pytest.mark.slow
def test_error_of_one_of_two_processes_is_a_stage_error(tmp_path):
    with pytest.raises(StageError, match=r"loss is nan .* in epoch 1.*point-"):
        fit(Regression(poison=17), tmp_path, devices=2)
