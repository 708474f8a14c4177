"""The head's losses in plain PyTorch, value and gradient each.

Writes `losses.safetensors` beside itself. Gaussian focal loss (Law and Deng 2018; alpha 2, gamma 4, scores
clipped to [1e-4, 1 - 1e-4]), sigmoid focal loss (Lin et al. 2017; gamma 2, alpha 0.25), L1 of box codes
with a weight a number, as the published TransFusion head sets them.

    .venv-golden/bin/python tests/golden/torch_losses.py
"""

from __future__ import annotations

from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor
from torch.nn import functional

CODE_WEIGHTS = torch.tensor([1.0] * 8 + [0.2] * 2)


def gaussian_focal(logits: Tensor, target: Tensor) -> Tensor:
    """Over the number of ones in the target, at least one."""
    p = torch.sigmoid(logits).clamp(1e-4, 1 - 1e-4)
    at_peaks = -torch.log(p) * (1 - p) ** 2 * (target == 1)
    elsewhere = -torch.log(1 - p) * p**2 * (1 - target) ** 4
    return (at_peaks + elsewhere).sum() / max(int((target == 1).sum()), 1)


def sigmoid_focal(logits: Tensor, target: Tensor, n_matched: int) -> Tensor:
    """Target [query, class], 0 or 1; rows without a one are background."""
    p = torch.sigmoid(logits)
    of_truth = p * target + (1 - p) * (1 - target)
    alpha = 0.25 * target + 0.75 * (1 - target)
    entropy = functional.binary_cross_entropy_with_logits(logits, target, reduction="none")
    return (alpha * (1 - of_truth) ** 2 * entropy).sum() / max(n_matched, 1)


def box_l1(codes: Tensor, target: Tensor, is_matched: Tensor) -> Tensor:
    """Of matched queries."""
    difference = (codes - target).abs() * CODE_WEIGHTS * is_matched[..., None]
    return difference.sum() / max(int(is_matched.sum()), 1)


def main() -> None:
    """Writes the file."""
    torch.manual_seed(30)
    found: dict[str, Tensor] = {}

    # Saturated scores too: they are where a clip, or its absence, shows.
    logits = 3 * torch.randn(2, 2, 6, 5)
    logits[0, 0, :, 0] = torch.tensor([-30.0, -12.0, -9.5, 9.5, 12.0, 30.0])
    for case, n_peaks in (("peaks", 4), ("no_peaks", 0)):
        target = 0.97 * torch.rand(2, 2, 6, 5)
        target.view(-1)[torch.randperm(120)[:n_peaks]] = 1.0
        if n_peaks:
            target[0, 0, 2:4, 0] = 1.0
        x = logits.clone().requires_grad_()
        loss = gaussian_focal(x, target)
        loss.backward()
        found |= {f"heatmap.{case}.logits": logits, f"heatmap.{case}.target": target}
        found |= {f"heatmap.{case}.loss": loss, f"heatmap.{case}.gradient": x.grad}

    n_batch, n_queries = 2, 7
    harm = 2 * torch.randn(n_batch, n_queries, 2)
    harm[0, :4, 0] = torch.tensor([-40.0, -16.0, 16.0, 40.0])
    codes, target_codes = torch.randn(n_batch, n_queries, 10), torch.randn(n_batch, n_queries, 10)
    for case, n_matched in (("matched", 5), ("unmatched", 0)):
        is_matched = torch.zeros(n_batch * n_queries)
        is_matched[torch.tensor([0, 2, 5, 8, 13])[:n_matched]] = 1.0
        is_matched = is_matched.view(n_batch, n_queries)
        classes = torch.randint(0, 2, (n_batch, n_queries))
        target = functional.one_hot(classes, 2) * is_matched[..., None]
        for name, logits_of, loss_of in (
            ("harm", harm, lambda x, target=target, n=n_matched: sigmoid_focal(x, target, n)),
            ("boxes", codes, lambda x, of=is_matched: box_l1(x, target_codes, of)),
        ):
            x = logits_of.clone().requires_grad_()
            loss = loss_of(x)
            loss.backward()
            found |= {
                f"{name}.{case}.input": logits_of,
                f"{name}.{case}.loss": loss,
                f"{name}.{case}.gradient": x.grad,
            }
        found |= {f"harm.{case}.target": target, f"boxes.{case}.target": target_codes}
        found[f"boxes.{case}.is_matched"] = is_matched

    path = Path(__file__).parent / "losses.safetensors"
    save_file({name: value.detach().clone().contiguous() for name, value in found.items()}, path)
    print(path, path.stat().st_size)


if __name__ == "__main__":
    main()
