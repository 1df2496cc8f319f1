#!/bin/sh
# PyTorch's fused Adam on a CPU gives weights the moments of other weights if their memory formats differ.
#
# One expects: an optimizer whose state was saved and loaded takes the same steps as one that goes on, whatever the strides; without `fused` it does.
# What happens: weights are channels last, as convolutions on CPUs want them; files such as safetensors hold contiguous tensors, and `load_state_dict`
#     keeps their strides. The fused kernel then walks through the memory of both in parallel and pairs elements that do not belong together.
#     No error, no warning; the weights are off by as much as the steps are long.
# Whom it hurts: small convolutional networks of tactile images, trained on CPUs and continued from a checkpoint: another network results.
# Versions: torch 2.13.0, safetensors 0.8.0, numpy 2.4.6, Python 3.11. Date: 2026-11-29.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3.11}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check torch==2.13.0 safetensors==0.8.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'END'
import safetensors.torch
import torch

STEPS, RATE = 4, 0.1


def trained(fused, memory_format, interrupted):
    torch.manual_seed(0)
    network = torch.nn.Conv2d(3, 4, 3).to(memory_format=memory_format)
    images = torch.randn(2, 3, 8, 8)
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE, fused=fused)
    for step in range(STEPS):
        if interrupted and step == STEPS // 2:
            state = optimizer.state_dict()
            for number, moments in state["state"].items():
                moments = {name: value.contiguous() for name, value in moments.items()}
                state["state"][number] = safetensors.torch.load(safetensors.torch.save(moments))
            optimizer.load_state_dict(state)
        optimizer.zero_grad()
        network(images).square().mean().backward()
        optimizer.step()
    return network.weight.detach()


differs = {}
for fused in (False, True):
    for memory_format in (torch.contiguous_format, torch.channels_last):
        off = (trained(fused, memory_format, True) - trained(fused, memory_format, False)).abs().max()
        print(f"fused={fused}, {memory_format}: weights after an interruption differ by {off:.3g} (steps of {RATE})")
        differs[fused, memory_format] = bool(off > RATE / 10)
raise SystemExit([pair for pair, differing in differs.items() if differing] != [(True, torch.channels_last)])
END
