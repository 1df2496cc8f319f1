import torch
from torch import nn

from pipeline.training import checkpoint


def test_restored_moments_follow_the_memory_format_of_their_weights(tmp_path):
    def made() -> tuple[nn.Module, torch.optim.Optimizer]:
        torch.manual_seed(0)
        module = nn.Conv2d(3, 4, 3).to(memory_format=torch.channels_last)
        return module, torch.optim.Adam(module.parameters(), lr=0.1, fused=True)

    def step(module: nn.Module, optimizer: torch.optim.Optimizer) -> None:
        optimizer.zero_grad()
        module(torch.arange(3 * 64.0).reshape(1, 3, 8, 8) / 100).square().mean().backward()
        optimizer.step()

    module, optimizer = made()
    step(module, optimizer)
    checkpoint.save(tmp_path, module, optimizer, {}, checkpoint.Progress())
    restored, its_optimizer = made()
    checkpoint.load(tmp_path, restored, its_optimizer)
    step(module, optimizer)
    step(restored, its_optimizer)
    assert torch.equal(restored.weight, module.weight)
