"""The training loop: resumable to the bit, seeded, and loud about what no later step mends."""

from __future__ import annotations

import multiprocessing

import pytest
import torch

from pipeline.errors import StageError, StoreError
from pipeline.models.model_files import load_model, save_model
from pipeline.training import checkpoint
from pipeline.training.loop import read_metrics, train
from tests.learning.regression import Regression, Scripted, job, run, settings


def same(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> bool:
    return all(torch.equal(one[name], other[name]) for name in one)


def validated(learner: Regression) -> float:
    learner.module.eval()
    with torch.no_grad():
        return learner.validate()["loss"]


@pytest.mark.parametrize(("kill_at", "precision"), [(0, "32-true"), (3, "32-true"), (7, "64-true"), (20, "32-true")])
def test_killed_in_mid_epoch_and_run_again_the_weights_are_those_of_an_undisturbed_run(tmp_path, kill_at, precision):
    undisturbed = run(tmp_path / "whole", precision=precision)
    process = multiprocessing.get_context("spawn").Process(target=run, args=(tmp_path / "killed", 0, kill_at, precision))
    process.start()
    process.join()
    assert process.exitcode == -9
    assert (tmp_path / "killed" / checkpoint.FILE).exists() == (kill_at > 0)
    assert same(run(tmp_path / "killed", precision=precision), undisturbed)
    assert read_metrics(tmp_path / "killed") == read_metrics(tmp_path / "whole")


def test_a_run_that_had_ended_does_nothing_more_and_what_a_killed_one_half_wrote_goes_with_the_checkpoint(tmp_path):
    first = run(tmp_path)
    (tmp_path / f"{checkpoint.FILE}.tmp").write_text("half")
    assert same(run(tmp_path), first)
    checkpoint.discard(tmp_path)
    assert not list(tmp_path.glob("checkpoint*"))


def test_the_same_seed_agrees_to_the_bit_and_two_seeds_differ(tmp_path):
    first, again, other = (run(tmp_path / name, seed) for name, seed in (("a", 0), ("b", 0), ("c", 1)))
    assert same(first, again)
    assert not same(first, other)


def test_it_learns_and_keeps_the_best_epoch(tmp_path):
    learner = Regression()
    facts = train(learner, settings(epochs=40, learning_rate=0.03), job(tmp_path), "regression")
    losses = [row["loss"] for row in read_metrics(tmp_path)]
    assert losses[facts["best_epoch"]] == min(losses) == facts["best"]["loss"] < 0.5 * losses[0]
    assert len(losses) == facts["epochs"] == 40
    assert validated(learner) == min(losses)
    assert facts["hardware"]["threads"] == 1
    assert list(tmp_path.glob("tensorboard/**/events*"))


def test_patience_ends_it(tmp_path):
    learner = Scripted(validation=[3.0, 1.0, 2.0, 1.5, 0.5])
    facts = train(learner, settings(epochs=5, patience=2), job(tmp_path), "regression")
    assert (facts["best_epoch"], facts["epochs"]) == (1, 4)


def test_a_loss_that_is_no_number_stops_with_the_batch_that_caused_it(tmp_path):
    with pytest.raises(StageError, match=r"loss is nan in epoch 1, step \d.*point-17\b.*learning_rate"):
        train(Regression(poison=17), settings(), job(tmp_path), "regression")


def test_a_loss_that_explodes_stops(tmp_path):
    with pytest.raises(StageError, match=r"loss is 11 in epoch 2, step 1 \(limit 10\); its batch: point-"):
        train(Scripted(training=[1.0, 11.0]), settings(explosion=10), job(tmp_path), "regression")


def test_a_device_that_is_not_there_is_an_error_with_words(tmp_path):
    if torch.cuda.is_available():
        pytest.skip("there is one")
    with pytest.raises(StageError, match="accelerator cuda"):
        train(Regression(), settings(accelerator="cuda"), job(tmp_path), "regression")


def test_what_one_of_two_processes_raises_comes_in_words(tmp_path):
    with pytest.raises(StageError, match=r"loss is nan in epoch 1.*point-"):
        train(Regression(poison=17), settings(devices=2), job(tmp_path), "regression")


def test_two_processes_share_a_batch_and_repeat_to_the_bit(tmp_path):
    learner, again = Regression(), Regression()
    facts = train(learner, settings(devices=2, epochs=30), job(tmp_path / "once"), "regression")
    train(again, settings(devices=2, epochs=30), job(tmp_path / "again"), "regression")
    assert facts["hardware"]["processes"] == 2
    assert validated(learner) == pytest.approx(facts["best"]["loss"])
    assert facts["best"]["loss"] < 0.5 * read_metrics(tmp_path / "once")[0]["loss"]
    assert same(learner.module.state_dict(), again.module.state_dict())


def test_two_processes_take_the_steps_of_one(tmp_path):
    one, two = Regression(plain=True), Regression(plain=True)
    train(one, settings(), job(tmp_path / "one"), "regression")
    train(two, settings(devices=2), job(tmp_path / "two"), "regression")
    for name, value in one.module.state_dict().items():
        torch.testing.assert_close(two.module.state_dict()[name], value, rtol=1e-3, atol=1e-4)


def test_a_model_comes_back_as_it_was_saved_and_a_folder_without_one_is_an_error(tmp_path):
    module = Regression().module
    save_model(tmp_path, module, {"width": 8})
    weights, description = load_model(tmp_path)
    assert same(module.state_dict(), weights)
    assert description == {"width": 8}
    with pytest.raises(StoreError, match="no trained model"):
        load_model(tmp_path / "nowhere")
