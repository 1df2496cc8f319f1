"""The training loop: resumable to the bit, seeded, and stopped by losses that no later step repairs."""

import multiprocessing
import threading

import pytest
import torch

from pipeline.errors import StoreError
from pipeline.training import checkpoint
from pipeline.training.checkpoint import read_metrics
from pipeline.training.loop import read_ahead
from pipeline.training.settings import TrainingSettings
from tests.training.regression import Regression, Scripted, fit, run, settings


def same(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> bool:
    return all(torch.equal(one[name], other[name]) for name in one)


def validated(learner: Regression) -> float:
    learner.network.eval()
    with torch.no_grad():
        return learner.validate(learner.network)["loss"]


OTHERS = [pytest.param(step, "32-true", marks=pytest.mark.slow) for step in (0, 3, 20)]


@pytest.mark.parametrize(("kill_at", "precision"), [(7, "64-true"), *OTHERS])
def test_resumed_training_gives_the_weights_of_an_uninterrupted_one(tmp_path, kill_at, precision):
    undisturbed = run(tmp_path / "whole", precision=precision)
    process = multiprocessing.get_context("spawn").Process(target=run, args=(tmp_path / "killed", 0, kill_at, precision))
    process.start()
    process.join()
    assert process.exitcode == -9
    assert (tmp_path / "killed" / checkpoint.FILE).exists() == (kill_at > 0)
    assert same(run(tmp_path / "killed", precision=precision), undisturbed)
    assert read_metrics(tmp_path / "killed") == read_metrics(tmp_path / "whole")


def test_weights_follow_from_the_seed_and_a_finished_training_is_not_repeated(tmp_path):
    first, again, other = (run(tmp_path / name, seed) for name, seed in (("a", 0), ("a", 0), ("c", 1)))
    assert same(first, again)
    assert same(first, run(tmp_path / "b"))
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


def test_patience_ends_a_training(tmp_path):
    learner = Scripted(validation=[3.0, 1.0, 2.0, 1.5, 0.5])
    facts = fit(learner, tmp_path, epochs=5, patience=2)
    assert (facts["best_epoch"], facts["epochs"]) == (1, 4)


def test_one_part_is_read_ahead_and_errors_are_raised_in_order():
    read = []

    def note(part):
        read.append(part)
        if part == 2:
            raise StoreError("gone")
        return part

    parts = read_ahead(note, range(9))
    assert [next(parts)[1]() for _ in range(2)] == [0, 1]
    content = next(parts)[1]
    with pytest.raises(StoreError, match="gone"):
        content()
    parts.close()
    assert read in ([0, 1, 2], [0, 1, 2, 3])
    assert not list(read_ahead(int, []))


class Waiting(Regression):
    """Learns from a batch when the reading of the next one has begun."""

    def __init__(self):
        super().__init__(plain=True)
        self.begun, self.threads = threading.Semaphore(0), set()

    def read(self, items, generators):
        self.threads.add(threading.current_thread().name)
        self.begun.release()
        return super().read(items, generators)

    def loss(self, network, batch):
        last = self.steps % 6 == 5  # of 6 batches of an epoch
        assert self.begun.acquire(timeout=20)
        if not last:
            assert self.begun.acquire(timeout=20)
            self.begun.release()
        return super().loss(network, batch)


def test_training_with_read_ahead_has_the_losses_of_one_without(tmp_path):
    waiting = Waiting()
    fit(waiting, tmp_path / "ahead", epochs=2)
    fit(Regression(plain=True), tmp_path / "plain", epochs=2)
    assert threading.main_thread().name not in waiting.threads
    assert read_metrics(tmp_path / "ahead") == read_metrics(tmp_path / "plain")
